"""A strip from the headline numbers of its runs: least squares on relative errors, with weak priors.

A dozen printed numbers cannot determine a strip. Each unknown therefore has a prior, wide against what the numbers
tell where they tell something; what no number touches stays at the usual value, and is named. The clamping of each run
has a contact resistance of its own. The search has one start, no random numbers and no order of its runs in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.errors import InputError, IpmclabError
from ipmclab.model import Actuator
from ipmclab.prediction.headline import Comparison, HeadlineRun, compare, read
from ipmclab.run import FloatArray, Run
from ipmclab.ties import largest_first

CONTACT_SCALE: Final = 5.0
"""Spread of the contact resistances about 0 [ohm]."""

PART_OF_TOLERANCE: Final = 1.0 / 3.0
"""Spread of a printed number, as a part of how near a model has to come: within a tolerance are three of them."""

PART_OF_BOUND: Final = 1.0 / 30.0
"""The same below a lower bound, which a model may hardly pass."""

STEADY: Final = 0.05
"""Spread of the logarithm by which a current still falls over the last quarter of a record and is printed as steady."""

_MOST_CONTACT: Final = 100.0
_DETERMINED: Final = 0.5
_MATTERS: Final = 1.1
_STEP: Final = 1e-5


@dataclass(frozen=True)
class Prior:
    """What is taken of a parameter before any number is looked at: most likely within a factor of its usual value.

    Parameters
    ----------
    name : str
        Dotted name of a parameter that is not 0; it keeps the sign of its usual value.
    usual : float [SI]
    factor : float
        One standard deviation of the logarithm, as a factor above 1.
    """

    name: str
    usual: float
    factor: float


@dataclass(frozen=True)
class Constraint:
    """How well the numbers determine one unknown.

    Parameters
    ----------
    name : str
        Dotted name, for the contact of a run with its figure: ``circuit.contact_resistance[5.6]``.
    spread : float
        One standard deviation with the numbers: a factor above 1; for a contact resistance in ohm.
    before : float
        The same without them.
    by : tuple of str
        The numbers without which the spread would be a tenth wider or more, the most telling first.
    """

    name: str
    spread: float
    before: float
    by: tuple[str, ...]

    @property
    def determined(self) -> bool:
        """Whether the numbers at least halve what was not known before."""
        if self.name.startswith("circuit.contact_resistance["):
            return self.spread <= _DETERMINED * self.before
        return math.log(self.spread) <= _DETERMINED * math.log(self.before)


@dataclass(frozen=True)
class HeadlineFit:
    """A strip that was identified from headline numbers.

    Parameters
    ----------
    actuator : Actuator
        Its contact resistance is 0: each run has its own.
    contacts : mapping of figure to float [ohm]
    comparisons : tuple of Comparison
        Every printed number beside the model's.
    constraints : tuple of Constraint
        In the order of the unknowns.
    covariance : float array, shape (n_free, n_free)
        Of the logarithms of the free parameters, in the order of the priors.
    """

    actuator: Actuator
    contacts: Mapping[str, float]
    comparisons: tuple[Comparison, ...]
    constraints: tuple[Constraint, ...]
    covariance: FloatArray

    def factor(self, powers: Mapping[str, float]) -> float:
        """One standard deviation of a product of powers of free parameters, as a factor above 1.

        Parameters
        ----------
        powers : mapping of dotted name to float
            Force alone determines coupling.gain times beam.modulus: ``{"coupling.gain": 1, "beam.modulus": 1}``.
        """
        names = [constraint.name for constraint in self.constraints][: len(self.covariance)]
        direction = np.array([powers.get(name, 0.0) for name in names])
        return math.exp(math.sqrt(float(direction @ self.covariance @ direction)))


def compare_all(
    actuator: Actuator, runs: Sequence[HeadlineRun], contacts: Mapping[str, float]
) -> tuple[Comparison, ...]:
    """Every printed number of some runs beside a model's, each run with its contact resistance [ohm]."""
    return tuple(row for run in runs for row in compare(actuator, run, contacts.get(run.figure, 0.0)))


