"""Each run predicted by the others: what a fit says of a run that it never saw, and which run does not fit in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95, REJECT
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import DETERMINED, Fit
from ipmclab.fit.fit_table import changed
from ipmclab.fit.left_out import LeftOut
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.pieces import Key, Piece
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.search.solve import Solution, descend
from ipmclab.identification.search.tangent import STRUCTURAL, entry_errors
from ipmclab.identification.solved import Estimate, solved
from ipmclab.kinds import tell_kinds
from ipmclab.measurement.random_effect import FEWEST
from ipmclab.model.order import Order
from ipmclab.one_thread import on_one_thread
from ipmclab.prediction.by_others import (
    EVALUATIONS,
    Held,
    OtherRuns,
    found_on_itself,
    is_of_strip,
    predicted_by,
    problem_of,
)
from ipmclab.prediction.scores import Comparison
from ipmclab.progress import OnProgress, part, reporting_to, stage
from ipmclab.run import Finding
from ipmclab.statespace.shape import Shape
from ipmclab.statespace.terms import Terms

FloatArray = npt.NDArray[np.float64]

_AT_FLOOR: Final = 2.0  # times the noise between neighbours, up to which a model lacks little (convention)
_FAR_WORSE: Final = 5.0  # times as much left of a run as of the others, each over its own noise (convention)
_SPOILT: Final = 0.5  # of what a fit of all leaves of the others, that one without the run leaves (convention)
_ADDS: Final = 0.01  # part of a variance that a run must take away to be asked what it changes (convention)


@tell_kinds
@on_one_thread
def leave_one_run_out(fit: Fit, *, progress: OnProgress | None = None) -> Fit:
    """Fit without each run in turn, predict it, and see what it changes.

    Each fit starts at the fit of all runs and keeps the noise that was found there, so it takes a few steps.
    What leaving a run out changes is compared with its own variance: with the pseudo-inverses A of both fits and the
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
    with reporting_to(progress):
        for number, (record, label) in enumerate(zip(records, named, strict=True)):
            with part("", number / len(records), (number + 1) / len(records)):
                stage(f"predicting {label} from the other runs", 0.0, 1.0, 10)
                found.append(_without(fit, result, record, label))
    others = [finding for finding in fit.findings if finding.code != "run-stands-out"]
    misfits = {label: _misfit(result.problem, record) for record, label in zip(records, named, strict=True)}
    return changed(fit, left_out=tuple(found), findings=(*others, *_deviates(fit, found, misfits)))


def _misfit(problem: Problem, record: PreparedRun) -> dict[str, float]:
    """What the fit leaves of each output of a run, over the noise between its neighbouring readings."""
    return {
        output: problem.noise[record.place, output] / reading.noise
        for output, reading in record.readings.items()
        if (record.place, output) in problem.noise and reading.noise > 0.0
    }


def _without(fit: Fit, result: Estimate, record: PreparedRun, label: str) -> LeftOut:
    whole, theta = result.problem, result.solution.theta
    others, kept = _problem_without(whole, record.place)
    begin = theta[kept]
    solution = descend(others, begin, evaluations=EVALUATIONS)
    here, before = solution.evaluation, result.solution.evaluation
    order = Order(whole.in_reference(theta, whole.records[0].place))
    errors, were = entry_errors(here), entry_errors(before)[kept]
    shared = [place for place, unknown in enumerate(others.unknowns) if is_of_strip(unknown)]
    own = [unknown for column, unknown in enumerate(whole.unknowns) if column not in kept and is_of_strip(unknown)]
    without_value = [
        unknown for unknown in own if sum(other.base == unknown.base for other in others.unknowns) < FEWEST
    ]
    known = [place for place in shared if errors[place] <= _most(others, solution.theta, place)]
    lost = [
        order(others.unknowns[place].name)
        for place in shared
        if place not in known and fit.parameters[order(others.unknowns[place].name)].determined
    ]
    # A valley that the fit of all leaves open is no straight line, and each fit of others would slide along it.
    open_ones = [place for place in shared if not fit.parameters[order(others.unknowns[place].name)].determined]
    shifts, p_value = _change(result, others, solution, kept, open_ones)
    left = LeftOut(
        label,
        undetermined=(*lost, *(order(unknown.name) for unknown in without_value)),
        shifts={order(others.unknowns[place].name): shift for place, shift in shifts.items()},
        p_value=p_value,
        left_of_others=_left(others, here, others.evaluate(begin)),
    )
    if np.isinf(errors[shared][np.isfinite(were[shared])]).any():
        return left  # along what they do not show at all the others would stand where this run put them
    covariance = _covariance(result.correlated, others, _by_readings(here))
    theirs = OtherRuns(fit, others, solution.theta, covariance, order)
    try:
        itself = found_on_itself(whole, theta, theirs, kept, record) if own else None
        judged = predicted_by(theirs, record, itself)
        scored = judged if without_value or itself is None else predicted_by(theirs, record, None)
    except IpmclabError:  # the others put the strip where no prediction is finite
        return left
    return replace(
        left,
        fit_percent={name: s.fit_percent for name, s in scored.scores.items() if s.fit_percent is not None},
        rmse={name: s.rmse for name, s in scored.scores.items() if s.rmse is not None},
        inside={name: _inside(scored.compared[name], reach) for name, reach in scored.reach.items()},
        standardised={
            name: _standardised(judged.compared[name], reach, len(own)) for name, reach in judged.reach.items()
        },
    )


