"""Whether a channel answers to the voltage at all, and in the right direction."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ipmclab.quality.record import Channel, Record
from ipmclab.quality.scatter import scatter_of
from ipmclab.run import Finding

_BLOCKS: Final = 50  # means of a record that are compared (convention)
_WINDOWS: Final = (5, 20, 80, 320)  # rows of moving means, each four times the last (convention)
_SURELY: Final = 8.0
"""Standard errors by which the mean of a current differs from zero that is none of its noise (convention)."""
_UNLOADED: Final = 4.0
"""A load cell that reads within so many times its noise of the lower end of its range is not pressed (convention)."""
_SLOW: Final = 0.2
"""Below this frequency [Hz] an actuator follows the voltage with less than 135 degrees of lag (convention)."""


def no_excitation(record: Record) -> list[Finding]:
    """``no-excitation``: the voltage stays within 10 mV of zero."""
    if record.excited:
        return []
    return [
        Finding(
            code="no-excitation",
            severity="warning",
            channel="voltage",
            message=f"the voltage never exceeds {1e3 * float(np.abs(record.run.voltage).max()):.3g} mV",
            repair=(
                "a baseline shows drift and noise, a push the stiffness, a flick the resonance; no circuit and no "
                "coupling can be identified from it"
            ),
            values={"largest": float(np.abs(record.run.voltage).max())},
        )
    ]


def nothing_but_noise(record: Record) -> list[Finding]:
    """``noise-only``: a channel that varies no more than its noise, or by less than two of its quanta.

    The means of fifty blocks differ by less than six standard errors (or two quanta), and the
    readings are correlated neither with the voltage nor with its slope. A current under a constant voltage whose mean
    is eight standard errors from zero has settled, and is more than noise.
    """
    if not record.excited:
        return []
    return [
        _of_noise(channel, unloaded=_is_unloaded(record, channel))
        for channel in record.channels.values()
        if len(channel.values) >= 4 * _BLOCKS and _is_noise(record, channel)
    ]


def _of_noise(channel: Channel, *, unloaded: bool) -> Finding:
    repair = "check that its instrument was connected and in range"
    if unloaded:
        message = (
            f"no force is seen: the load cell reads {channel.show(float(np.mean(channel.values)))}, "
            f"the lower end of its range, with noise of {channel.show(channel.noise)}"
        )
        repair = "is the tip on the cell?"
    elif channel.high > channel.low:
        message = (
            f"the {channel.name} holds nothing but noise, {channel.show(channel.noise)}, "
            f"from {channel.show(channel.low)} to {channel.show(channel.high)}"
        )
    else:
        message = f"the {channel.name} reads {channel.show(channel.high)} in every row"
    return Finding(
        code="noise-only",
        severity="warning",
        channel=channel.name,
        message=message,
        repair=f"do not identify from this channel; {repair}",
        values={"noise": channel.noise, "low": channel.low, "high": channel.high, "unloaded": unloaded},
    )


def _is_unloaded(record: Record, channel: Channel) -> bool:
    """Whether readings that are noise are those of a load cell that nothing presses: it can only be pushed."""
    lower = record.run.metadata.ranges.get("force", (-math.inf, math.inf))[0]
    return channel.name == "force" and abs(float(np.mean(channel.values)) - lower) <= _UNLOADED * channel.noise


def opposite_response(record: Record) -> list[Finding]:
    """``response-opposite``: the answer has the wrong sign.

    At positive voltage the current is positive (a passive strip takes power) and the
    displacement and the force are towards the anode, which is positive. Judged at the first
    edge from rest, where the answer is ten standard errors clear of the noise; without such an edge
    by the power (current), or by the correlation with a voltage slower than 0.2 Hz.
    """
    if not record.excited:
        return []
    found = []
    for channel in record.channels.values():
        sign = _sign(record, channel)
        if sign >= 0:
            continue
        reversed_drive = record.run.metadata.polarity == "reversed"
        found.append(
            Finding(
                code="response-opposite",
                severity="info" if reversed_drive else "error",
                channel=channel.name,
                message=(
                    f"the {channel.name} goes the wrong way: at positive voltage it "
                    + (
                        "is negative, and no passive strip gives power"
                        if channel.name == "current"
                        else "goes away from the anode"
                    )
                    + (", as the reversed polarity of the run explains" if reversed_drive else "")
                ),
                repair="reverse the sign of this channel (or of the voltage) in the import map or the rig file",
            )
        )
    return found


def _is_noise(record: Record, channel: Channel) -> bool:
    values = channel.values
    centred = values - float(values.mean())
    scatter = math.sqrt(float(centred.dot(centred)) / len(values))
    quantum = channel.quantum
    if scatter > max(1.3 * channel.noise, 0.6 * quantum):
        return False
    error = max(channel.noise, scatter) / math.sqrt(len(values))
    if channel.name == "current" and record.shows_no_edge and abs(float(values.mean())) > _SURELY * error:
        return False  # one that has settled
    rows = len(values) // _BLOCKS
    means = centred[: rows * _BLOCKS].reshape(_BLOCKS, rows).mean(axis=1)
    range_of_means = float(np.ptp(means))
    if range_of_means > max(6.0 * channel.noise / math.sqrt(rows), 2.0 * quantum):
        return False
    if range_of_means <= 2.0 * quantum:
        return True
    voltage = record.run.voltage[channel.rows]
    # A fast response is late by up to a quarter of a period: then it goes with the slope of the voltage.
    causes = (voltage - voltage.mean(), voltage[1:] - voltage[:-1])
    return not any(
        abs(float(cause.dot(centred[: len(cause)]))) > 5.0 * scatter * math.sqrt(float(cause.dot(cause)))
        for cause in causes
    )


def _sign(record: Record, channel: Channel) -> int:
    if record.steps_from_rest:
        return _sign_at_edge(record, channel)
    voltage = record.run.voltage[channel.rows]
    if channel.name == "current":
        if record.run.metadata.starts_from_rest is False:
            return 0
        power = float(voltage.dot(channel.values))
        return -1 if power < -10.0 * channel.noise * math.sqrt(float(voltage.dot(voltage))) else 0
    voltage = voltage - voltage.mean()
    turns = np.count_nonzero(voltage[1:] * voltage[:-1] < 0.0)
    if turns < 1 or turns / (2.0 * len(voltage) * record.period) > _SLOW:
        return 0
    centred = channel.values - channel.values.mean()
    product = math.sqrt(float(voltage.dot(voltage)) * float(centred.dot(centred)))
    return -1 if product > 0.0 and float(voltage.dot(centred)) < -0.7 * product else 0


def _sign_at_edge(record: Record, channel: Channel) -> int:
    edge, end = int(record.edges[0]), int(record.ends[0])
    # Where a reading is missing, what moved is NaN, which is beyond nothing.
    rest = channel.readings[max(edge - 8, 0) : max(edge - 3, 1)]
    if channel.name == "current":
        window = channel.readings[max(edge - 3, 0) : min(edge + 4, end)]
        before = 0.0 if edge == 0 else float(rest.mean())
        moved = float(window[np.abs(window - before).argmax()]) - before
        return int(np.sign(moved * record.heights[0])) if abs(moved) > 10.0 * channel.noise else 0
    before = float(rest.mean())
    scatter = scatter_of(record, channel)
    for rows in _WINDOWS:
        window = channel.readings[edge + 1 : edge + 1 + rows]
        if rows > end - edge:
            return 0
        moved = float(window.mean()) - before
        error = math.hypot(scatter.of_mean(rows), scatter.of_mean(len(rest)))
        if abs(moved) > 10.0 * error + channel.quantum:
            return int(np.sign(moved * record.heights[0]))
    return 0
