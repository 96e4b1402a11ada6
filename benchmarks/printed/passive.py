"""Which published currents no passive one-port can join: linear programs over non-negative relaxations.

Whatever network of resistors and capacitors a strip is, with branches, a clamped section, an electrode line, its
current after a step of 1 V is G_0 + sum a_k exp(-t/tau_k) with every amplitude at least 0 (a driving-point admittance
of resistors and capacitors has simple poles on the negative real axis with positive residues of Y(s)/s). On a fine
grid of time constants a published current is then linear in the amplitudes, and the smallest error with which any
such network gives all currents of some runs at once is a linear program. No starting point, no local minimum: what it
finds impossible is impossible for each of these models.

A reading that comes a fixed time after its edge changes the amplitudes only by factors exp(-lag/tau_k), so that the
verdict does not depend on the lag of the rig as long as all runs have the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal

import numpy as np

from ipmclab.errors import InputError, IpmclabError
from ipmclab.prediction.headline import DURATION, PERIOD, RATE, READINGS, HeadlineRun
from ipmclab.run import FloatArray

TIME_CONSTANTS: Final = np.geomspace(1e-3, 1e5, 81)
"""Of the relaxations [s], 10 a decade; beside them a conductance and an amplitude that is gone at the next row."""

_PHASES: Final = 5

SquarePeak = Literal["largest at a reversal", "at the first edge"]


@dataclass(frozen=True)
class Nearest:
    """One published current, and what the network that comes nearest gives.

    Parameters
    ----------
    figure, name : str
    published, model : float [A]
    lower_bound : bool
        Whether the published number is only a bound.
    """

    figure: str
    name: str
    published: float
    model: float
    lower_bound: bool = False

    @property
    def difference(self) -> float:
        """Model minus published, as a fraction of the published number; 0 above a lower bound."""
        difference = (self.model - self.published) / self.published
        return min(difference, 0.0) if self.lower_bound else difference


@dataclass(frozen=True)
class Joined:
    """How nearly some runs can be joined by one model of a class.

    Parameters
    ----------
    runs : tuple of HeadlineRun
    error : float
        The smallest possible largest error of their currents, as a fraction of the published number.
    worst : float
        The same with every error over the tolerance of its reading: above 1 no model is within all of them.
    nearest : tuple of Nearest
        The currents at that smallest error.
    """

    runs: tuple[HeadlineRun, ...]
    error: float
    worst: float
    nearest: tuple[Nearest, ...]

    @property
    def possible(self) -> bool:
        """Whether some model is within all tolerances."""
        return self.worst <= 1.0


@dataclass(frozen=True)
class _Number:
    """A published number and the linear forms of it: it is the largest of |form|, reached by ``reached``."""

    figure: str
    name: str
    published: float
    tolerance: float
    lower_bound: bool
    forms: FloatArray
    candidates: tuple[int, ...]


def linear_one_port(runs: Sequence[HeadlineRun], *, square_peak: SquarePeak = "largest at a reversal") -> Joined:
    """How nearly any one passive linear one-port, the same in all runs, gives the currents of these runs.

    Parameters
    ----------
    runs : sequence of HeadlineRun
        Contact resistance is a part of the one-port: it does not change between the runs.
    square_peak : str
        Where the peak of a square was read. A linear one-port peaks at its first reversal, by nearly twice the peak
        of the step.

    Raises
    ------
    InputError
        No runs.
    IpmclabError
        The linear program has no solution.

    Examples
    --------
    >>> from ipmclab.prediction.headline import headline_runs
    >>> step, sine, square = headline_runs(6, "displacement")
    >>> linear_one_port([step, square]).possible
    True
    """
    if not runs:
        raise InputError("no runs", code="no-runs", where="runs", repair="give one published run or more")
    numbers = [number for run in runs for number in _numbers(run, square_peak)]
    error, amplitudes = _smallest(numbers, weighted=False)
    worst, _ = _smallest(numbers, weighted=True)
    nearest = tuple(
        Nearest(n.figure, n.name, n.published, float(np.abs(n.forms @ amplitudes).max()), n.lower_bound)
        for n in numbers
    )
    return Joined(tuple(runs), error, worst, nearest)


def _numbers(run: HeadlineRun, square_peak: SquarePeak) -> list[_Number]:
    response = _responses(run.signal)
    half, period = round(PERIOD * RATE / 2.0), round(PERIOD * RATE)
    found = []
    for row in run.numbers:
        if not row.metric.endswith("current"):
            continue
        key = (run.waveform, row.metric)
        candidates: tuple[int, ...] = (0,)
        if key == ("step", "peak_current"):
            forms = response[:1]  # it only falls from there
        elif key == ("step", "steady_current"):
            forms = response[-1:]
        elif key == ("square", "half_period_end_current"):
            forms = response[half - 1 : half]
        elif key == ("square", "peak_current"):
            # With s(t) the step response, convex and falling, the first reversal reads 2 s(0) - s(T/2), the edge s(0)
            # before it less, and each later reversal less by a second difference of s.
            forms = response[:1] if square_peak == "at the first edge" else -response[half : half + 1]
        else:
            # Half the difference of rows half a period apart. Every fifth phase: the largest is off by 0.05 % at most.
            first = np.arange(len(response) - period, len(response) - half, _PHASES)
            forms = 0.5 * (response[first] - response[first + half])
            # The current of resistors and capacitors leads by up to a quarter of a period.
            candidates = tuple(range(len(first) // 2 + 2))
        value = run.value(row.metric)
        bound = row.qualifier == "lower_bound"
        name = f"{run.waveform} {row.metric.replace('_', ' ')}"
        found.append(_Number(run.figure, name, value, READINGS[key].tolerance, bound, forms, candidates))
    return found


@cache
def _responses(signal: str) -> FloatArray:
    """The current of the conductance, of the instant amplitude and of each relaxation, one column each."""
    from scipy.signal import lfilter

    from ipmclab.signals import parse

    time = np.arange(round(DURATION * RATE)) / RATE
    voltage = parse(signal).voltage(time)
    jumps = np.diff(voltage, prepend=0.0)
    columns = [voltage, jumps]
    columns += [lfilter([1.0], [1.0, -np.exp(-1.0 / (RATE * tau))], jumps) for tau in TIME_CONSTANTS]
    return np.column_stack(columns)


def _smallest(numbers: Sequence[_Number], *, weighted: bool) -> tuple[float, FloatArray]:
    """The smallest of the programs' optima, over the row at which a sine is largest.

    Sines in one set are the same signal and peak at the same row. Without the demand that a sine reaches its number,
    the program bounds all the others from below, which ends the search as soon as one of them comes down to it.
    """
    fewest = max(len(number.candidates) for number in numbers)
    if fewest == 1:
        return _program(numbers, 0, weighted=weighted)
    bound, _ = _program(numbers, None, weighted=weighted)
    best: tuple[float, FloatArray] | None = None
    for k in sorted(
        range(fewest), key=lambda k: abs(k - fewest // 2)
    ):  # from half way between in phase and a quarter ahead
        solved = _program(numbers, k, weighted=weighted)
        if best is None or solved[0] < best[0]:
            best = solved
        if best[0] <= bound + 1e-9:
            break
    assert best is not None  # there is a candidate
    return best


def _program(numbers: Sequence[_Number], chosen: int | None, *, weighted: bool) -> tuple[float, FloatArray]:
    from scipy.optimize import linprog

    matrix, limits = [], []
    for number in numbers:
        scale = number.tolerance if weighted else 1.0
        if len(number.candidates) == 1 or chosen is not None:
            row = number.candidates[0 if len(number.candidates) == 1 else chosen or 0]
            matrix.append(np.append(-number.forms[row] / number.published, -scale))  # form >= (1 - e) published
            limits.append(-1.0)
        if not number.lower_bound:
            for sign in (1.0, -1.0) if len(number.forms) > 1 else (1.0,):
                above = sign * number.forms / number.published
                matrix += list(np.column_stack([above, np.full(len(above), -scale)]))
                limits += [1.0] * len(above)
    n = len(matrix[0])
    cost = np.zeros(n)
    cost[-1] = 1.0
    solved = linprog(cost, A_ub=np.array(matrix), b_ub=np.array(limits), bounds=(0.0, None), method="highs")
    if not solved.success:
        raise IpmclabError(
            f"the linear program has no solution: {solved.message}",
            code="no-solution",
            where="currents",
            repair="look at the published currents: each must be above 0",
        )
    return float(solved.fun), np.asarray(solved.x[:-1])