def _left(problem: Problem, here: Evaluation, before: Evaluation) -> dict[str, float]:
    """What is left of each output at a point, over what was left of it before (rms), where little else is missing."""
    squares: dict[str, tuple[float, float]] = {}
    for key, piece in problem.pieces.items():
        now, then = (problem.squares(key, there.residual[piece]) for there in (here, before))
        rms = problem.noise[key] * math.sqrt(now / max(piece.stop - piece.start, 1))
        if rms > _AT_FLOOR * problem.record_at(key[0]).readings[key[1]].noise:
            now = np.inf
        of_now, of_then = squares.get(key[1], (0.0, 0.0))
        squares[key[1]] = of_now + now, of_then + then
    return {name: math.sqrt(now / then) for name, (now, then) in squares.items() if then > 0.0 and now < np.inf}


def _change(
    result: Estimate, others: Problem, solution: Solution, kept: list[int], held: Sequence[int]
) -> tuple[dict[int, float], float]:
    """What leaving the run out changes while some entries stay: each in standard errors, and a p-value of all."""
    begin, before = result.solution.theta[kept], result.solution.evaluation
    moved = [place for place in range(len(kept)) if place not in held]
    found = descend(Held(others, begin, moved), begin[moved], evaluations=EVALUATIONS) if held else solution
    gone = {kept[place] for place in held}
    columns = [column for column in range(len(before.rows) - 1) if column not in gone]
    of_all = Evaluation(before.rows[[*columns, -1]], before.beforehand)
    places = [columns.index(kept[place]) for place in moved]
    theirs = _by_readings(found.evaluation)
    covariance = _covariance(result.correlated, others, theirs)
    of_change = _covariance_of_change(result.correlated, others, theirs, _by_readings(of_all)[:, places])
    errors = entry_errors(found.evaluation)
    known = [
        number
        for number, place in enumerate(moved)
        if is_of_strip(others.unknowns[place]) and errors[number] <= _most(others, begin, place)
    ]
    shifts, p_value = _shift(found.theta - begin[moved], covariance, of_change, known)
    return {moved[number]: shift for number, shift in shifts.items()}, p_value


def _problem_without(whole: Problem, place: int) -> tuple[Problem, list[int]]:
    """The problem of the other runs under the same noise, and which entries it has."""
    return problem_of(whole, [record for record in whole.records if record.place != place])


def _most(problem: Problem, theta: FloatArray, place: int) -> float:
    """The error of an entry up to which it is determined."""
    return DETERMINED if problem.unknowns[place].log else DETERMINED * max(abs(float(theta[place])), 1.0)


def _inverse(here: Evaluation) -> FloatArray:
    """Of the normal equations, without directions of which nothing is known: these are recognised by angles
    between columns, not by sizes.

    A prior a billion times as sharp as the readings would else count them as nothing.
    """
    singular, directions, _, size = here.scaled_spectrum
    determined = singular > STRUCTURAL * singular.max(initial=0.0)
    inverse = directions[determined].T / singular[determined] / size[:, None]
    return np.asarray(inverse @ inverse.T)


def _by_readings(here: Evaluation) -> FloatArray:
    """How far each reading moves each entry, shape (n_residual, n_unknown)."""
    return here.jacobian @ _inverse(here)


def _covariance(under: Correlated, others: Problem, theirs: FloatArray) -> FloatArray:
    """Of what the other runs find by their readings, under the noise that was found."""
    known = theirs[len(theirs) - len(_priors(others)) :]
    covariance = known.T @ known
    for key, piece in others.pieces.items():
        covariance += under.covariance_of(theirs[piece], key)
    return covariance


