"""A run as the other runs of its fit have it: its prediction by their strip, and what it has for itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun, model_hold, own_endings
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.solve import descend
from ipmclab.identification.search.tangent import STRUCTURAL
from ipmclab.identification.uncertainty.covariance import covariance_table
from ipmclab.model import Actuator
from ipmclab.model.environment.age import AGE, grown
from ipmclab.model.order import Order
from ipmclab.prediction.bands import Drive, noise_of, standard_error_of
from ipmclab.prediction.known_covariance import known_of
from ipmclab.prediction.scores import Comparison, Score
from ipmclab.prediction.validate import validate
from ipmclab.strip_state.run_state import RunState

FloatArray = npt.NDArray[np.float64]

EVALUATIONS: Final = 100
"""Of the model, that a fit to some of the runs may take: it begins at the fit of all (a limit)."""


def is_of_strip(unknown: Unknown) -> bool:
    """Whether it is asked for, and a parameter of the strip or how fast one ages: not what one run has for itself."""
    return not unknown.nuisance and not unknown.base.startswith("observation.")


def problem_of(whole: Problem, records: Sequence[PreparedRun]) -> tuple[Problem, list[int]]:
    """The problem of some of the runs under the same noise, and which entries it has."""
    places = {record.place for record in records}
    kept = [column for column, unknown in enumerate(whole.unknowns) if any(map(unknown.belongs_to, places))]
    plain, unknowns = whole.plain, [whole.unknowns[column] for column in kept]
    return whole.on(Problem(plain.base, records, unknowns, plain.responder, plain.noise)), kept


@dataclass(frozen=True, eq=False)
class OtherRuns:
    """What the other runs say.

    Parameters
    ----------
    fit : Fit
        Of all runs.
    problem : Problem
        Of the others.
    theta : float array, shape (n_unknown,)
        Their solution.
    covariance : float array, shape (n_unknown, n_unknown)
    order : Order
    """

    fit: Fit
    problem: Problem
    theta: FloatArray
    covariance: FloatArray
    order: Order


@dataclass(frozen=True, eq=False)
class Itself:
    """What a run has for itself, found on it while all else is where the other runs have it.

    Parameters
    ----------
    unknowns : list of Unknown
    entries : float array, shape (n_own,)
    follow : float array, shape (n_own, n_unknown)
        By how much each entry moves with each entry of the others.
    """

    unknowns: list[Unknown]
    entries: FloatArray
    follow: FloatArray


class Held:
    """A problem with some of its entries held, and the others moved.

    Parameters
    ----------
    problem : Problem
    theta : float array, shape (n_unknown,)
        Where the others are held.
    moved : list of int
        The entries that are moved.
    """

    def __init__(self, problem: Problem, theta: FloatArray, moved: list[int]) -> None:
        self._problem, self._theta, self._moved = problem, theta, moved
        self.lower, self.upper = problem.lower[moved], problem.upper[moved]
        self.linear, self.added = problem.linear[moved], problem.added[moved]

    def full(self, entries: FloatArray) -> FloatArray:
        """The whole vector."""
        found = self._theta.copy()
        found[self._moved] = entries
        return found

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian of what is moved."""
        here = self._problem.evaluate(self.full(theta))
        return Evaluation(here.rows[[*self._moved, -1]], here.beforehand)


def found_on_itself(
    whole: Problem, theta: FloatArray, theirs: OtherRuns, kept: list[int], record: PreparedRun
) -> Itself:
    problem, columns = problem_of(whole, [record])
    place_in_others = {column: place for place, column in enumerate(kept)}
    moved = [place for place, column in enumerate(columns) if column not in place_in_others]
    held = [place for place, column in enumerate(columns) if column in place_in_others]
    as_theirs = theta[columns]
    as_theirs[held] = theirs.theta[[place_in_others[columns[place]] for place in held]]
    alone = Held(problem, as_theirs, moved)
    begin = as_theirs[moved]
    solution = descend(alone, begin, evaluations=EVALUATIONS)
    jacobian = problem.evaluate(alone.full(solution.theta)).jacobian
    # At the minimum J_o' (J_o d_own + J_h d_held) = 0.
    answer = -np.linalg.lstsq(jacobian[:, moved], jacobian[:, held], rcond=STRUCTURAL)[0]
    of_strip = [number for number, place in enumerate(moved) if is_of_strip(problem.unknowns[place])]
    follow = np.zeros((len(of_strip), len(kept)))
    follow[:, [place_in_others[columns[place]] for place in held]] = answer[of_strip]
    unknowns = [problem.unknowns[moved[number]] for number in of_strip]
    return Itself(unknowns, solution.theta[of_strip], follow)


