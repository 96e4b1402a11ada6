"""Each run predicted by the others: what a fit says of a run that it never saw, and which run does not fit in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95, REJECT
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import DETERMINED, Fit
from ipmclab.fit.fit_table import changed
from ipmclab.fit.left_out import LeftOut
from ipmclab.fit.run_state import RunState
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.pieces import Key, Piece
from ipmclab.identification.problem.age import AGE, Age
from ipmclab.identification.problem.order import Order
from ipmclab.identification.problem.problem import Evaluation, Problem
from ipmclab.identification.problem.record import PreparedRun, model_hold, own_endings
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.solve import STRUCTURAL, descend, entry_errors
from ipmclab.identification.solved import Estimate, solved
from ipmclab.identification.uncertainty.known_covariance import covariance_table, known_of
from ipmclab.measurement.random_effect import FEWEST
from ipmclab.model import Actuator
from ipmclab.one_thread import on_one_thread
from ipmclab.prediction.bands import Drive, noise_of, spread_of
from ipmclab.prediction.scores import Comparison, Score
from ipmclab.prediction.validate import validate
from ipmclab.progress import Tell, part, stage, telling
from ipmclab.run import Finding
from ipmclab.statespace.shape import Shape
from ipmclab.statespace.terms import Terms

FloatArray = npt.NDArray[np.float64]

_ADDS: Final = 0.01  # part of a variance that a run must take away to be asked what it changes
_EVALUATIONS: Final = 100


@on_one_thread
def leave_one_run_out(fit: Fit, *, progress: Tell | None = None) -> Fit:
    """Fit without each run in turn, predict it, and see what it changes.

    Each fit starts where the fit of all runs stands and keeps the noise that was found there, so it takes a few steps.
    What leaving a run out changes is held against its own variance: with the pseudo-inverses A of both fits and the
    covariance V of the noise, (A_others - A_all) V (A_others - A_all)'. So a run shows that is of another strip,
    another state or another mounting.

    Parameters
    ----------
    fit : Fit
        As ``identify`` returned it, of two runs or more.
    progress : function of (str, float), optional
        Called with a sentence and the fraction that is done.

    Returns
    -------
    fit : Fit
        The same with ``left_out``, one for each run, and a finding for each run that does not fit in.

    Raises
    ------
    InputError
        A fit that was read from a file, or of one run.

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab import Run, identify, leave_one_run_out, load_actuator, simulate
    >>> strip, noise, runs = load_actuator("friend-2"), np.random.default_rng(20261121), []
    >>> for signal in ("step 1 V", "sine 1 V 0.1 Hz", "square 1 V 0.1 Hz"):
    ...     clean = simulate(strip, signal, duration=40, rate=50)
    ...     current = clean.current + 1e-4 * noise.standard_normal(2000)
    ...     runs.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current))
    >>> fit = leave_one_run_out(identify(strip, runs))
    >>> [bool(one.fit_percent["current"] > 98.0) for one in fit.left_out]
    [True, True, True]
    """
    if fit.estimate is None:
        raise InputError(
            "a fit that was read from a file holds no runs to leave out",
            code="fit-without-runs",
            where="fit",
            repair="identify from the runs again, and give that fit",
        )
    result = solved(fit)
    records = result.problem.records
    if len(records) < 2:
        raise InputError(
            "one run leaves nothing to predict it from",
            code="one-run",
            where="fit",
            repair="identify from two runs or more",
        )
    labels = [record.label for record in records]
    named = [f"{name} [{place}]" if labels.count(name) > 1 else name for place, name in enumerate(labels)]
    found = []
    with telling(progress):
        for number, (record, label) in enumerate(zip(records, named, strict=True)):
            with part("", number / len(records), (number + 1) / len(records)):
                stage(f"predicting {label} from the other runs", 0.0, 1.0, 10)
                found.append(_without(fit, result, record, label))
    others = [finding for finding in fit.findings if finding.code != "run-stands-out"]
    return changed(fit, left_out=tuple(found), findings=(*others, *_stands_out(fit, found)))


def _without(fit: Fit, result: Estimate, record: PreparedRun, label: str) -> LeftOut:
    whole, theta = result.problem, result.solution.theta
    others, kept = _problem_without(whole, record.place)
    begin = theta[kept]
    solution = descend(others, begin, evaluations=_EVALUATIONS)
    here, before = solution.evaluation, result.solution.evaluation
    order = Order(whole.in_reference(theta, whole.records[0].place))
    errors, were = entry_errors(here), entry_errors(before)[kept]
    shared = [place for place, unknown in enumerate(others.unknowns) if _is_of_strip(unknown)]
    own = [unknown for column, unknown in enumerate(whole.unknowns) if column not in kept and _is_of_strip(unknown)]
    untold = [unknown for unknown in own if sum(other.base == unknown.base for other in others.unknowns) < FEWEST]
    known = [place for place in shared if errors[place] <= _most(others, solution.theta, place)]
    lost = [
        order(others.unknowns[place].name)
        for place in shared
        if place not in known and fit.parameters[order(others.unknowns[place].name)].determined
    ]
    moved = solution.theta - begin
    covariance, apart = _covariances(result.correlated, before, others, here, kept)
    shifts, p_value = _shift(moved, covariance, apart, known)
    told = LeftOut(
        label,
        undetermined=(*lost, *(order(unknown.name) for unknown in untold)),
        shifts={order(others.unknowns[place].name): shift for place, shift in shifts.items()},
        p_value=p_value,
    )
    if np.isinf(errors[shared][np.isfinite(were[shared])]).any():
        return told  # along what they do not show at all the others would stand where this run put them
    theirs = _Theirs(fit, others, solution.theta, covariance, order)
    try:
        itself = _found_on_itself(whole, theta, theirs, kept, record) if own else None
        judged = _predicted(theirs, record, itself)
        scored = judged if untold or itself is None else _predicted(theirs, record, None)
    except IpmclabError:  # the others put the strip where no prediction is finite
        return told
    return replace(
        told,
        fit_percent={name: s.fit_percent for name, s in scored.scores.items() if s.fit_percent is not None},
        rmse={name: s.rmse for name, s in scored.scores.items() if s.rmse is not None},
        inside={name: _inside(scored.compared[name], reach) for name, reach in scored.reach.items()},
        standardised={
            name: _standardised(judged.compared[name], reach, len(own)) for name, reach in judged.reach.items()
        },
    )


def _is_of_strip(unknown: Unknown) -> bool:
    return not unknown.nuisance and not unknown.base.startswith("observation.")


def _problem_without(whole: Problem, place: int) -> tuple[Problem, list[int]]:
    """The problem of the other runs under the same noise, and which entries it has."""
    return _problem_of(whole, [record for record in whole.records if record.place != place])


def _problem_of(whole: Problem, records: Sequence[PreparedRun]) -> tuple[Problem, list[int]]:
    """The problem of some of the runs under the same noise, and which entries it has."""
    places = {record.place for record in records}
    kept = [column for column, unknown in enumerate(whole.unknowns) if any(map(unknown.belongs_to, places))]
    plain, unknowns = whole.plain, [whole.unknowns[column] for column in kept]
    return whole.on(Problem(plain.base, records, unknowns, plain.responder, plain.noise)), kept


def _most(problem: Problem, theta: FloatArray, place: int) -> float:
    """The error of an entry up to which it is determined."""
    return DETERMINED if problem.unknowns[place].log else DETERMINED * max(abs(float(theta[place])), 1.0)


def _inverse(here: Evaluation) -> FloatArray:
    """Of the normal equations, without directions of which nothing is known: told by angles between columns, not sizes.

    A prior a billion times as sharp as the readings would else count them as nothing.
    """
    singular, directions, _, size = here.scaled_spectrum
    seen = singular > STRUCTURAL * singular.max(initial=0.0)
    inverse = directions[seen].T / singular[seen] / size[:, None]
    return np.asarray(inverse @ inverse.T)


def _covariances(
    under: Correlated, before: Evaluation, others: Problem, here: Evaluation, kept: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Of what the other runs find, and of what leaving the run out changes, under the noise that was found."""
    theirs = here.jacobian @ _inverse(here)
    every = (before.jacobian @ _inverse(before))[:, kept]
    covariance, apart = np.zeros((len(kept), len(kept))), np.zeros((len(kept), len(kept)))
    for key, piece in under.problem.pieces.items():
        change = -every[piece]
        if key in others.pieces:
            own = theirs[others.pieces[key]]
            covariance += under.spread(own, key)
            apart += under.spread(change + own, key)
        else:
            # What it leaves may be of another strip: its noise is taken to be that of the others.
            apart += _as_in_others(under, key, others).spread(change, key)
    of_theirs, of_every = _priors(others), _priors(under.problem)
    known = theirs[len(theirs) - len(of_theirs) :]
    change = -every[len(every) - len(of_every) :]
    change[[of_every.index(name) for name in of_theirs]] += known
    return covariance + known.T @ known, apart + change.T @ change


