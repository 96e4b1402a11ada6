"""Waiting, at 0 V, until the air around the strip is what it shall be and has been so for long enough."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.bench import Bench, Block
from ipmclab.rig.chambers.watch import ChamberWatch
from ipmclab.rig.experiments.environments import TargetEnvironment
from ipmclab.rig.safety.limit import shown
from ipmclab.rig.safety.limits import Limits
from ipmclab.signals import Step
from ipmclab.units import CHANNELS

FloatArray = npt.NDArray[np.float64]

RATE: Final = 2.0
"""Readings a second [Hz]: the air changes within minutes."""

_SMOOTHED: Final = 10.0
"""Readings are averaged over so long [s]: a sensor's noise is no change of the air."""


@dataclass(frozen=True)
class Air:
    """What was read of the air around the strip.

    Parameters
    ----------
    time : float [s]
        Since the waiting began.
    settled_for : float [s]
        How long every reading has been within its tolerance.
    temperature : float [degC], optional
    relative_humidity : float [percent], optional
    target : TargetEnvironment, optional
        What they shall be.

    Examples
    --------
    >>> wanted = TargetEnvironment(40.0, None, 1.0, 3.0, 1800.0, 10800.0)
    >>> str(Air(500.0, 0.0, temperature=22.0, target=wanted))
    '22.0 degC (outside 40 +- 1), waited 500 of at most 10800 s'
    """

    time: float
    settled_for: float
    temperature: float | None = None
    relative_humidity: float | None = None
    target: TargetEnvironment | None = None

    def __str__(self) -> str:
        """The readings for people."""
        parts = []
        if self.temperature is not None:
            parts.append(f"{self.temperature:.1f} degC{self._beside('temperature')}")
        if self.relative_humidity is not None:
            parts.append(f"{self.relative_humidity:.1f} %RH{self._beside('relative_humidity')}")
        waited = [] if self.target is None else [f"waited {self.time:.0f} of at most {self.target.longest_wait:g} s"]
        return ", ".join([*(parts or ["no reading yet"]), *waited])

    def _beside(self, name: str) -> str:
        """What a reading shall be, and whether it is."""
        wanted = getattr(self.target, name, None)
        if self.target is None or wanted is None:
            return ""
        allowed = self.target.allowed[name]
        where = "within" if abs(getattr(self, name) - wanted) <= allowed else "outside"
        return f" ({where} {wanted:g} +- {allowed:g})"


def wait_for_equilibrium(
    bench: Bench,
    target: TargetEnvironment,
    watched: Collection[str],
    on_air: Callable[[Air], bool],
    *,
    chamber: ChamberWatch | None = None,
    limits: Limits | None = None,
    settle: float | None = None,
) -> Air:
    """Read temperature and humidity until they have been within tolerance for ``target.settle``.

    The output stays at 0 V all the while. A reading is the mean over 10 s; that of a sensor at the strip counts, and
    that of the chamber's own where there is none. One that leaves its tolerance begins the time again.

    Parameters
    ----------
    bench : Bench
        Closed.
    target : TargetEnvironment
    watched : collection of str
        ``"temperature"`` and ``"relative_humidity"``, as far as the rig can read them.
    on_air : callable
        Called with every reading; true ends the waiting.
    chamber : ChamberWatch, optional
        Read meanwhile.
    limits : Limits, optional
        Air beyond them ends the waiting too.
    settle : float [s], optional
        In the place of ``target.settle``.

    Returns
    -------
    air : Air
        The last reading.

    Raises
    ------
    InputError
        Not settled within ``target.longest_wait``.
    IpmclabError
        Air beyond its limits.
    ChamberError
        The chamber does not answer, raises an alarm, or does what nobody asked of it.
    BenchError
        The hardware failed.
    """
    channels = {channel.name for channel in bench.rig.channels}
    measured = ["voltage", *(name for name in watched if name in channels)]
    lasts = target.settle if settle is None else settle
    wanted = {name: getattr(target, name) for name in watched}
    allowed = target.allowed
    recent: dict[str, list[tuple[float, float]]] = {name: [] for name in watched}
    since: float | None = None
    air = Air(0.0, 0.0)
    try:
        bench.open(measured, RATE)
        for block in bench.apply(Step(0.0), max(1, round(target.longest_wait * RATE))):
            now = (block.first_row + len(block)) / RATE
            read = _read(bench, block, measured)
            if chamber is not None:
                chamber.pace(now)
                chamber.check()
                own = chamber.take()
                read = {**{name: values for name in watched if len(values := own[f"chamber_{name}"])}, **read}
            for name in watched:
                recent[name] += [(now, float(value)) for value in read.get(name, ())]
            means = {}
            for name, readings in recent.items():
                recent[name] = [(when, value) for when, value in readings if when > now - _SMOOTHED]
                if recent[name]:
                    means[name] = sum(value for _, value in recent[name]) / len(recent[name])
            within = len(means) == len(wanted) and all(
                abs(means[name] - wanted[name]) <= allowed[name] for name in wanted
            )
            since = None if not within else now if since is None else since
            air = Air(now, 0.0 if since is None else now - since, **means, target=target)
            _refuse_beyond(means, limits)
            if on_air(air) or (since is not None and air.settled_for >= lasts):
                return air
    finally:
        bench.close()
    off = [
        f"the {CHANNELS[name].name} is {getattr(air, name):.1f} {CHANNELS[name].display_unit}, not {wanted[name]:g} +- "
        f"{allowed[name]:g}"
        if getattr(air, name) is not None
        else f"no reading of the {CHANNELS[name].name} came"
        for name in wanted
        if getattr(air, name) is None or abs(getattr(air, name) - wanted[name]) > allowed[name]
    ]
    state = "; ".join(off) or f"it has been within tolerance for {air.settled_for:g} s only"
    raise InputError(
        f"the environment did not settle within {target.longest_wait:g} s: {state}",
        code="never-settles",
        where="equilibrium",
        repair="see that the chamber is on and closed, allow a wider tolerance, or wait longer (longest_wait)",
    )


def _read(bench: Bench, block: Block, measured: Collection[str]) -> dict[str, FloatArray]:
    """What the sensors at the strip read of the air."""
    found = {}
    if len(block.temperature):
        found["temperature"] = block.temperature
    for name in measured:
        if name != "voltage":
            found[name] = np.array([bench.rig[name].to_quantity(float(block.readings[name].mean()))])
    return found


def _refuse_beyond(means: Mapping[str, float], limits: Limits | None) -> None:
    """Air in which no strip is to stay, whatever it was set to."""
    for name, value in means.items():
        limit = None if limits is None else limits.watched.get(name)
        if limit is None or limit.action != "zero":
            continue
        if value > limit.most or (limit.least is not None and value < limit.least):
            end = limit.most if value > limit.most or limit.least is None else limit.least
            raise IpmclabError(
                f"the {CHANNELS[name].name} is {shown(name, value)}, beyond its limit of {shown(name, end)}",
                code="beyond-limit",
                where="equilibrium",
                repair="see what the chamber does, or state another limit in [limits]",
            )
