"""Each run predicted by the others: what a fit says of a run that it never saw, and which run does not fit in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95
from ipmclab.errors import InputError, IpmclabError
from ipmclab.identify.fit_table import changed
from ipmclab.identify.known import covariance_table, known_of
from ipmclab.identify.many_runs.bands import Drive, noise_of, spread_of
from ipmclab.identify.noise.problem import CorrelatedProblem
from ipmclab.identify.observation import Record, model_hold, own_endings
from ipmclab.identify.order import Order
from ipmclab.identify.problem import Evaluation, Problem
from ipmclab.identify.progress import Tell, part, stage, telling
from ipmclab.identify.solve import STRUCTURAL, entry_errors, minimise, polish
from ipmclab.identify.undetermined.diagnosis import DETERMINED
from ipmclab.run import Finding

if TYPE_CHECKING:
    from ipmclab.identify.estimate import Estimate
    from ipmclab.identify.fit import Fit
    from ipmclab.identify.scores import Comparison
    from ipmclab.model import Actuator

FloatArray = npt.NDArray[np.float64]

_SURELY: Final = 1e-3
_ADDS: Final = 0.01  # part of a variance that a run must take away to be asked what it changes
_EVALUATIONS: Final = 100
_NAMED: Final = 2


@dataclass(frozen=True)
class LeftOut:
    """One run, predicted by a fit of the others.

    Parameters
    ----------
    label : str
    fit_percent : mapping of output to float [percent]
        Of the prediction; an output without a score is absent.
    rmse : mapping of output to float [SI]
    inside : mapping of output to float
        Share of the readings inside the 95 % band of the prediction.
    standardised : mapping of output to float
        Root of the mean square of the error over its standard deviation: about 1 for a run like the others. However
        errors hang together, it is beyond 3.3 in one of a thousand such runs at most.
    undetermined : tuple of str
        Parameters that the others alone do not determine.
    shifts : mapping of name to float
        By how much each shared parameter moves when the run is left out, in standard errors of that change.
    unlikely : float
        Probability of a change as large as that if the run is of the same strip and mounting as the others.
    """

    label: str
    fit_percent: Mapping[str, float] = field(default_factory=dict)
    rmse: Mapping[str, float] = field(default_factory=dict)
    inside: Mapping[str, float] = field(default_factory=dict)
    standardised: Mapping[str, float] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()
    shifts: Mapping[str, float] = field(default_factory=dict)
    unlikely: float = 1.0

    @property
    def lacking(self) -> str:
        """That the others do not determine some parameters, in words."""
        if not self.undetermined:
            return ""
        more = f" and {len(self.undetermined) - _NAMED} more" if len(self.undetermined) > _NAMED else ""
        return f"the others do not determine {', '.join(self.undetermined[:_NAMED])}{more}"

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> LeftOut:
        """From what ``to_table`` gave."""
        return cls(**{**table, "undetermined": tuple(table["undetermined"])})

    def to_table(self) -> dict[str, Any]:
        """In the types that TOML has."""
        return {
            "label": self.label,
            "fit_percent": dict(self.fit_percent),
            "rmse": dict(self.rmse),
            "inside": dict(self.inside),
            "standardised": dict(self.standardised),
            "undetermined": list(self.undetermined),
            "shifts": dict(self.shifts),
            "unlikely": self.unlikely,
        }


def leave_one_run_out(fit: Fit, *, progress: Tell | None = None) -> Fit:
    """Fit without each run in turn, predict it, and see what it changes.

    Each fit starts where the fit of all runs stands and keeps the noise that was found there, so it takes a few steps.
    What leaving a run out changes is held against its own variance, which is that of the others less that of all
    (Hausman's test): so a run shows that is of another strip, another state or another mounting.

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
    result = fit.estimate
    if result is None:
        raise InputError(
            "a fit that was read from a file holds no runs to leave out",
            code="fit-without-runs",
            where="fit",
            repair="identify from the runs again, and give that fit",
        )
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


def _without(fit: Fit, result: Estimate, record: Record, label: str) -> LeftOut:
    whole, theta = result.problem, result.solution.theta
    others, kept = _problem_without(whole, record.place)
    begin = theta[kept]
    solution = polish(others, begin) or minimise(others, begin, evaluations=_EVALUATIONS)
    here, before = solution.evaluation, result.solution.evaluation
    order = Order(whole.values(theta, whole.records[0].place))
    errors, were = entry_errors(here), entry_errors(before)[kept]
    shared = [
        place for place, u in enumerate(others.unknowns) if not u.nuisance and not u.base.startswith("observation.")
    ]
    known = [place for place in shared if errors[place] <= _most(others, solution.theta, place)]
    lost = [
        order(others.unknowns[place].name)
        for place in shared
        if place not in known and fit.parameters[order(others.unknowns[place].name)].determined
    ]
    moved = solution.theta - begin
    shifts, unlikely = _shift(moved, _covariance(here), _covariance(before)[np.ix_(kept, kept)], known)
    told = LeftOut(
        label,
        undetermined=tuple(lost),
        shifts={order(others.unknowns[place].name): shift for place, shift in shifts.items()},
        unlikely=unlikely,
    )
    if np.isinf(errors[shared][np.isfinite(were[shared])]).any():
        return told  # along what they do not show at all the others would stand where this run put them
    try:
        return _predicted(told, fit, others, solution.theta, here, record, order)
    except IpmclabError:  # the others put the strip where no prediction is finite
        return told


def _problem_without(whole: Problem, place: int) -> tuple[Problem, list[int]]:
    """The problem of the other runs under the same noise, and which entries it has."""
    kept = [
        column
        for column, unknown in enumerate(whole.unknowns)
        if any(unknown.belongs_to(record.place) for record in whole.records if record.place != place)
    ]
    plain = whole.plain if isinstance(whole, CorrelatedProblem) else whole
    records = [record for record in whole.records if record.place != place]
    fewer = Problem(plain.base, records, [whole.unknowns[column] for column in kept], plain.responder, plain.noise)
    if not isinstance(whole, CorrelatedProblem):
        return fewer, kept
    return CorrelatedProblem(fewer, {key: white for key, white in whole.whitenings.items() if key[0] != place}), kept


def _most(problem: Problem, theta: FloatArray, place: int) -> float:
    """The error of an entry up to which it is determined."""
    return DETERMINED if problem.unknowns[place].log else DETERMINED * max(abs(float(theta[place])), 1.0)


def _covariance(here: Evaluation) -> FloatArray:
    singular, directions = here.spectrum
    seen = singular > STRUCTURAL * singular.max(initial=0.0)
    inverse = directions[seen].T / singular[seen]
    return np.asarray(inverse @ inverse.T)


def _shift(
    moved: FloatArray, others: FloatArray, every: FloatArray, known: list[int]
) -> tuple[dict[int, float], float]:
    """Each change in its own standard errors, and how unlikely all of them together are."""
    from scipy.special import chdtrc

    if not known:
        return {}, 1.0
    size = np.sqrt(others.diagonal()[known])
    variance = (others - every)[np.ix_(known, known)] / np.outer(size, size)
    change = moved[known] / size
    own = variance.diagonal()
    shifts = {place: float(change[k] / math.sqrt(own[k])) if own[k] > _ADDS else 0.0 for k, place in enumerate(known)}
    values, vectors = np.linalg.eigh(variance)
    told = values > _ADDS
    square = float(np.sum((vectors[:, told].T @ change) ** 2 / values[told]))
    return shifts, float(chdtrc(int(told.sum()), square)) if told.any() else 1.0


def _predicted(
    told: LeftOut, fit: Fit, others: Problem, theta: FloatArray, here: Evaluation, record: Record, order: Order
) -> LeftOut:
    """With the scores of a prediction, and the share of readings in its band."""
    from ipmclab.identify.validate import validate

    strip = _strip(fit, others, theta, record, order)
    one = validate(strip, record.run).runs[0]
    compared = {name: found for name, found in one.comparisons.items() if name in record.readings}
    scores = {name: one.scores[name] for name in compared}
    reach = _reach(fit, strip, others, theta, here, record, order, one.delay or 0.0, one.zeros)
    return replace(
        told,
        fit_percent={name: s.fit_percent for name, s in scores.items() if s.fit_percent is not None},
        rmse={name: s.rmse for name, s in scores.items() if s.rmse is not None},
        inside={name: _inside(compared[name], reach[name]) for name in reach if name in compared},
        standardised={name: _standardised(compared[name], reach[name]) for name in reach if name in compared},
    )


def _strip(fit: Fit, others: Problem, theta: FloatArray, record: Record, order: Order) -> Actuator:
    """The actuator as the other runs have it; of what each run has for itself the mean of the others."""
    each = [others.values(theta, other.place) for other in others.records]
    values = {name: float(np.mean([one[name] for one in each])) for name in each[0]}
    for place, unknown in enumerate(others.unknowns):
        if unknown.base in values and unknown.belongs_to(record.place):
            values[unknown.base] = unknown.value(float(theta[place]))
    changes = {order(name): value for name, value in values.items()}
    return replace(fit.actuator.replace(**changes), fit_table=None)


def _reach(
    fit: Fit,
    strip: Actuator,
    others: Problem,
    theta: FloatArray,
    here: Evaluation,
    record: Record,
    order: Order,
    delay: float,
    zeros: Mapping[str, float],
) -> dict[str, FloatArray]:
    """Half the width of the band of each output of which the other runs know the noise."""
    asked = [place for place, unknown in enumerate(others.unknowns) if unknown.base in others.base]
    names = [order(others.unknowns[place].name) for place in asked]
    values = [others.unknowns[place].value(float(theta[place])) for place in asked]
    chains = [others.unknowns[place].chain(value) for place, value in zip(asked, values, strict=True)]
    table = covariance_table(names, _covariance(here)[np.ix_(asked, asked)], chains, {}, {})
    endings = own_endings(record.place, record.run.metadata.mounting_id or "")[1:]
    found = known_of(table, dict(zip(names, values, strict=True)), list(strip.parameter_values), endings)
    seen = [fit.observations[other.place] for other in others.records]
    outputs = [name for name in record.readings if any(name in observation.noise for observation in seen)]
    run = record.run
    spread = spread_of(found, strip, Drive(run.time, run.voltage, model_hold(record), delay), outputs)
    since = run.time - run.time[0]
    return {
        name: NORMAL_95 * np.hypot(spread[name], noise_of(seen, name, since, level=name not in zeros))
        for name in outputs
    }


def _inside(one: Comparison, reach: FloatArray) -> float:
    return float(np.mean(np.abs(one.error[one.used]) <= reach[one.used]))


def _standardised(one: Comparison, reach: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(one.error[one.used] / reach[one.used])))) * NORMAL_95


def _chance(one: LeftOut) -> float:
    """How unlikely a run is, by what it changes or by what the others predict of it.

    A run that does not fit in may pass the first: what it contradicts is taken for noise of its own.
    """
    from scipy.special import erfc

    return min([one.unlikely, *(float(erfc(size / math.sqrt(2.0))) for size in one.standardised.values())])


def _stands_out(fit: Fit, runs: Sequence[LeftOut]) -> list[Finding]:
    """That a run is not like the others: the least likely one, since it spoils what the others say of each other."""
    one = min(runs, key=_chance)
    if _chance(one) >= _SURELY / len(runs) or any(finding.code == "mountings-differ" for finding in fit.findings):
        return []  # where mountings differ, every run is unlike those of the others
    if one.unlikely == _chance(one):
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
            values={"unlikely": _chance(one), **{f"shift.{name}": shift for name, shift in one.shifts.items()}},
        )
    ]
