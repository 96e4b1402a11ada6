"""No current although the voltage has stepped: the clamp has no contact."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ipmclab.quality.record import GUARD_ROWS, Channel, Record
from ipmclab.run import Finding

_SHORTEST: Final = 8  # rows: a shorter stretch is not judged (convention)
_LATE: Final = 5  # rows: a current that flows that soon after an edge flows at once (convention)
_BEFORE: Final = 100
"""Rows before an edge whose mean is the current that flowed until then (a limit)."""
_SURELY: Final = 8.0
"""Standard errors by which the mean current of a stretch must differ from that before to be a current (convention)."""


def missing_contact(record: Record) -> list[Finding]:
    """``contact-missing``: after a step of the voltage the current stays away for at least five rows.

    The current has come when it has moved by a fifth of its largest change on that stretch and
    by eight standard deviations of the noise, and stays. Where it never does, a mean that differs by eight standard
    errors from that before the edge is a current all the same. A voltage that is on from row 0 is no step, unless the
    run states its rest or a current comes.
    """
    channel = record.channels.get("current")
    edges, ends = record.edges, record.ends
    if channel is None or not len(edges) or (channel.missing is not None and channel.missing[edges].any()):
        return []
    size = np.abs(record.heights)
    judged = record.constant_after & (ends - edges >= _SHORTEST) & (size >= 0.5 * size.max()) & (edges != 1)
    if not judged.any():
        return []
    current = channel.readings
    before = np.where(edges == 0, 0.0, current[np.maximum(edges - 3, 0)])
    early = np.abs(current[(edges[:, None] + np.arange(-2, _LATE)).clip(0, len(current) - 1)] - before[:, None])
    peaks = np.maximum(np.fmax.reduceat(current, edges) - before, before - np.fmin.reduceat(current, edges))
    least = np.maximum(8.0 * channel.noise, 0.2 * peaks)
    late = judged & (np.fmax.reduce(early, axis=1) <= least)
    found = []
    for place in np.flatnonzero(late):
        finding = _judge(record, channel, int(place), float(before[place]), float(least[place]))
        if finding is not None:
            found.append(finding)
    return found


def _judge(record: Record, channel: Channel, place: int, before: float, least: float) -> Finding | None:
    edge, end = int(record.edges[place]), int(record.ends[place])
    moved = np.abs(channel.readings[edge:end] - before)
    with np.errstate(invalid="ignore"):
        above = np.flatnonzero(moved > least)
    if len(above):
        came = edge + int(above[0])
        if came - edge < _LATE or np.nanmedian(moved[above[0] : above[0] + 5]) < 0.4 * least:
            return None  # a spike, not the current
    elif (
        end - edge < 0.05 * len(record) or (edge == 0 and record.begins_under_voltage) or _flows(record, channel, place)
    ):
        return None
    else:
        came = end
    count = came - edge
    seconds = float(record.run.time[min(came, len(record) - 1)] - record.run.time[edge])
    until = f"until {record.at(came)}" if came < end else "until the voltage changes again or the record ends"
    begins = f"is at {record.run.voltage[0]:.4g} V" if edge == 0 else f"steps by {record.heights[place]:.4g} V"
    return Finding(
        code="contact-missing",
        severity="error",
        channel="current",
        message=(
            f"the voltage {begins} at {record.at(edge)} but no current flows for "
            f"{count} rows ({seconds:.4g} s), {until}"
        ),
        repair=(
            "no channel is used in these rows, and identify, validate and forecast take the voltage as 0 V there; "
            "clean or tighten the clamp before the next record"
        ),
        samples=((edge, came),),
        effect="mask",
        values={"edge_row": edge, "count": count, "seconds": seconds, "contact_row": came if came < end else None},
    )


def _flows(record: Record, channel: Channel, place: int) -> bool:
    """Whether a current that no reading shows above the noise flows all the same: the mean of the stretch says it."""
    edge, end = int(record.edges[place]), int(record.ends[place])
    known = channel.readings[edge:end]
    known = known[np.isfinite(known)]
    before = channel.readings[max(edge - _BEFORE, 0) : max(edge - GUARD_ROWS, 0)]
    before = before[np.isfinite(before)] if edge else np.zeros(1)
    if not len(known) or not len(before):
        return False
    error = channel.noise * math.sqrt(1.0 / len(known) + (1.0 / len(before) if edge else 0.0))
    rounding = 1e-9 * float(np.abs(known).max())
    return abs(float(known.mean() - before.mean())) > _SURELY * error + rounding
