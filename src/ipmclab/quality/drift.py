"""A response that moves, or a current that is not zero, before the voltage first moves."""

from __future__ import annotations

import math
from typing import Final

from ipmclab.confidence import NORMAL_95
from ipmclab.quality.noise import variance_for_means
from ipmclab.quality.record import GUARD_ROWS, NO_VOLTAGE, Channel, Record
from ipmclab.quality.rows_at_rest import rest_rows
from ipmclab.run import Finding, FloatArray
from ipmclab.units import CHANNELS

_FEWEST: Final = 20  # rows at 0 V through which a line is drawn (convention)
_STANDARD_ERRORS: Final = 5.0  # standard errors: one in 1.7 million by chance (convention)


def before_step(record: Record) -> list[Finding]:
    """``drift-before-step`` and ``offset-before-step``, from a straight line through the rows before the voltage moves.

    The standard errors count how the residuals follow each other. A drift needs a slope of
    five standard errors that carries the reading by one and a half standard deviations of the
    noise; it is a warning when, over the rest of the record, it would make a twentieth of the
    range. An offset is a mean current of five standard errors and a thousandth of the range.
    """
    stop = _rows_at_rest(record)
    if stop < _FEWEST - GUARD_ROWS:
        return []
    time = record.run.time[:stop] - record.run.time[:stop].mean()
    found = []
    for channel in record.channels.values():
        readings = channel.readings[:stop]
        if (channel.missing is not None and channel.missing[:stop].any()) or channel.span == 0.0:
            continue
        mean, slope, mean_error, slope_error = _line(time, readings)
        travelled = abs(slope) * float(time[-1] - time[0])
        visible = travelled > max(1.5 * channel.noise, 2.0 * channel.quantum)
        if slope_error > 0.0 and visible and abs(slope) > _STANDARD_ERRORS * slope_error:
            found.append(_drift(record, channel, slope, slope_error, stop))
        if channel.name == "current" and abs(mean) > max(_STANDARD_ERRORS * mean_error, 1e-3 * channel.span):
            found.append(_offset(channel, mean, mean_error, stop))
    return found


def _rows_at_rest(record: Record) -> int:
    """How many rows there are at 0 V before the first edge, or before a wave, which has none, begins to move."""
    if record.steps_from_rest:
        return int(record.edges[0]) - GUARD_ROWS
    stop = rest_rows(record.run) - GUARD_ROWS if record.excited else 0
    return stop if stop > 0 and abs(float(record.run.voltage[:stop].mean())) <= NO_VOLTAGE else 0


def _line(time: FloatArray, readings: FloatArray) -> tuple[float, float, float, float]:
    """Mean and slope of readings over times whose mean is zero, and the standard error of each."""
    sum_of_squares = float(time.dot(time))
    mean, slope = float(readings.mean()), float(time.dot(readings)) / sum_of_squares
    variance = variance_for_means(readings - mean - slope * time, 2)
    return mean, slope, math.sqrt(variance / len(time)), math.sqrt(variance / sum_of_squares)


def _drift(record: Record, channel: Channel, slope: float, error: float, stop: int) -> Finding:
    remaining = float(record.run.time[-1] - record.run.time[stop])
    share = abs(slope) * remaining / channel.span
    quantity = CHANNELS[channel.name]
    return Finding(
        code="drift-before-step",
        severity="warning" if share > 0.05 else "info",
        channel=channel.name,
        message=(
            f"before the voltage moves the {channel.name} drifts by {quantity.to_display(slope):.3g} ± "
            f"{quantity.to_display(NORMAL_95 * error):.2g} {quantity.display_unit}/s (95 %); over the rest of the "
            f"record that would be {channel.show(slope * remaining)}, {100 * share:.3g} % of its range"
        ),
        repair=(
            "identification fits a drift of this channel together with the parameters; better, wait until the strip is "
            "at rest before the voltage moves"
        ),
        samples=((0, stop),),
        values={"slope": slope, "standard_error": error, "share_of_range": share},
    )


def _offset(channel: Channel, mean: float, error: float, stop: int) -> Finding:
    return Finding(
        code="offset-before-step",
        severity="warning",
        channel=channel.name,
        message=(
            f"before the voltage moves the current reads {channel.show(mean)} ± "
            f"{channel.show(NORMAL_95 * error)} (95 %) instead of zero"
        ),
        repair=(
            "identification fits an offset of this run together with the parameters; better, set the zero of the "
            "current in the import map or the rig file"
        ),
        samples=((0, stop),),
        values={"offset": mean, "standard_error": error},
    )