def _as_in_others(under: Correlated, key: Key, others: Problem) -> Correlated:
    """With the noise of one output of one run as the other runs have it, the noisiest of them."""
    noise, shapes = under.problem.noise, dict(under.shapes)
    white = Shape(Terms(), np.zeros(0), 1.0)
    theirs = [(noise[other] ** 2, shapes.get(other, white)) for other in others.pieces if other[1] == key[1]]
    if not theirs or under.is_weighted:
        return under
    unit, shape = max(theirs, key=lambda one: one[0] * one[1].variance)
    shapes[key] = replace(shape, variance=shape.variance * unit / noise[key] ** 2)
    # Of its own a run with few readings, or with readings that the fit meets exactly, shows no noise.
    own = Piece.of(under.problem.record_at(key[0]), key[1], under.problem.unknowns)
    return replace(under, shapes=shapes, pieces={key: own, **under.pieces})


def _priors(problem: Problem) -> list[str]:
    """What is known beforehand, in the order of its rows."""
    return [unknown.name for unknown in problem.unknowns if unknown.prior is not None]


def _shift(
    moved: FloatArray, others: FloatArray, apart: FloatArray, known: list[int]
) -> tuple[dict[int, float], float]:
    """Each change in its own standard errors, and the p-value of all of them together."""
    from scipy.special import chdtrc

    if not known:
        return {}, 1.0
    size = np.sqrt(others.diagonal()[known])
    variance = apart[np.ix_(known, known)] / np.outer(size, size)
    change = moved[known] / size
    own = variance.diagonal()
    shifts = {place: float(change[k] / math.sqrt(own[k])) if own[k] > _ADDS else 0.0 for k, place in enumerate(known)}
    values, vectors = np.linalg.eigh(variance)
    told = values > _ADDS
    square = float(np.sum((vectors[:, told].T @ change) ** 2 / values[told]))
    return shifts, float(chdtrc(int(told.sum()), square)) if told.any() else 1.0


