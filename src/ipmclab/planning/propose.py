"""Propose the next runs for a fit: those that tell most for the time that they take."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, get_args

from ipmclab.confidence import NORMAL_95
from ipmclab.errors import InputError, suggest
from ipmclab.fit.as_fitted import need_as_fitted, need_fit
from ipmclab.fit.fit import DETERMINED, Fit
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.model import Actuator
from ipmclab.model.environment import Environment
from ipmclab.planning.answer import FittedStrip
from ipmclab.planning.candidates import Allowance, Candidate
from ipmclab.planning.goals import Goal, GoalName, Model, Parameters, Prediction
from ipmclab.planning.information import Told, told_by
from ipmclab.planning.knowledge import Knowledge
from ipmclab.planning.proposal import Expected, Proposal, ProposedRun
from ipmclab.planning.rivals import Rival, rivals_of
from ipmclab.planning.run_noise import NOT_EXCLUDED, RunNoise
from ipmclab.rig.safety.limits import words
from ipmclab.signals import parse
from ipmclab.ties import largest_first

RATE: Final = 50.0
"""Rows each second, where the noise of a fit does not say how often it was read."""

INPUTS: Final = ("step 1 V for 40 s", "sine 1 V 0.1 Hz for 40 s", "square 1 V 0.1 Hz for 40 s")
"""What a prediction is wanted for, where nobody says it: the thesis's own signals."""

_USUAL: Final = 40.0  # seconds of an input that does not say how long it lasts


_Offer = tuple[ProposedRun, Knowledge]
"""A run, and what is known after it."""


def propose_runs(
    fit: Fit,
    *,
    goal: GoalName = "parameters",
    minutes: float = 15.0,
    allowed: Allowance | None = None,
    inputs: Sequence[str] = INPUTS,
    rival: str | Actuator | Fit | None = None,
) -> Proposal:
    """Tell which runs to record next: those that tell most for their time on the bench, under its limits.

    Steps, sines, squares, triangles, chirps and multisines of several frequencies, amplitudes and lengths are tried on
    the fitted model. What each would tell of the parameters, under the noise that the fit found, is added to what the
    fit knows. The run that brings the goal nearest for each minute is taken, then the next one, until the time is
    used up. It is the strip's model that is asked: what it lacks, no plan knows.

    Parameters
    ----------
    fit : Fit
        As ``identify`` returned it, or ``read_fit`` read it.
    goal : "parameters", "prediction" or "model"
        Smallest joint interval of the parameters (D-optimal); smallest variance of what is predicted for some inputs
        (I-optimal); largest evidence for or against a rival of the model (T-optimal).
    minutes : float [min]
        Time on the bench.
    allowed : Allowance, optional
        Limits, rests, conditions.
    inputs : sequence of str
        Signals for which a prediction is wanted, each with its length.
    rival : str, Actuator or Fit, optional
        A stage that the model may lack, such as ``leak.exponential``, or another model of the same strip. The stage
        that the fit itself misses where it is left out.

    Returns
    -------
    proposal : Proposal

    Raises
    ------
    InputError
        No fit, an unknown goal, a fit that names no rival, no run within the limits and the time.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> run = simulate(strip, "step 1 V", duration=20, rate=50)
    >>> noise = 1e-4 * np.random.default_rng(20261123).standard_normal(len(run))
    >>> fit = identify(strip, replace(run, current=run.current + noise), free="electrical")
    >>> proposal = propose_runs(fit, minutes=5)
    >>> all(one.after < one.before for one in proposal.expected)
    True
    """
    _check(fit, goal, minutes)
    allowed = allowed or Allowance()
    strip = FittedStrip(fit)
    noise = {output: RunNoise.of(fit, output) for output in strip.outputs}
    steps = [one.step for one in noise.values() if one.step > 0.0]
    rate = allowed.rate or (1.0 / min(steps) if steps else RATE)
    rivals = rivals_of(strip, rival, allowed.limits.voltage.most) if goal == "model" else ()
    questions = _Questions(strip, noise, allowed, rate, rivals)
    before = Knowledge.of(strip)
    predicted = Prediction.of([strip.answer(one, rate) for one in _inputs(inputs)])
    aim: Goal = Parameters() if goal == "parameters" else predicted
    if goal == "model":
        aim = Model.of([before.after(told) for _, told in questions.told])
    offers = questions.offers(before, aim, strip.last_condition)
    taken = _greedy(questions, before, aim, 60.0 * minutes)
    if not taken:
        raise _nothing(questions, minutes, offers)
    first, last = taken[0][1], taken[-1][1]
    errors = predicted.errors(before), predicted.errors(last)
    return Proposal(
        goal=goal,
        runs=tuple(run for run, _ in taken),
        best_of_kind=tuple(_best_of_kind(offers)),
        expected=tuple(_expected(strip, before, last)),
        rank_before=fit.rank,
        rank_after=max(fit.rank, last.rank),
        predicted={output: (errors[0][output], errors[1][output]) for output in strip.outputs},
        evidence={
            one.name: (math.sqrt(now), math.sqrt(then))
            for one, now, then in zip(rivals, first.evidence, last.evidence, strict=True)
        },
        shows={
            one.name: one.least_seen(math.sqrt(then))
            for one, then in zip(rivals, last.evidence, strict=True)
            if one.direction is not None
        },
        refused=dict(questions.refused),
        tried=questions.tried,
        remarks=tuple(_remarks(fit, goal)),
    )