def _covariance_of_change(under: Correlated, others: Problem, theirs: FloatArray, every: FloatArray) -> FloatArray:
    """Of what leaving the run out changes, by the readings of the others and by every one, under the same noise."""
    of_theirs, of_every = _priors(others), _priors(under.problem)
    known = -every[len(every) - len(of_every) :]
    known[[of_every.index(name) for name in of_theirs]] += theirs[len(theirs) - len(of_theirs) :]
    of_change = known.T @ known
    for key, piece in under.problem.pieces.items():
        if key in others.pieces:
            of_change += under.covariance_of(theirs[others.pieces[key]] - every[piece], key)
        else:
            # What it leaves may be of another strip: its noise is taken to be that of the others.
            of_change += _as_in_others(under, key, others).covariance_of(-every[piece], key)
    return of_change


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
    moved: FloatArray, others: FloatArray, of_change: FloatArray, known: list[int]
) -> tuple[dict[int, float], float]:
    """Each change in its own standard errors, and the p-value of all of them together."""
    from scipy.special import chdtrc

    if not known:
        return {}, 1.0
    size = np.sqrt(others.diagonal()[known])
    variance = of_change[np.ix_(known, known)] / np.outer(size, size)
    change = moved[known] / size
    own = variance.diagonal()
    shifts = {place: float(change[k] / math.sqrt(own[k])) if own[k] > _ADDS else 0.0 for k, place in enumerate(known)}
    values, vectors = np.linalg.eigh(variance)
    informative = values > _ADDS
    square = float(np.sum((vectors[:, informative].T @ change) ** 2 / values[informative]))
    return shifts, float(chdtrc(int(informative.sum()), square)) if informative.any() else 1.0


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


def _deviates(fit: Fit, runs: Sequence[LeftOut], misfits: Mapping[str, Mapping[str, float]]) -> list[Finding]:
    """That a run is not like the others: of the significant ones that which the others predict worst.

    One that is of another strip spoils what the others say of each other, so that those may be as significant. Where
    all that it contradicts counts as noise none is: then it spoils what is left of the others, or is met far worse.
    """
    if any(finding.code == "mountings-differ" for finding in fit.findings):
        return []  # where mountings differ, every run is unlike those of the others
    significant = [one for one in runs if _chance(one) < REJECT / len(runs)]
    if not significant:
        return _spoils(runs) or _is_met_worse(runs, misfits)
    one = max(significant, key=lambda one: (max(one.standardised.values(), default=0.0), -_chance(one)))
    are_two = len(runs) == 2
    if one.p_value == _chance(one):
        most = max(one.shifts, key=lambda name: abs(one.shifts[name]))
        without = one.label if are_two else "it"
        why = f"without {without} {most} changes by {abs(one.shifts[most]):.3g} standard errors"
    else:
        output = max(one.standardised, key=lambda name: one.standardised[name])
        far = f"{one.standardised[output]:.3g} standard deviations (rms)"
        why = f"its {output} lies {far} from what they predict"
        if are_two:
            why = f"the {output} of {one.label} lies {far} from what the other predicts"
    values = {"p_value": _chance(one), **{f"shift.{name}": shift for name, shift in one.shifts.items()}}
    return [_stands_out(one, runs, f" (p < 0.1 %): {why}", values)]


def _spoils(runs: Sequence[LeftOut]) -> list[Finding]:
    """That the others are met far better without a run."""
    if len(runs) == 2:
        return []  # one alone is always met better
    every = [(left, one, name) for one in runs for name, left in one.left_of_others.items() if left < _SPOILT]
    if not every:
        return []
    less, one, output = min(every, key=lambda each: each[0])
    why = f"without it the fit leaves {less:.2g} times as much of their {output} (rms)"
    return [_stands_out(one, runs, f": {why}", {f"left.{output}": less})]


def _is_met_worse(runs: Sequence[LeftOut], misfits: Mapping[str, Mapping[str, float]]) -> list[Finding]:
    """That the fit follows the others and not a run."""
    worst = None
    for one in runs:
        for output, own in misfits[one.label].items():
            others = [m[output] for label, m in misfits.items() if label != one.label and output in m]
            at_floor = bool(others) and max(others) < _AT_FLOOR
            if at_floor and own > _FAR_WORSE * max(others) and (worst is None or own > worst[0]):
                worst = own, one, output, max(others)
    if worst is None:
        return []
    own, one, output, most = worst
    why = f"the fit leaves {own:.2g} times the noise of its {output}, and at most {most:.2g} times that of the others'"
    return [_stands_out(one, runs, f": {why}", {f"misfit.{output}": own})]


def _stands_out(one: LeftOut, runs: Sequence[LeftOut], why: str, values: Mapping[str, float]) -> Finding:
    text = f"{one.label} does not fit in with the other runs{why}"
    if len(runs) == 2:
        both = f"{runs[0].label} and {runs[1].label} do not agree"
        text = f"{both}{why}; which of them is out of place two runs cannot show"
    return Finding(
        "run-stands-out",
        "warning",
        text,
        "see whether it is of another mounting or another state of the strip; if so, fit it by itself, or name "
        "what differs in per_run or per_mounting; else the model lacks something that the signals show differently",
        values=values,
    )