@dataclass(frozen=True, eq=False)
class _Theirs:
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
class _Itself:
    """What a run has for itself, found on it while all else stands where the other runs have it.

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


class _Held:
    """The problem of one run with what the other runs say held."""

    def __init__(self, problem: Problem, theta: FloatArray, moved: list[int]) -> None:
        self._problem, self._theta, self._moved = problem, theta, moved
        self.lower, self.upper = problem.lower[moved], problem.upper[moved]

    def full(self, entries: FloatArray) -> FloatArray:
        """The whole vector."""
        found = self._theta.copy()
        found[self._moved] = entries
        return found

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian of what is moved."""
        here = self._problem.evaluate(self.full(theta))
        return Evaluation(here.rows[[*self._moved, -1]], here.beforehand)


def _found_on_itself(
    whole: Problem, theta: FloatArray, theirs: _Theirs, kept: list[int], record: PreparedRun
) -> _Itself:
    problem, columns = _problem_of(whole, [record])
    place_in_others = {column: place for place, column in enumerate(kept)}
    moved = [place for place, column in enumerate(columns) if column not in place_in_others]
    held = [place for place, column in enumerate(columns) if column in place_in_others]
    as_theirs = theta[columns]
    as_theirs[held] = theirs.theta[[place_in_others[columns[place]] for place in held]]
    alone = _Held(problem, as_theirs, moved)
    begin = as_theirs[moved]
    solution = descend(alone, begin, evaluations=_EVALUATIONS)
    jacobian = problem.evaluate(alone.full(solution.theta)).jacobian
    # At the minimum J_o' (J_o d_own + J_h d_held) = 0.
    answer = -np.linalg.lstsq(jacobian[:, moved], jacobian[:, held], rcond=STRUCTURAL)[0]
    of_strip = [number for number, place in enumerate(moved) if _is_of_strip(problem.unknowns[place])]
    follow = np.zeros((len(of_strip), len(kept)))
    follow[:, [place_in_others[columns[place]] for place in held]] = answer[of_strip]
    unknowns = [problem.unknowns[moved[number]] for number in of_strip]
    return _Itself(unknowns, solution.theta[of_strip], follow)


