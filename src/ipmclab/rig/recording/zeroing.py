"""What the channels read at rest: read before and after a run, kept with the data, never edited into it.

A force needs two zeros. The tare is read with the tip clear of the load cell, the preload with the tip on it at 0 V,
once it has stopped drifting; the force is the reading less the preload. What preload and zeros change by during a run
is part of its uncertainty: the preload is as large as the signal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import Bench
from ipmclab.rig.channels import Channel, Rig
from ipmclab.rig.safety.guard import Guard
from ipmclab.rig.safety.guarded_bench import output_stuck
from ipmclab.rig.safety.limits import Limits
from ipmclab.rig.safety.own_clock import OPENING, own_pauses_reported
from ipmclab.rig.scaling import Scaling
from ipmclab.run import SLOW_CHANNELS, ZeroReading
from ipmclab.signals import Step

FloatArray = npt.NDArray[np.float64]

Kind = Literal["zero", "tare", "preload"]
When = Literal["before", "after"]

ZERO_TIME: Final = 10.0
"""How long [s] the channels are read at rest."""

LONGEST_WAIT: Final = 600.0
"""How long [s] a preload may take to settle."""

LEAST_ROWS: Final = 3
"""A reading at rest has so many rows at least: fewer show neither its noise nor its drift."""

NOISE_MARGIN: Final = 4.0
"""A reading within so many standard deviations of its noise above the tare is one without contact."""


@dataclass(frozen=True)
class Rest:
    """The channels at rest.

    Parameters
    ----------
    zeros : tuple of ZeroReading
        One for each channel that was read.
    noise : mapping of channel to float [SI unit of the channel]
        Standard deviation of a single reading around its drift.
    ends : mapping of channel to (first, last, deviation) [SI unit of the channel]
        Its means over the first and the last fifth of the reading, and the standard deviation of such a mean.
    """

    zeros: tuple[ZeroReading, ...]
    noise: Mapping[str, float]
    ends: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def __getitem__(self, channel: str) -> ZeroReading:
        return next(zero for zero in self.zeros if zero.channel == channel)


def read_rest(
    bench: Bench,
    names: Collection[str],
    rate: float,
    *,
    when: When,
    duration: float = ZERO_TIME,
    force: Kind = "preload",
    on_block: Callable[[], None] | None = None,
) -> Rest:
    """Read channels with the output at 0 V.

    Parameters
    ----------
    bench : Bench
        Open, with these channels and this rate.
    names : collection of str
    rate : float [Hz]
    when : "before" or "after"
        The signal.
    duration : float [s]
        For ``LEAST_ROWS`` rows at least.
    force : "preload" or "tare"
        Whether the tip is on the load cell.
    on_block : callable, optional
        Called after each block; what it raises ends the reading.

    Raises
    ------
    IpmclabError
        A sensor that sees no strip; rows that were lost, so that too few are left.
    BenchError
        The output is not at 0 V, or the hardware failed.
    """
    guard = Guard(Limits(), rate, bench.rig)
    guard.zeroed(-1)
    plain = Scaling([bench.rig[name] for name in names if name in ("voltage", "current")], {})
    blocks = []
    with own_pauses_reported("while the channels were read at 0 V") as clock:
        for block in bench.apply(Step(0.0), max(LEAST_ROWS, round(duration * rate))):
            clock.progress()
            alarms = guard.look(block.first_row, plain.values(block.readings)) if "voltage" in names else ()
            if alarms:
                raise output_stuck(alarms[0])
            blocks.append(block)
            if on_block is not None:
                on_block()
    zeros, noise, ends = [], {}, {}
    for name in names:
        if name in SLOW_CHANNELS:
            continue
        channel = bench.rig[name]
        volts = np.concatenate([block.readings[name] for block in blocks])
        kind: Kind = force if name == "force" else "zero"
        zero, noise[name] = _summary(channel, volts, rate, kind, when)
        zeros.append(zero)
        ends[name] = _ends(channel, volts)
    return Rest(tuple(zeros), noise, ends)


def read_tare(bench: Bench, rate: float, *, when: When, duration: float = ZERO_TIME) -> ZeroReading:
    """Read the load cell with the tip clear of it.

    Parameters
    ----------
    bench : Bench
        Closed; it is opened for this, and closed again.
    rate : float [Hz]
    when : "before" or "after"
    duration : float [s]

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.rig.virtual import VirtualBench
    >>> bench = VirtualBench(load_actuator("friend-2"))
    >>> bench.operate("tip clear")
    >>> tare = read_tare(bench, 50.0, when="before")
    >>> tare.kind, abs(tare.value) < 0.1e-3
    ('tare', True)
    """
    names = ("voltage", "force")
    with own_pauses_reported(OPENING):
        bench.open(names, rate)
    try:
        return read_rest(bench, names, rate, when=when, duration=duration, force="tare")["force"]
    finally:
        bench.close()


def wait_for_preload(
    bench: Bench,
    names: Collection[str],
    rate: float,
    *,
    most_drift: float,
    duration: float = ZERO_TIME,
    longest_wait: float = LONGEST_WAIT,
    on_reading: Callable[[ZeroReading], None] | None = None,
    on_block: Callable[[], None] | None = None,
) -> Rest:
    """Read channels at 0 V again and again, until the preload of the load cell no longer drifts.

    Parameters
    ----------
    bench : Bench
        Open, with these channels and this rate.
    names : collection of str
        ``"force"`` among them.
    rate : float [Hz]
    most_drift : float [N/s]
        A preload that changes more slowly has settled.
    duration : float [s]
        Of each reading.
    longest_wait : float [s]
    on_reading : callable of ZeroReading, optional
        Called with each preload.
    on_block : callable, optional
        Called after each block; what it raises ends the waiting.

    Returns
    -------
    rest : Rest
        The last reading.

    Raises
    ------
    IpmclabError
        It still drifts after the longest wait.
    """
    waited, each = 0.0, max(duration, LEAST_ROWS / rate)
    while True:
        rest = read_rest(bench, names, rate, when="before", duration=duration, on_block=on_block)
        waited += each
        preload = rest["force"]
        if on_reading is not None:
            on_reading(preload)
        assert preload.drift is not None
        if abs(preload.drift) <= most_drift:
            return rest
        if waited + each > longest_wait * (1.0 + 1e-9):  # sums of times are rounded
            raise IpmclabError(
                f"the preload still drifts by {1e6 * preload.drift:.3g} uN/s after {waited:g} s, "
                f"{1e6 * most_drift:.3g} uN/s are allowed",
                code="preload-drifts",
                where="force",
                repair="let the strip come to equilibrium with the air, or allow more drift",
            )


def is_discharged(rig: Rig, rest: Rest) -> bool | None:
    """Whether the strip was discharged when its reading at rest ended.

    Parameters
    ----------
    rig : Rig
    rest : Rest

    Returns
    -------
    discharged : bool or None
        True where the current ended within its noise and one step of its converter of zero; False where it was
        larger at the beginning, as that of a discharge is. None where it is constant away from zero, which may as well
        be an offset of the converter, and where no current was read.
    """
    if "current" not in rest.ends:
        return None
    channel = rig["current"]
    first, last, deviation = rest.ends["current"]
    doubt = NOISE_MARGIN * deviation + channel.converter.step * abs(channel.gain)
    if abs(last) <= doubt:
        return True
    return False if math.copysign(1.0, last) * (first - last) > doubt else None


def subtracted(rig: Rig, rest: Rest) -> dict[str, float]:
    """What is subtracted from each channel [SI]: its reading at rest where it is zeroed, else nothing."""
    return {zero.channel: zero.value if rig[zero.channel].zeroed else 0.0 for zero in rest.zeros}


def contact_levels(rig: Rig, rest: Rest, tares: Sequence[ZeroReading]) -> dict[str, float]:
    """The reading of the load cell [N], before zeroing, up to which the tip does not press.

    That is the tare with a margin for noise. Without a tare it is the lower end of the sensor, where the preload shows
    that this is the reading without contact.

    Raises
    ------
    IpmclabError
        With a tare: the tip does not press on the load cell.
    """
    if "force" not in rest.noise:
        return {}
    preload, margin = rest["force"].value, NOISE_MARGIN * rest.noise["force"]
    known = [tare.value for tare in tares if tare.channel == "force" and tare.kind == "tare"]
    sensor_range = rig["force"].sensor_range
    if known:
        level = known[-1] + margin
        if preload <= level:
            raise IpmclabError(
                f"the load cell reads {1e3 * preload:.3g} mN, {1e3 * known[-1]:.3g} mN with the tip clear of it: "
                "the tip does not press",
                code="no-preload",
                where="force",
                repair="bring the load cell against the tip, to a preload of some millinewtons (a stand-in: the line "
                "'tip on cell' to ipmclab rig serve --hands), or record without a tare: --answer zero=skip",
            )
        return {"force": level}
    if sensor_range is None or preload <= sensor_range[0] + 2.0 * margin:
        return {}
    return {"force": sensor_range[0] + margin}


def uncertainties(channels: Iterable[Channel], zeros: Iterable[ZeroReading]) -> dict[str, float]:
    """The standard uncertainty of the zero and the scale of each channel [SI].

    It joins that of the calibration, that of the reading at rest, and what the reading at rest changed by during the
    run: when it changed is not known, so the error is taken as evenly distributed between none of the change and all
    of it, which is change/sqrt(3). What is not subtracted has no part in it: a current after a run is that of the
    discharge.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> before = ZeroReading("force", "preload", "before", 4.5e-3, 0.0)
    >>> after = ZeroReading("force", "preload", "after", 4.2e-3, 0.0)
    >>> round(uncertainties([THESIS_RIG["force"]], [before, after])["force"], 9)
    0.000173205
    """
    known = list(zeros)
    found = {}
    for channel in channels:
        of_channel = [zero for zero in known if zero.channel == channel.name]
        parts = [channel.uncertainty]
        for kind in {zero.kind for zero in of_channel}:
            before = [zero for zero in of_channel if zero.kind == kind and zero.when == "before"]
            after = [zero for zero in of_channel if zero.kind == kind and zero.when == "after"]
            # The tare shows where there is no contact: its change is that of the sensor, and so in the preload too.
            if kind == "tare" or not channel.zeroed:
                continue
            if before:
                parts.append(before[-1].standard_uncertainty)
            if before and after:
                parts.append((after[-1].value - before[-1].value) / math.sqrt(3.0))
        combined = math.hypot(*parts)
        if combined > 0.0:
            found[channel.name] = combined
    return found


def _ends(channel: Channel, volts: FloatArray) -> tuple[float, float, float]:
    """Means over the first and the last fifth, and the standard deviation of one, from the scatter in both."""
    scaled = channel.gain * volts + channel.offset
    count = max(1, len(scaled) // 5)
    first, last = scaled[:count], scaled[-count:]
    # Of neighbours, so that a discharge does not count as noise.
    steps = np.concatenate([np.diff(first), np.diff(last)])
    deviation = math.sqrt(float(np.mean(steps**2)) / 2.0 / count) if len(steps) else 0.0
    return float(first.mean()), float(last.mean()), deviation


def _summary(channel: Channel, volts: FloatArray, rate: float, kind: Kind, when: When) -> tuple[ZeroReading, float]:
    """What a channel read at rest, and the noise of a single reading."""
    if channel.is_lost(volts).any():
        raise IpmclabError(
            "the strip at rest is not in the range of the sensor",
            code="no-reading-at-rest",
            where=channel.name,
            repair="bring the strip into the middle of its range",
        )
    value = channel.to_quantity(float(np.mean(volts)))
    scaled = channel.gain * volts + channel.offset
    count = len(volts)
    if count < LEAST_ROWS:
        raise IpmclabError(
            f"{count} rows were read at rest, {LEAST_ROWS} are needed",
            code="too-short",
            where=channel.name,
            repair="rows were lost: give this computer less to do, then record again",
        )
    time = (np.arange(count) - (count - 1) / 2.0) / rate
    slope = float(time @ scaled) / float(time @ time)
    left = scaled - scaled.mean() - slope * time
    noise = math.sqrt(float(left @ left) / (count - 2))
    return ZeroReading(channel.name, kind, when, value, noise / math.sqrt(count), slope), noise
