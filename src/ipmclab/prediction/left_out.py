"""Each run predicted by the others: what a fit says of a run that it never saw, and which run does not fit in."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from ipmclab.identification.search.solve import descend
from ipmclab.identification.search.tangent import STRUCTURAL, entry_errors
from ipmclab.identification.solved import Estimate, solved
from ipmclab.kinds import tell_kinds
from ipmclab.measurement.random_effect import FEWEST
from ipmclab.model.order import Order
from ipmclab.one_thread import on_one_thread
from ipmclab.prediction.by_others import (
    EVALUATIONS,
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
    return changed(fit, left_out=tuple(found), findings=(*others, *_deviates(fit, found)))


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
    moved = solution.theta - begin
    covariance, of_change = _covariances(result.correlated, before, others, here, kept)
    shifts, p_value = _shift(moved, covariance, of_change, known)
    left = LeftOut(
        label,
        undetermined=(*lost, *(order(unknown.name) for unknown in without_value)),
        shifts={order(others.unknowns[place].name): shift for place, shift in shifts.items()},
        p_value=p_value,
    )
    if np.isinf(errors[shared][np.isfinite(were[shared])]).any():
        return left  # along what they do not show at all the others would stand where this run put them
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


def _covariances(
    under: Correlated, before: Evaluation, others: Problem, here: Evaluation, kept: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Of what the other runs find, and of what leaving the run out changes, under the noise that was found."""
    theirs = here.jacobian @ _inverse(here)
    every = (before.jacobian @ _inverse(before))[:, kept]
    covariance, of_change = np.zeros((len(kept), len(kept))), np.zeros((len(kept), len(kept)))
    for key, piece in under.problem.pieces.items():
        change = -every[piece]
        if key in others.pieces:
            own = theirs[others.pieces[key]]
            covariance += under.covariance_of(own, key)
            of_change += under.covariance_of(change + own, key)
        else:
            # What it leaves may be of another strip: its noise is taken to be that of the others.
            of_change += _as_in_others(under, key, others).covariance_of(change, key)
    of_theirs, of_every = _priors(others), _priors(under.problem)
    known = theirs[len(theirs) - len(of_theirs) :]
    change = -every[len(every) - len(of_every) :]
    change[[of_every.index(name) for name in of_theirs]] += known
    return covariance + known.T @ known, of_change + change.T @ change


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


def _deviates(fit: Fit, runs: Sequence[LeftOut]) -> list[Finding]:
    """That a run is not like the others: of the significant ones that which the others predict worst.

    One that is of another strip spoils what the others say of each other, so that those may be as significant.
    """
    significant = [one for one in runs if _chance(one) < REJECT / len(runs)]
    if not significant or any(finding.code == "mountings-differ" for finding in fit.findings):
        return []  # where mountings differ, every run is unlike those of the others
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
    text = f"{one.label} does not fit in with the other runs (p < 0.1 %): {why}"
    if are_two:
        both = f"{runs[0].label} and {runs[1].label}"
        text = f"{both} do not agree (p < 0.1 %): {why}; which of them is out of place two runs cannot show"
    return [
        Finding(
            "run-stands-out",
            "warning",
            text,
            "see whether it is of another mounting or another state of the strip; if so, fit it by itself, or name "
            "what differs in per_run or per_mounting; else the model lacks something that the signals show differently",
            values={"p_value": _chance(one), **{f"shift.{name}": shift for name, shift in one.shifts.items()}},
        )
    ]
