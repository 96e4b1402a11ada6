"""Whether the ranges of a rig fit what a strip will give, and how old its calibrations are."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from ipmclab.model.stages.circuit import CONTACT
from ipmclab.rig.channels import Channel, Rig
from ipmclab.rig.files.rig_file import NI_9205_NOISE
from ipmclab.run import Finding

if TYPE_CHECKING:
    from ipmclab.model import Actuator

FILL: Final = 0.8
"""How much of its range a signal may take: what is expected is not what comes."""

CALIBRATION_DAYS: Final = 365

_SCALE_TOLERANCE: Final = 0.05


def expected_peak(rig: Rig, actuator: Actuator, amplitude: float) -> float:
    """The current [A] that an edge of some volts draws at most: V / (2 R_e + contacts + shunt + source).

    Where the contacts feed a part of the membrane at once, what the strip draws at once takes the place of 2 R_e.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> round(1e3 * expected_peak(THESIS_RIG, load_actuator("friend-2"), 1.0), 1)
    58.8
    """
    if actuator.structure.clamp or actuator.structure.line:
        # Some of the membrane is fed past the electrodes: nothing draws more than at once, with all capacitors empty.
        strip = 1.0 / float(actuator.system.d[0, 0])
    else:
        strip = 2.0 * actuator.circuit_elements().electrode.real + actuator[CONTACT]
    return amplitude / (strip + rig.shunt_resistance + rig.source_resistance)


def ranges(rig: Rig, amplitude: float, peak: float) -> Iterator[Finding]:
    """Whether the range of each channel fits what is expected of it: an amplitude [V], a peak current [A]."""
    if amplitude > rig.output.high or -amplitude < rig.output.low:
        yield Finding(
            "output-range",
            "error",
            f"{amplitude:g} V of both polarities are beyond the output, "
            f"which gives {rig.output.low:g} V to {rig.output.high:g} V",
            "take a smaller amplitude",
            values={"amplitude": amplitude},
        )
    yield from _amplifier(rig, peak)
    for channel in rig.channels:
        if channel.name == "voltage":
            yield from _fits(channel, amplitude, f"{amplitude:g} V")
        elif channel.name == "current":
            what = (
                f"{2e3 * peak:.3g} mA at a polarity reversal, twice the {1e3 * peak:.3g} mA of an edge of "
                f"{amplitude:g} V,"
            )
            yield from _fits(channel, 2.0 * peak, what)
            yield from _shunt(channel, rig.shunt_resistance)
        elif channel.sensor_range is not None:
            yield from _whole_sensor(channel, channel.sensor_range)


def _amplifier(rig: Rig, peak: float) -> Iterator[Finding]:
    """Whether the amplifier delivers the current of an edge [A], and of a polarity reversal, which is twice that."""
    most = rig.output.current_limit
    if most is None or 2.0 * peak <= most:
        return
    alone = peak > most
    current, when = (peak, "an edge") if alone else (2.0 * peak, "a polarity reversal")
    wanted, given = f"{1e3 * current:.3g} mA", f"{1e3 * most:.3g} mA"
    yield Finding(
        "amplifier-limit",
        "error" if alone else "warning",
        f"{when} draws {wanted}, the amplifier delivers {given}: it would not hold its voltage",
        "take a smaller amplitude, or a stronger amplifier",
        values={"expected": current, "limit": most},
    )


def _fits(channel: Channel, expected: float, what: str) -> Iterator[Finding]:
    """Whether a signal to both sides stays below ``FILL`` of the range."""
    ends = [abs((value - channel.offset) / channel.gain) for value in (-expected, expected)]
    volts, high = max(ends), channel.converter.high
    if volts <= FILL * high:
        return
    fitting = next((one for one in NI_9205_NOISE if volts <= FILL * one), None)
    if fitting is not None:
        repair = f'write range = ["-{fitting:g} V", "{fitting:g} V"]'
        if channel.name == "current":
            repair += f", whose noise is {1e3 * abs(channel.gain) * NI_9205_NOISE[fitting]:.2g} mA"
    else:
        repair = "take a smaller amplitude, or a smaller shunt" if channel.name == "current" else "take a divider"
    yield Finding(
        "range-too-small",
        "error" if volts > high else "warning",
        f"{what} give{'s' if channel.name == 'voltage' else ''} {volts:.3g} V at the input, "
        f"more than {100 * FILL:.0f} % of its range of ±{high:g} V",
        repair,
        channel.name,
        values={"expected": expected, "volts": volts, "range": high},
    )


def _shunt(channel: Channel, shunt: float) -> Iterator[Finding]:
    if not shunt:
        return
    amplified = abs(channel.gain) * shunt
    if abs(amplified - 1.0) > _SCALE_TOLERANCE:
        yield Finding(
            "scale-differs-from-shunt",
            "warning",
            f"the scale says {abs(channel.gain):.4g} A for 1 V, the shunt of {shunt:g} ohm says {1 / shunt:.4g} A",
            "correct one of them, unless there is an amplifier in between",
            channel.name,
            values={"gain": channel.gain, "shunt_resistance": shunt},
        )


def _whole_sensor(channel: Channel, sensor: tuple[float, float]) -> Iterator[Finding]:
    volts = max(abs((end - channel.offset) / channel.gain) for end in sensor)
    if volts > channel.converter.high * 1.001:  # the top code is one step below the range
        yield Finding(
            "range-too-small",
            "warning",
            f"the sensor gives up to {volts:.3g} V, its input reads up to {channel.converter.high:g} V",
            "take a larger range: what is beyond it is read as its end",
            channel.name,
            values={"volts": volts, "range": channel.converter.high},
        )


def calibrations(rig: Rig, today: datetime.date) -> Iterator[Finding]:
    """Channels whose calibration is missing or old."""
    missing = [channel.name for channel in rig.channels if channel.calibrated is None]
    if missing:
        yield Finding(
            "no-calibration",
            "info",
            f"no date of calibration is stated for {', '.join(missing)}",
            'calibrate against a reference and add calibrated = "YYYY-MM-DD" and uncertainty to each',
        )
    for channel in rig.channels:
        if channel.calibrated is None:
            continue
        days = (today - datetime.date.fromisoformat(channel.calibrated)).days
        if days > CALIBRATION_DAYS:
            yield Finding(
                "old-calibration",
                "warning",
                f"it was calibrated {days} days ago, on {channel.calibrated}",
                "calibrate it again: load cells and lasers are good for a year",
                channel.name,
                values={"days": days},
            )
