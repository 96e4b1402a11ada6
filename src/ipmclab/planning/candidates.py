"""Runs that could be recorded next, and the time that each takes on the bench."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.environment import Environment
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.safety.guard import Guard
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from ipmclab.signals import Chirp, Multisine, Signal, Sine, Square, Step, Triangle

_BELOW_ELECTROLYSIS: Final = Limits(voltage=Limit(1.2, 0.02))

_AT_THE_STRIP: Final = replace(THESIS_RIG, voltage_sensed="electrodes")
"""What a model answers has no shunt in it."""

FloatArray = npt.NDArray[np.float64]

REST_BEFORE: Final = 5.0
"""At 0 V before each signal [s], recorded with it: an experiment's own default."""

DURATIONS: Final = (10.0, 20.0, 40.0, 80.0, 160.0)
"""How long signals are tried [s]."""

FREQUENCIES: Final = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Of sine, square and triangle [Hz]; of chirp and multisine the ends are among them."""

LEVELS: Final = (1.0, 0.5)
"""Amplitudes, as parts of the largest."""

_BANDS: Final = ((0.05, 1.0), (0.05, 5.0), (0.2, 5.0))  # of chirp and multisine [Hz]
_SLACK: Final = 1e-9
_ROWS: Final = 10.0  # in a period: fewer do not draw it


@dataclass(frozen=True)
class Candidate:
    """A run that could be recorded.

    Parameters
    ----------
    signal : Signal
    duration : float [s]
        Of the signal.
    condition : Environment, optional
        In which the strip is; None where it stays where it is.
    """

    signal: Signal
    duration: float
    condition: Environment | None = None


@dataclass(frozen=True)
class Allowance:
    """What a bench allows, and what a run costs there.

    Parameters
    ----------
    limits : Limits
        Of a rig; that of the voltage is the largest amplitude. 1.2 V where it is left out: above 1.23 V the water in
        the strip is split.
    rate : float [Hz], optional
        Rows each second; that of the noise of the fit where it is left out.
    longest : float [s]
        Of a signal.
    rest : float [s]
        At 0 V with each run: 5 s before and after it and 120 s in which the strip discharges, as an experiment has it.
    hydration : float [s]
        For which the strip lies in water before each run.
    wet : float [s]
        How long it stays wet in the air: a run that lasts longer, with its rests, is not proposed.
    soak : float [s]
        For which the strip waits in another condition than that of the run before.
    conditions : tuple of Environment
        Between which a chamber can choose; where it is empty the strip stays where it is.
    reads : tuple of str
        Channels that a run reads; all that the fit read where it is empty.

    Raises
    ------
    InputError
        A time that is negative, a rate or a longest signal that is not above 0.

    Examples
    --------
    >>> from ipmclab.signals import Step
    >>> Allowance(rest=60.0, hydration=300.0).time(Candidate(Step(1.0), 40.0), None)
    400.0
    """

    limits: Limits = _BELOW_ELECTROLYSIS
    rate: float | None = None
    longest: float = DURATIONS[-1]
    rest: float = 130.0
    hydration: float = 0.0
    wet: float = math.inf
    soak: float = 1800.0
    conditions: tuple[Environment, ...] = ()
    reads: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("rest", "hydration", "wet", "soak"):
            given = getattr(self, name)
            if not _number(given) >= 0.0 or (math.isinf(given) and name != "wet"):
                raise InputError(
                    f"it is {given!r}, no time in s",
                    code="out-of-range",
                    where=name,
                    repair="give 0 s or more, such as 60 s",
                )
        for name in ("longest", *(["rate"] if self.rate is not None else [])):
            given = getattr(self, name)
            if not 0.0 < _number(given) < math.inf:
                raise InputError(
                    f"it is {given!r}, it must be a number above 0",
                    code="out-of-range",
                    where=name,
                    repair="leave it out",
                )

    def time(self, candidate: Candidate, before: Environment | None) -> float:
        """Of a run [s] after one in some condition."""
        moved = candidate.condition is not None and candidate.condition != before
        return candidate.duration + self.rest + self.hydration + (self.soak if moved else 0.0)

    def candidates(self, rate: float) -> Iterator[Candidate]:
        """Every run that is tried and during which the strip stays wet, at a rate of the rows [Hz]."""
        for condition in self.conditions or (None,):
            for one in candidates(self.limits.voltage.most, rate, self.longest, condition):
                if one.duration + self.rest <= self.wet:
                    yield one

    def refusal(self, candidate: Candidate, answer: Mapping[str, FloatArray], rate: float) -> str:
        """The limit that a run would pass, by its name; empty where it passes none.

        Parameters
        ----------
        candidate : Candidate
        answer : mapping of channel to float array, shape (n_time,) [SI]
            The voltage, and what the strip would answer.
        rate : float [Hz]
        """
        try:
            self.limits.refuse(candidate.signal, candidate.duration, rate)
        except InputError as error:
            return error.code.removesuffix("-limit")
        alarms = Guard(self.limits, rate, _AT_THE_STRIP).look(0, answer)
        return alarms[0].limit if alarms else ""


def _number(given: object) -> float:
    """A number; NaN, which is in no range, for what is none."""
    return float(given) if isinstance(given, Real) else math.nan


def candidates(most: float, rate: float, longest: float, condition: Environment | None = None) -> Iterator[Candidate]:
    """Steps, sines, squares, triangles, chirps and multisines.

    Parameters
    ----------
    most : float [V]
        Largest amplitude.
    rate : float [Hz]
        Of the rows.
    longest : float [s]
    condition : Environment, optional

    Examples
    --------
    >>> found = list(candidates(1.0, 50.0, 20.0))
    >>> len(found), str(found[0].signal), str(found[-1].signal)
    (98, 'step 1 V', 'multisine 0.5 V 0.2 Hz 5 Hz')
    """
    for duration in [one for one in DURATIONS if one <= longest] or [longest]:
        for level in LEVELS:
            for signal in _signals(_rounded(most * level), rate, duration):
                yield Candidate(signal, duration, condition)


def _rounded(voltage: float) -> float:
    """A voltage that people can read, and no larger: one above its limit would be refused."""
    nearest, last_digit = float(f"{voltage:.3g}"), 10.0 ** (math.floor(math.log10(voltage)) - 2)
    return min(nearest, voltage) if nearest <= voltage * (1.0 + _SLACK) else float(f"{nearest - last_digit:.3g}")


def _signals(amplitude: float, rate: float, duration: float) -> Iterator[Signal]:
    yield Step(amplitude)
    for frequency in FREQUENCIES:
        if frequency * duration >= 1.0 and frequency * _ROWS <= rate:
            for kind in (Sine, Square, Triangle):
                yield kind(amplitude, frequency)
    for low, high in _BANDS:
        if low * duration >= 1.0 and high * _ROWS <= rate:
            yield Chirp(amplitude, low, high, sweep_time=duration)
            yield Multisine(amplitude, low, high)