@dataclass(frozen=True, eq=False)
class PredictedRun:
    """A run as others predict it.

    Parameters
    ----------
    compared : mapping of output to Comparison
    scores : mapping of output to Score
    reach : mapping of output to float array, shape (n_time,) [SI]
        Half the width of the band, of each output of which the other runs know the noise.
    """

    compared: Mapping[str, Comparison]
    scores: Mapping[str, Score]
    reach: Mapping[str, FloatArray]


def predicted_by(theirs: OtherRuns, record: PreparedRun, itself: Itself | None) -> PredictedRun:
    """The prediction of a run; without what was found on itself, its own parameters are the mean of the others'."""

    strip = _strip(theirs, record, itself)
    one = validate(_aged(strip, _rates(theirs), record.state), record.run).runs[0]
    compared = {name: found for name, found in one.comparisons.items() if name in record.readings}
    reach = _reach(theirs, strip, record, itself, one.delay or 0.0, one.zeros)
    return PredictedRun(
        compared,
        {name: one.scores[name] for name in compared},
        {name: reach[name] for name in reach if name in compared},
    )


def _strip(theirs: OtherRuns, record: PreparedRun, itself: Itself | None) -> Actuator:
    """The actuator as the other runs have it, before it aged."""
    others, order = theirs.problem, theirs.order
    each = [others.in_reference(theirs.theta, other.place) for other in others.records]
    values = {name: float(np.mean([one[name] for one in each])) for name in each[0]}
    for place, unknown in enumerate(others.unknowns):
        if unknown.base in values and unknown.belongs_to(record.place):
            values[unknown.base] = unknown.value(float(theirs.theta[place]))
    if itself is not None:
        for unknown, entry in zip(itself.unknowns, itself.entries, strict=True):
            values[unknown.base] = unknown.value(float(entry))
    changes = {order(name): value for name, value in values.items()}
    return replace(theirs.fit.actuator.replace(**changes), fit_table=None)


def _rates(theirs: OtherRuns) -> dict[str, float]:
    """How fast parameters age, as the other runs have it."""
    return {
        theirs.order(unknown.name): unknown.value(float(theirs.theta[place]))
        for place, unknown in enumerate(theirs.problem.unknowns)
        if unknown.base.startswith(AGE)
    }


def _aged(strip: Actuator, rates: Mapping[str, float], state: RunState | None) -> Actuator:
    """The actuator as the run begins."""
    if state is None:
        return strip
    return strip.replace(**{name: strip[name] * factor for name, factor in grown(rates, state.doses).items()})


def _reach(
    theirs: OtherRuns,
    strip: Actuator,
    record: PreparedRun,
    itself: Itself | None,
    delay: float,
    zeros: Mapping[str, float],
) -> dict[str, FloatArray]:
    """Half the width of the band of each output of which the other runs know the noise."""
    others = theirs.problem
    asked = [
        place
        for place, unknown in enumerate(others.unknowns)
        if unknown.base in others.base or unknown.base.startswith(AGE)
    ]
    unknowns = [others.unknowns[place] for place in asked]
    entries, covariance = theirs.theta[asked], theirs.covariance[np.ix_(asked, asked)]
    if itself is not None:
        # What was found on the run gives way to the errors of all else: what it takes up is no error of the prediction.
        moves = np.vstack([np.eye(len(asked)), itself.follow[:, asked]])
        unknowns += itself.unknowns
        entries, covariance = np.append(entries, itself.entries), moves @ covariance @ moves.T
    names = [theirs.order(unknown.name) for unknown in unknowns]
    values = [unknown.value(float(entry)) for unknown, entry in zip(unknowns, entries, strict=True)]
    chains = [unknown.chain(value) for unknown, value in zip(unknowns, values, strict=True)]
    table = covariance_table(names, covariance, chains, {}, {})
    endings = own_endings(record.place, record.run.metadata.mounting_id or "")
    rates = _rates(theirs)
    found = known_of(table, dict(zip(names, values, strict=True)), [*strip.parameter_values, *rates], endings)
    their_observations = [theirs.fit.observations[other.place] for other in others.records]
    outputs = [name for name in record.readings if any(name in observation.noise for observation in their_observations)]
    run = record.run
    drive = Drive(run.time, run.voltage, model_hold(record), delay, state=record.state, rates=rates)
    deviation = standard_error_of(found, strip, drive, outputs)
    since = run.time - run.time[0]
    return {
        name: NORMAL_95 * np.hypot(deviation[name], noise_of(their_observations, name, since, level=name not in zeros))
        for name in outputs
    }
