"""Channels that are not read at the same time as the voltage."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.quality.record import GUARD_ROWS, Channel, IntArray, Record, ranges_of
from ipmclab.run import Finding, FloatArray

CODE: Final = "channel-skew"
"""Of the finding that a channel was not read with the voltage."""

_APART: Final = 7  # rows between edges: nearer ones mix their answers (convention)
_REST_ROWS: Final = 10  # rows before an edge whose mean is rest (convention)
_LARGE: Final = 0.3  # of the largest edge: smaller ones are not judged (convention)
_FARTHEST: Final = 25  # rows about an edge in which the jump of the current is looked for (convention)
_ALIKE: Final = 0.7  # part of the edges at which a channel has to be off by as many rows (convention)


def channel_skew(record: Record) -> list[Finding]:
    """``channel-skew`` and ``edge-reading-partial``.

    The current jumps with the voltage, so at each edge the first row in which it has moved (by a
    fifth of its change and six standard deviations of the noise) should be the row of the edge.
    Displacement and force answer smoothly and can only be found to lead: at the first edge after
    rest they must not have left their straight line before the edge does. Readings between the
    first move and the peak of the current, which hold neither the old nor the new state, are
    left out; so are those that a current takes early, where the hold says that the edge is at its row.
    A current that is farther off jumps as many rows after each edge, or before it (``far_off``).
    """
    found: list[Finding] = []
    for channel in record.channels.values():
        if channel.name == "current":
            rows, count = far_off(record)
            if rows:
                found.append(_skew(record, channel, rows, count, _between(record, record.edges, rows)))
                continue
            edges, moved = _edges_of_current(record, channel)
            if not len(edges):
                continue
            leads = _current_leads(channel, moved)
            found += _partial(record, channel, edges, moved)
        else:
            edges, leads = record.edges[:0], _first_lead(record, channel)
        values, counts = np.unique(leads, return_counts=True)
        if len(values) and counts.max() >= _ALIKE * len(leads) and values[counts.argmax()] != 0:
            lead = int(values[counts.argmax()])
            early = _early(record, edges, lead)
            found.append(_skew(record, channel, lead, len(leads), early))
    return found


def is_far_off(finding: Finding) -> bool:
    """Whether it says of a channel that it was read three rows or more before or after the voltage."""
    rows = finding.values.get("lead_rows")
    return finding.code == CODE and isinstance(rows, int) and abs(rows) >= GUARD_ROWS


def far_off(record: Record) -> tuple[int, int]:
    """By how many rows the current leads the voltage at how many edges, where these are three rows or more.

    At each edge with room it is the row in which the current jumps most, by a fifth of its range there and beyond its
    noise. No contact fails for as many rows at two edges and more.
    """
    channel = record.channels.get("current")
    edges, size = record.edges, np.abs(record.heights)
    if channel is None or len(edges) < 2:
        return 0, 0
    steps = np.abs(np.diff(channel.readings, prepend=np.nan))
    gaps = np.diff(edges, prepend=0, append=len(record))
    large, rooms = size >= _LARGE * size.max(), np.minimum(gaps[:-1], gaps[1:])
    leads = []
    for edge, room in zip(edges[large], rooms[large], strict=True):
        reach = min(_FARTHEST, (int(room) - 1) // 2)
        near = slice(edge - reach, edge + reach + 1)
        jumps, around = steps[near], channel.readings[near]
        if reach < GUARD_ROWS or not np.isfinite(jumps).any():
            continue
        place = int(np.nanargmax(jumps))
        if jumps[place] > max(10.0 * channel.noise, 0.2 * float(np.nanmax(around) - np.nanmin(around))):
            leads.append(reach - place)
    if len(leads) < 2:
        return 0, 0
    values, counts = np.unique(np.array(leads, dtype=np.intp), return_counts=True)
    lead = int(values[counts.argmax()])
    return (lead, len(leads)) if counts.max() >= _ALIKE * len(leads) and abs(lead) >= GUARD_ROWS else (0, 0)


def _between(record: Record, edges: IntArray, lead: int) -> IntArray:
    """Rows at which a current that is so many rows off is of another voltage than the record says."""
    rows: IntArray = (edges[:, None] + np.arange(min(-lead, 0), max(-lead, 0))).ravel()
    return np.unique(rows[(rows >= 0) & (rows < len(record))])


def _early(record: Record, edges: IntArray, lead: int) -> IntArray:
    """Rows of a current that were read after an edge which its voltage shows later.

    No strip draws a current before its voltage moves. Where the hold is unknown, identification finds when it moved.
    """
    return _between(record, edges, lead) if lead > 0 and record.run.hold != "unknown" else edges[:0]


def _edges_of_current(record: Record, channel: Channel) -> tuple[IntArray, FloatArray]:
    """Large edges after calm, with room, and the change of the current since four rows before each.

    The change is given from three rows before the edge to three after it. Calm is where the
    voltage has stood and the current has moved by less than half of what counts as a move.
    """
    edges, size = record.edges, np.abs(record.heights)
    inside = (edges >= _APART) & (edges < len(record) - _APART)
    if not inside.any():
        return edges[:0], np.zeros((0, 2 * GUARD_ROWS + 1))
    gaps = np.diff(edges, prepend=-len(record), append=2 * len(record))
    room = (gaps[:-1] >= _APART) & (gaps[1:] >= _APART)
    kept = room & inside & record.constant_after & (size >= _LARGE * size.max())
    edges, heights = edges[kept], size[kept]
    before = edges[:, None] - np.arange(2, _APART + 1)
    around = channel.readings[edges[:, None] + np.arange(-GUARD_ROWS - 1, GUARD_ROWS + 1)]
    moved: FloatArray = np.abs(around[:, 1:] - around[:, :1])
    with np.errstate(invalid="ignore"):
        stood = np.ptp(record.run.voltage[before], axis=1) < 0.1 * heights
        drifted = np.abs(channel.readings[edges - _APART] - around[:, 0])
        calm = stood & (drifted < 0.5 * np.maximum(6.0 * channel.noise, 0.1 * moved.max(axis=1)))
    return edges[calm], moved[calm]


def _current_leads(channel: Channel, moved: FloatArray) -> IntArray:
    peak = moved.max(axis=1)
    known = peak > 10.0 * channel.noise
    above = moved > np.maximum(6.0 * channel.noise, 0.2 * peak)[:, None]
    leads: IntArray = (GUARD_ROWS - above.argmax(axis=1))[known]
    return leads


def _first_lead(record: Record, channel: Channel) -> IntArray:
    none = np.zeros(0, dtype=np.intp)
    if not record.steps_from_rest:
        return none
    edge = int(record.edges[0])
    start = edge - GUARD_ROWS - _REST_ROWS
    if start < 0 or edge + 10 >= len(record):
        return none
    window = channel.readings[start : edge + 10]
    rest = window[:_REST_ROWS]
    place = np.arange(_REST_ROWS) - 0.5 * (_REST_ROWS - 1)
    slope = float(place.dot(rest)) / float(place.dot(place))
    expected = rest.mean() + slope * (np.arange(len(window)) - 0.5 * (_REST_ROWS - 1))
    away = np.abs(window - expected)[_REST_ROWS:]
    scatter = float(np.sqrt(((rest - expected[:_REST_ROWS]) ** 2).sum() / (_REST_ROWS - 2)))
    least = max(8.0 * scatter, 8.0 * channel.quantum, 0.01 * float(away.max()))
    early = np.flatnonzero(away[:GUARD_ROWS] > least)
    return np.array([GUARD_ROWS - early[0]] if len(early) else [0], dtype=np.intp)


def _skew(record: Record, channel: Channel, lead: int, edges: int, early: IntArray) -> Finding:
    which = "leads" if lead > 0 else "lags behind"
    rows = "one row" if abs(lead) == 1 else f"{abs(lead)} rows"
    shift = f"write rows_late = {-lead} under [channels.{channel.name}] of the import map"
    far = abs(lead) >= GUARD_ROWS
    doubtful = lead > 0 and not far and channel.name == "current" and record.run.hold != "unknown"
    return Finding(
        code=CODE,
        severity="error" if far and channel.name == "current" else "warning",  # no delay of the edges follows it
        channel=channel.name,
        message=(
            f"the {channel.name} {which} the voltage channel by {rows} ({abs(lead) * record.period:.4g} s), "
            f"measured at {edges} edge{'s' if edges > 1 else ''}"
            + (
                f", so it was not read with the voltage, or the hold {record.run.hold!r} is not right"
                if doubtful
                else ""
            )
        ),
        repair=(
            "the channels were not read at one time: "
            + (
                shift
                if far
                else f"identification estimates one delay of this run's edges, as its hold is unknown; {shift} where "
                "others lead by another"
                if record.run.hold == "unknown"
                else f"give the run the hold 'unknown', so that its edge delay is estimated, or {shift}"
            )
            + (
                f"; until then the readings {'before' if lead > 0 else 'after'} their edges are left out"
                if len(early)
                else ""
            )
        ),
        samples=ranges_of(early),
        effect="mask" if len(early) else "none",
        values={"lead_rows": lead, "lead_seconds": lead * record.period, "edges": edges},
    )


def _partial(record: Record, channel: Channel, edges: IntArray, moved: FloatArray) -> list[Finding]:
    peak = moved.max(axis=1)
    between = (moved > np.maximum(6.0 * channel.noise, 0.1 * peak)[:, None]) & (moved < 0.8 * peak[:, None])
    between &= np.arange(moved.shape[1]) < moved.argmax(axis=1)[:, None]
    rows = (edges[:, None] + np.arange(-GUARD_ROWS, GUARD_ROWS + 1))[between]
    if not len(rows):
        return []
    return [
        Finding(
            code="edge-reading-partial",
            severity="warning",
            channel=channel.name,
            message=(
                f"{len(rows)} readings at edges of the voltage hold neither the old nor the new current, the first at "
                f"{record.at(rows[0])} ({channel.show(float(channel.readings[rows[0]]))}, the peak follows)"
            ),
            repair="these rows are left out; they are old readings, or the voltage was changing while they were taken",
            samples=ranges_of(np.unique(rows)),
            effect="mask",
            values={"count": len(rows), "first_row": int(rows[0])},
        )
    ]