class _Questions:
    """The runs within the limits, and what each would tell."""

    def __init__(
        self,
        strip: FittedStrip,
        noise: Mapping[str, RunNoise],
        allowed: Allowance,
        rate: float,
        rivals: Sequence[Rival],
    ) -> None:
        self.allowed, self.rate = allowed, rate
        self.tried, self.refused = 0, Counter[str]()
        self.home = strip.last_condition
        self.told: list[tuple[Candidate, Told]] = []
        for candidate in allowed.candidates(rate):
            self.tried += 1
            answer = strip.answer(candidate, rate)
            limit = allowed.refusal(candidate, {"voltage": answer.voltage, **answer.outputs}, rate)
            if limit:
                self.refused[limit] += 1
            else:
                apart = [strip.apart(one.actuator, candidate, answer) for one in rivals]
                self.told.append((candidate, told_by(answer, noise, rate, apart)))

    def offers(self, known: Knowledge, aim: Goal, place: Environment | None) -> list[_Offer]:
        """What each run would gain as the next one, the most for a minute first."""
        here = aim.loss(known)
        found = []
        for candidate, told in self.told:
            after = known.after(told)
            run = ProposedRun(candidate, self.allowed.time(candidate, place), here - aim.loss(after))
            found.append((run, after))
        return [found[k] for k in largest_first([run.gain_per_minute for run, _ in found])]

    def with_remarks(self, run: ProposedRun) -> ProposedRun:
        """A run with what is to be thought of before it is recorded."""
        one = run.candidate
        return replace(run, remarks=self.allowed.limits.remarks(one.signal, one.duration, self.rate))


def _greedy(questions: _Questions, known: Knowledge, aim: Goal, left: float) -> list[_Offer]:
    """The best run that still fits into the time, then the best one after it, and so on."""
    found: list[_Offer] = []
    place = questions.home
    while fitting := [one for one in questions.offers(known, aim, place) if one[0].time <= left]:
        run, known = fitting[0]
        found.append((questions.with_remarks(run), known))
        left -= run.time
        place = run.candidate.condition or place
    return found


def _best_of_kind(offers: Sequence[_Offer]) -> list[ProposedRun]:
    kinds: dict[str, ProposedRun] = {}
    for run, _ in offers:
        kinds.setdefault(run.candidate.signal.word, run)
    return list(kinds.values())