def fit_headlines(start: Actuator, runs: Sequence[HeadlineRun], priors: Sequence[Prior]) -> HeadlineFit:
    """Identify a strip from what was printed of its runs.

    Minimises the squares of log(model/published) over a third of each reading's tolerance (only below it, for a
    lower bound), of log(parameter/usual) over the prior's log factor, and of the contact resistances over 5 ohm. A
    current that is printed as steady also should not fall: log(I(30 s)/I(40 s)) counts over 0.05.

    Parameters
    ----------
    start : Actuator
        Gives every parameter that has no prior.
    runs : sequence of HeadlineRun
    priors : sequence of Prior
        One for each free parameter; the search starts at the usual values.

    Returns
    -------
    fit : HeadlineFit

    Raises
    ------
    InputError
        No runs, a prior of an unknown parameter, a usual value of 0, or a factor that is not above 1.
    IpmclabError
        The search did not end.
    """
    from scipy.optimize import least_squares

    _check(start, runs, priors)
    names = [prior.name for prior in priors]
    signs = np.sign([prior.usual for prior in priors])
    usual = np.log([abs(prior.usual) for prior in priors])
    widths = np.log([prior.factor for prior in priors])
    n = len(priors)
    lower = np.concatenate([np.full(n, -12.0), np.zeros(len(runs))])
    upper = np.concatenate([np.full(n, 12.0), np.full(len(runs), _MOST_CONTACT / CONTACT_SCALE)])

    figures = [run.figure for run in runs]

    def strip(unknowns: FloatArray) -> tuple[Actuator, dict[str, float]]:
        values = signs * np.exp(usual + widths * unknowns[:n])
        return (
            start.replace(**dict(zip(names, values.tolist(), strict=True))),
            dict(zip(figures, (CONTACT_SCALE * unknowns[n:]).tolist(), strict=True)),
        )

    def data(unknowns: FloatArray) -> FloatArray:
        actuator, contacts = strip(unknowns)
        simulated = [run.simulate(actuator, contacts[run.figure]) for run in runs]
        numbers = [_residual(row) for run, record in zip(runs, simulated, strict=True) for row in read(run, record)]
        falls = [_unsteady(record) for run, record in zip(runs, simulated, strict=True) if _is_steady(run)]
        return np.array(numbers + falls)

    def residuals(unknowns: FloatArray) -> FloatArray:
        return np.concatenate([data(unknowns), unknowns])

    def slopes(unknowns: FloatArray) -> FloatArray:
        """Of the numbers, by steps inside the bounds: a contact resistance may stand at 0."""
        here = data(unknowns)
        return np.column_stack([(data(unknowns + _STEP * one) - here) / _STEP for one in np.eye(len(unknowns))])

    def jacobian_of(unknowns: FloatArray) -> FloatArray:
        return np.vstack([slopes(unknowns), np.eye(len(unknowns))])

    first = np.concatenate([np.zeros(n), np.full(len(runs), 0.2)])
    found = least_squares(residuals, first, jacobian_of, bounds=(lower, upper), xtol=1e-8, ftol=1e-8, max_nfev=200)
    if found.status < 0 or not np.isfinite(found.cost):
        raise IpmclabError(
            f"the search for the strip did not end: {found.message}",
            code="no-fit",
            where=start.name,
            repair="start from usual values that are nearer to the printed numbers",
        )
    actuator, contacts = strip(found.x)
    jacobian = slopes(found.x)
    comparisons = compare_all(actuator, runs, contacts)
    parts = np.array([_part(row) for row in comparisons] + [1.0] * (len(jacobian) - len(comparisons)))
    jacobian = np.asarray(jacobian * parts[:, None], dtype=np.float64)  # each number as uncertain as its tolerance
    information = jacobian.T @ jacobian + np.eye(jacobian.shape[1])
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    constraints = _constraints(jacobian, covariance, comparisons, priors, runs)
    logarithmic = np.asarray(covariance[:n, :n] * widths * widths[:, None], dtype=np.float64)
    return HeadlineFit(actuator, contacts, comparisons, constraints, logarithmic)


def _residual(row: Comparison) -> float:
    ratio = math.log(row.model / row.published)
    return (min(ratio, 0.0) if row.lower_bound else ratio) / (_part(row) * row.reading.tolerance)


def _is_steady(run: HeadlineRun) -> bool:
    return any(row.metric == "steady_current" for row in run.numbers)


def _unsteady(record: Run) -> float:
    """By how much a current that is printed as steady still falls over the last quarter of the record."""
    assert record.current is not None  # a simulated run has one
    return math.log(record.current[3 * len(record.current) // 4] / record.current[-1]) / STEADY


def _part(row: Comparison) -> float:
    return PART_OF_BOUND if row.lower_bound else PART_OF_TOLERANCE


def _constraints(
    jacobian: FloatArray,
    covariance: FloatArray,
    comparisons: Sequence[Comparison],
    priors: Sequence[Prior],
    runs: Sequence[HeadlineRun],
) -> tuple[Constraint, ...]:
    """Spreads with the printed numbers as uncertain as their tolerance, and what each is worth.

    ``jacobian`` is that of the numbers, each over its tolerance, by the unknowns, each over its prior's spread.
    """
    # Without number k the covariance grows by one rank (Sherman and Morrison).
    seen = covariance @ jacobian.T
    left = 1.0 - np.einsum("ij,ji->i", jacobian, seen)
    grown = seen**2 / np.maximum(left, 1e-12) / np.diag(covariance)[:, None]
    labels = [f"{row.run.figure} {row.run.waveform} {row.metric.replace('_', ' ')}" for row in comparisons]
    labels += [f"{run.figure} {run.waveform} current that stands" for run in runs if _is_steady(run)]
    found = []
    for i in range(len(covariance)):
        spread = math.sqrt(covariance[i, i])
        order = largest_first(grown[i])
        by = tuple(labels[k] for k in order if math.sqrt(1.0 + grown[i, k]) >= _MATTERS)
        if i < len(priors):
            width = math.log(priors[i].factor)
            found.append(Constraint(priors[i].name, math.exp(spread * width), priors[i].factor, by))
        else:
            name = f"circuit.contact_resistance[{runs[i - len(priors)].figure}]"
            found.append(Constraint(name, spread * CONTACT_SCALE, CONTACT_SCALE, by))
    return tuple(found)


def _check(start: Actuator, runs: Sequence[HeadlineRun], priors: Sequence[Prior]) -> None:
    if not runs:
        raise InputError("no runs", code="no-runs", where="runs", repair="give one published run or more")
    for prior in priors:
        _ = start[prior.name]  # an unknown name says so itself
        if not (prior.usual != 0 and math.isfinite(prior.usual) and 1 < prior.factor < math.inf):
            raise InputError(
                f"the usual value is {prior.usual:g} and the factor {prior.factor:g}",
                code="bad-prior",
                where=prior.name,
                repair="give a usual value other than 0 and a factor above 1",
            )
