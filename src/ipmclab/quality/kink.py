"""A response whose rate jumps while the voltage is constant: no smooth model follows it."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.quality.record import GUARD_ROWS, Channel, Record
from ipmclab.run import Finding, FloatArray
from ipmclab.units import CHANNELS

RATE_ROWS: Final = 10
"""Rows through which a rate is taken (convention)."""

_LEAST: Final = 10.0  # times the usual change of the rate that a kink has (convention)
_OVER_BEFORE: Final = 3.0  # times the largest change before it that a kink has (convention)
_SHORTEST: Final = 12 * RATE_ROWS  # rows at one voltage: twelve rates (convention)
_FADED: Final = 0.1  # part of the kink: a rate that near to the usual one has returned (convention)


def rate_jumps(record: Record) -> list[Finding]:
    """``rate-jump``: the rate of displacement or force jumps at constant voltage.

    The slope of a straight line through ten rows is compared with that through the ten rows before. Their difference
    must exceed ten robust standard deviations of such differences on the stretch, and three times the largest of
    them on the second half of the time that has passed since the voltage edge: what answers to an edge bends less
    and less. A jump of the reading itself is a slip, not this. The rows from there until the rate has faded to a
    tenth of its jump are left out; a rate that stays is only reported.
    """
    found = []
    for channel in record.channels.values():
        if channel.name == "current" or len(channel.values) < _SHORTEST:
            continue
        for edge, end, constant in zip(record.edges, record.ends, record.constant_after, strict=True):
            if constant and end - edge >= _SHORTEST:
                finding = _first(record, channel, int(edge) + GUARD_ROWS, int(end))
                if finding is not None:
                    found.append(finding)
    return found


def _first(record: Record, channel: Channel, start: int, end: int) -> Finding | None:
    """The largest jump of the rate between two rows, where it is one."""
    readings, period = channel.readings[start:end], record.period
    place = np.arange(RATE_ROWS) - 0.5 * (RATE_ROWS - 1)
    slopes = np.convolve(readings, place[::-1] / (place @ place), mode="valid") / period
    jumps = slopes[RATE_ROWS:] - slopes[:-RATE_ROWS]  # entry k: between the rows k + RATE_ROWS - 1 and k + RATE_ROWS
    size = np.abs(jumps)
    known = np.isfinite(size)
    if np.count_nonzero(known) < _SHORTEST // 2:
        return None
    of_noise = channel.noise * np.sqrt(2.0 / (place @ place)) / period
    of_rounding = np.finfo(float).eps * float(np.nanmax(np.abs(readings))) / period  # of a constant reading, too
    of_sensor = max(float(of_noise), channel.quantum / (RATE_ROWS * period))
    usual = max(1.4826 * float(np.median(size[known])), of_sensor, of_rounding)
    for top in np.argsort(np.where(known, -size, 0.0))[:RATE_ROWS]:
        if size[top] <= _LEAST * usual:
            return None
        row = int(top) + RATE_ROWS
        before = size[row // 2 : max(int(top) - 2 * RATE_ROWS, 0)]
        before = before[np.isfinite(before)]
        if len(before) < RATE_ROWS or size[top] < _OVER_BEFORE * before.max():
            continue
        near = readings[row - RATE_ROWS : row + RATE_ROWS]
        fastest = max(abs(float(slopes[top])), abs(float(slopes[top + RATE_ROWS]))) * period
        if np.abs(np.diff(near)).max() > 4.0 * fastest + 8.0 * channel.noise + 2.0 * channel.quantum:
            continue  # the reading itself jumps
        return _finding(record, channel, start, row, slopes, int(top), usual)
    return None


def _finding(
    record: Record, channel: Channel, start: int, row: int, slopes: FloatArray, top: int, usual: float
) -> Finding:
    before, after = float(slopes[top]), float(slopes[top + RATE_ROWS])
    height = after - before
    faded = np.flatnonzero(
        np.abs(slopes[top + RATE_ROWS :] - 0.5 * (np.median(slopes) + before)) < _FADED * abs(height)
    )
    stop = row + int(faded[0]) + RATE_ROWS // 2 if len(faded) else row + 1
    quantity = CHANNELS[channel.name]
    unit = f"{quantity.display_unit}/s"
    return Finding(
        code="rate-jump",
        severity="warning",
        channel=channel.name,
        message=(
            f"at constant voltage the rate of the {channel.name} jumps from {quantity.to_display(before):.3g} to "
            f"{quantity.to_display(after):.3g} {unit} at {record.at(start + row)}, "
            f"{abs(height) / usual:.3g} times what it changes by elsewhere: no smooth model "
            "follows that"
        ),
        repair=(
            ("the rows until it has faded are left out; " if len(faded) else "use the part before it; ")
            + "look at the current there (a contact that came back?), and for what touched the strip"
        ),
        samples=((start + row, min(start + stop, len(record))),),
        effect="mask" if len(faded) else "none",
        values={
            "row": start + row,
            "before": before,
            "after": after,
            "usual_change": usual,
        },
    )