@dataclass(frozen=True, eq=False)
class _Prediction:
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


def _predicted(theirs: _Theirs, record: PreparedRun, itself: _Itself | None) -> _Prediction:
    """The prediction of a run; without what was found on itself, its own parameters are the mean of the others'."""

    strip = _strip(theirs, record, itself)
    one = validate(_aged(strip, _rates(theirs), record.state), record.run).runs[0]
    compared = {name: found for name, found in one.comparisons.items() if name in record.readings}
    reach = _reach(theirs, strip, record, itself, one.delay or 0.0, one.zeros)
    return _Prediction(
        compared,
        {name: one.scores[name] for name in compared},
        {name: reach[name] for name in reach if name in compared},
    )


def _strip(theirs: _Theirs, record: PreparedRun, itself: _Itself | None) -> Actuator:
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


def _rates(theirs: _Theirs) -> dict[str, float]:
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
    values = dict(strip.parameter_values)
    for name, rate in rates.items():
        age = Age.of(name)
        values[age.parameter] *= math.exp(rate * state.doses[age.scale])
    return strip.replace(**values)


def _reach(
    theirs: _Theirs,
    strip: Actuator,
    record: PreparedRun,
    itself: _Itself | None,
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
    seen = [theirs.fit.observations[other.place] for other in others.records]
    outputs = [name for name in record.readings if any(name in observation.noise for observation in seen)]
    run = record.run
    drive = Drive(run.time, run.voltage, model_hold(record), delay, state=record.state, rates=rates)
    spread = spread_of(found, strip, drive, outputs)
    since = run.time - run.time[0]
    return {
        name: NORMAL_95 * np.hypot(spread[name], noise_of(seen, name, since, level=name not in zeros))
        for name in outputs
    }


def _inside(one: Comparison, reach: FloatArray) -> float:
    return float(np.mean(np.abs(one.error[one.used]) <= reach[one.used]))


def _standardised(one: Comparison, reach: FloatArray, found: int) -> float:
    """Each parameter that was found on the run took up as much as one reading."""
    squares = np.square(one.error[one.used] / reach[one.used])
    return float(np.sqrt(squares.sum() / max(len(squares) - found, 1))) * NORMAL_95


def _chance(one: LeftOut) -> float:
    """The p-value of a run, by what it changes or by what the others predict of it.

    A run that does not fit in may pass the first: what it contradicts is taken for noise of its own.
    """
    from scipy.special import erfc

    return min([one.p_value, *(float(erfc(size / math.sqrt(2.0))) for size in one.standardised.values())])


def _stands_out(fit: Fit, runs: Sequence[LeftOut]) -> list[Finding]:
    """That a run is not like the others: of the unlikely ones that which the others predict worst.

    One that is of another strip spoils what the others say of each other, so that those may be as unlikely.
    """
    unlikely = [one for one in runs if _chance(one) < REJECT / len(runs)]
    if not unlikely or any(finding.code == "mountings-differ" for finding in fit.findings):
        return []  # where mountings differ, every run is unlike those of the others
    one = max(unlikely, key=lambda one: (max(one.standardised.values(), default=0.0), -_chance(one)))
    if one.p_value == _chance(one):
        most = max(one.shifts, key=lambda name: abs(one.shifts[name]))
        why = f"without it {most} changes by {abs(one.shifts[most]):.3g} standard errors"
    else:
        output = max(one.standardised, key=lambda name: one.standardised[name])
        why = f"its {output} lies {one.standardised[output]:.3g} standard deviations (rms) from what they predict"
    told = f"{one.label} does not fit in with the other runs (p < 0.1 %): {why}"
    if len(runs) == 2:
        told = f"{runs[0].label} and {runs[1].label} do not agree (p < 0.1 %): of {one.label}, {why}; which of them is "
        told += "out of place two runs cannot tell"
    return [
        Finding(
            "run-stands-out",
            "warning",
            told,
            "see whether it is of another mounting or another state of the strip; if so, fit it by itself, or name "
            "what differs in per_run or per_mounting; else the model lacks something that the signals show differently",
            values={"p_value": _chance(one), **{f"shift.{name}": shift for name, shift in one.shifts.items()}},
        )
    ]