def _inputs(texts: Sequence[str]) -> list[Candidate]:
    signals = [parse(text) for text in texts]
    if not signals:
        raise InputError(
            "no input is named for which a prediction is wanted",
            code="no-inputs",
            where="inputs",
            repair="name signals such as 'step 1 V for 40 s'",
        )
    return [Candidate(one, one.duration if math.isfinite(one.duration) else _USUAL) for one in signals]


def _expected(strip: FittedStrip, before: Knowledge, after: Knowledge) -> Iterator[Expected]:
    """Each parameter with what is known of it before and after some runs."""
    for place, (name, unknown) in enumerate(zip(strip.names, strip.unknowns, strict=True)):
        one = strip.fit.parameters[name]
        errors = [math.inf if known.open[place] else float(known.errors[place]) for known in (before, after)]
        sizes = [error if unknown.log else error * unknown.scale for error in errors]
        relative = [size if unknown.log else size / max(abs(one.value), 1e-300) for size in sizes]
        yield Expected(
            name=name,
            unit=one.unit,
            value=one.value,
            before=sizes[0],
            after=sizes[1],
            interval_before=_interval(unknown, one.value, errors[0]),
            interval_after=_interval(unknown, one.value, errors[1]),
            determined_before=one.determined,
            determined_after=relative[1] < DETERMINED or (one.determined and relative[1] <= relative[0]),
            is_log=unknown.log,
        )


def _interval(unknown: Unknown, value: float, error: float) -> tuple[float, float]:
    """95 % within the allowed range."""
    centre, reach = unknown.entry(value), NORMAL_95 * error
    low, high = unknown.value(centre - reach), unknown.value(centre + reach)
    return low, high


def _remarks(fit: Fit, goal: GoalName) -> Iterator[str]:
    """What the plan hangs on."""
    codes = {one.code for one in fit.findings}
    open_ones = [name for name, one in fit.parameters.items() if not one.determined]
    if any(one.severity == "error" for one in fit.findings):
        yield "a record of the fit is wrong, as its findings say: record it again before anything else"
    if open_ones:
        yield (
            f"the fit does not determine {', '.join(open_ones)}, and the plan depends on them: record the first "
            "run, identify again with it, and ask once more"
        )
    if goal != "model" and codes & {"stage-missing", "model-incomplete"}:
        yield "the model lacks something: further runs narrow its intervals and do not make it true; ask for the model"
    if NOT_EXCLUDED in codes:
        yield (
            "no run of the fit would have shown a drift of the sensor: the errors of slow parameters are larger for "
            "it, and a run that turns back makes them smaller than is expected here"
        )


def _nothing(questions: _Questions, minutes: float, offers: Sequence[_Offer]) -> InputError:
    if offers:
        least = min(run.time for run, _ in offers) / 60.0
        return InputError(
            f"the shortest run takes {least:.3g} min on the bench, and there are {minutes:g} min",
            code="no-time",
            where="minutes",
            repair=f"give {math.ceil(least)} min or more, or a shorter rest",
        )
    limits = ", ".join(f"{words(name)} ({count})" for name, count in questions.refused.most_common())
    why = f"each of the {questions.tried} runs would pass a limit: {limits}" if questions.tried else "no run is allowed"
    return InputError(why, code="no-run", where="allowed", repair="allow more, or a smaller voltage")


def _check(fit: Fit, goal: str, minutes: float) -> None:
    need_fit(fit)
    need_as_fitted(fit)
    if not any(name in fit.parameters for name in FittedStrip(fit).names):
        raise InputError(
            "the fit has no parameter that the next run shares",
            code="nothing-free",
            where="fit",
            repair="identify with free parameters that all runs share",
        )
    if goal not in get_args(GoalName):
        raise InputError(
            f"unknown goal {goal!r}", code="unknown-goal", where="goal", repair=suggest(goal, get_args(GoalName))
        )
    if not (math.isfinite(minutes) and minutes > 0.0):
        raise InputError(
            f"the time is {minutes:g} min, it must be above 0",
            code="out-of-range",
            where="minutes",
            repair="give the time that the bench is yours, such as 15",
        )
