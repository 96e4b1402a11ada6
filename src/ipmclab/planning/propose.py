"""Propose the next runs for a fit: those that give most information for the time that they take."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, get_args

from ipmclab.confidence import NORMAL_95
from ipmclab.errors import InputError, unknown_name
from ipmclab.fit.as_fitted import need_as_fitted
from ipmclab.fit.fit import DETERMINED, Fit
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.kinds import tell_kinds
from ipmclab.model import Actuator
from ipmclab.planning.answer import FittedStrip
from ipmclab.planning.candidates import Allowance, Candidate
from ipmclab.planning.draws import Samples
from ipmclab.planning.goals import GoalName
from ipmclab.planning.proposal import Expected, Proposal, ProposedRun
from ipmclab.planning.questions import Belief, Offer, Questions
from ipmclab.planning.run_noise import NOT_EXCLUDED
from ipmclab.rig.safety.limit import words
from ipmclab.signals import parse

INPUTS: Final = ("step 1 V for 40 s", "sine 1 V 0.1 Hz for 40 s", "square 1 V 0.1 Hz for 40 s")
"""What a prediction is wanted for, where nobody says it: the thesis's own signals."""

_USUAL: Final = 40.0  # seconds of an input that does not say how long it lasts


MOST_RUNS: Final = 1000
"""Of a plan: the information of the first ones is known before the last ones come."""


@tell_kinds
def propose_runs(
    fit: Fit,
    *,
    goal: GoalName = "parameters",
    minutes: float = 15.0,
    allowed: Allowance | None = None,
    inputs: Sequence[str] = INPUTS,
    rival: str | Actuator | Fit | None = None,
    draws: int | Samples = 0,
) -> Proposal:
    """Propose which runs to record next: those that give most information for their time on the bench, under its
    limits.

    Steps, sines, squares, triangles, chirps and multisines of several frequencies, amplitudes and lengths are tried on
    the fitted model. The information of each on the parameters, under the noise that the fit found, is added to what
    the fit knows. The run that brings the goal nearest for each minute is taken, then the next one, until the time is
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
    draws : int or Samples
        The goal is averaged over so many values that the strip may have, drawn from the covariance of the fit, or
        over samples of its posterior (``planning.draws.read_samples``); at the fitted values alone with 0.

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
    check_asked(fit, goal, minutes)
    questions = Questions(fit, goal, {"": allowed or Allowance()}, inputs_of(inputs), rival, draws)
    taken = greedy({"": questions}, 60.0 * minutes)[""]
    return proposal_of(questions, goal, taken)


def greedy(questions: Mapping[str, Questions], left: float) -> dict[str, list[Offer]]:
    """Of all strips the best run that still fits into the time, then the best one after it, and so on.

    Parameters
    ----------
    questions : mapping of strip to Questions
    left : float [s]

    Returns
    -------
    taken : mapping of strip to list of Offer
        In their order; the place of each among the runs of all strips is its ``number``.

    Raises
    ------
    InputError
        No run within the limits and the time, none that tells anything, or time for more than ``MOST_RUNS``.
    """
    taken: dict[str, list[Offer]] = {name: [] for name in questions}
    places = {name: one.home for name, one in questions.items()}
    offers = first = {name: one.first_offers for name, one in questions.items()}
    minutes, number = left / 60.0, 0
    _refuse_endless(minutes, [run.time for each in first.values() for run, _ in each])
    while True:
        fitting = {name: [one for one in each if one[0].time <= left][:1] for name, each in offers.items()}
        # What has no rows tells exactly nothing; a gain a little below 0 is the error of what is expected of a run.
        best = [name for name, each in fitting.items() if each and each[0][0].gain != 0.0]
        if not best:
            break
        name = max(best, key=lambda one: fitting[one][0][0].gain_per_minute)
        (run, belief), asked = fitting[name][0], questions[name]
        number += 1
        taken[name].append((replace(asked.with_remarks(run), number=number), belief))
        left -= run.time
        places[name] = run.candidate.condition or places[name]
        offers = {**offers, name: asked.offers(belief, places[name])}
    if not number:
        raise _nothing(list(questions.values()), minutes, [offer for each in first.values() for offer in each])
    return taken


def proposal_of(questions: Questions, goal: GoalName, taken: Sequence[Offer]) -> Proposal:
    """The runs of one strip with what is expected of them."""
    fit, before = questions.fit, questions.start
    after = taken[-1][1] if taken else before
    first = taken[0][1] if taken else before
    errors = before.prediction_errors, after.prediction_errors
    rivals = questions.rivals if taken else ()
    return Proposal(
        goal=goal,
        runs=tuple(run for run, _ in taken),
        best_of_kind=tuple(_best_of_kind(questions.first_offers)),
        expected=tuple(_expected(questions.strip, before, after)),
        rank_before=fit.rank,
        rank_after=max(fit.rank, after.rank),
        predicted={output: (errors[0][output], errors[1][output]) for output in questions.strip.outputs},
        evidence={
            one.name: (math.sqrt(now), math.sqrt(then))
            for one, now, then in zip(rivals, first.evidence, after.evidence, strict=True)
        },
        shows={
            one.name: one.least_shown(math.sqrt(then))
            for one, then in zip(rivals, after.evidence, strict=True)
            if one.direction is not None
        },
        refused=dict(questions.refused),
        tried=questions.tried,
        draws=len(questions.strips) if questions.strips[0] is not questions.strip else 0,
        remarks=tuple(_remarks(fit, goal)),
    )


def _best_of_kind(offers: Sequence[Offer]) -> list[ProposedRun]:
    kinds: dict[str, ProposedRun] = {}
    for run, _ in offers:
        kinds.setdefault(run.candidate.signal.word, run)
    return list(kinds.values())


def inputs_of(texts: Sequence[str]) -> list[Candidate]:
    """The signals for which a prediction is wanted, as runs."""
    signals = [parse(text) for text in texts]
    if not signals:
        raise InputError(
            "no input is named for which a prediction is wanted",
            code="no-inputs",
            where="inputs",
            repair="name signals such as 'step 1 V for 40 s'",
        )
    return [Candidate(one, one.duration if math.isfinite(one.duration) else _USUAL) for one in signals]


def _expected(strip: FittedStrip, before: Belief, after: Belief) -> Iterator[Expected]:
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
    """What the plan depends on."""
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


def _refuse_endless(minutes: float, times: Sequence[float]) -> None:
    """Refuse a time that holds more runs than can be thought through: each is compared with all others again."""
    if times and 60.0 * minutes > MOST_RUNS * min(times):
        most = MOST_RUNS * min(times) / 60.0
        raise InputError(
            f"{minutes:.6g} min have room for {60.0 * minutes / min(times):.3g} runs, a plan has at most {MOST_RUNS}",
            code="out-of-range",
            where="minutes",
            repair=f"give {math.floor(most)} min or less, and plan again once these runs are recorded",
        )


def _nothing(questions: Sequence[Questions], minutes: float, offers: Sequence[Offer]) -> InputError:
    if any(run.time <= 60.0 * minutes for run, _ in offers):
        return InputError(
            "no run within the limits tells anything of what is asked",
            code="no-run",
            where="allowed",
            repair="allow longer signals, or a larger voltage",
        )
    if offers:
        least = min(run.time for run, _ in offers) / 60.0
        return InputError(
            f"the shortest run takes {least:.3g} min on the bench, and there are {minutes:g} min",
            code="no-time",
            where="minutes",
            repair=f"give {math.ceil(least)} min or more, or a shorter rest",
        )
    refused = sum((one.refused for one in questions), Counter[str]())
    tried = sum(one.tried for one in questions)
    limits = ", ".join(f"{words(name)} ({count})" for name, count in refused.most_common())
    why = f"each of the {tried} runs would pass a limit: {limits}" if tried else "no run is allowed"
    return InputError(why, code="no-run", where="allowed", repair="allow more, or a smaller voltage")


def check_asked(fit: Fit, goal: str, minutes: float) -> None:
    """Refuse what cannot be asked of a fit.

    Raises
    ------
    InputError
        A fit of another actuator, one without a free parameter, an unknown goal, a time that is not above 0.
    """
    need_as_fitted(fit)
    if not any(name in fit.parameters for name in FittedStrip(fit).names):
        raise InputError(
            "the fit has no parameter that the next run shares",
            code="nothing-free",
            where="fit",
            repair="identify with free parameters that all runs share",
        )
    if goal not in get_args(GoalName):
        raise unknown_name("goal", goal, get_args(GoalName), where="goal")
    if not (math.isfinite(minutes) and minutes > 0.0):
        raise InputError(
            f"the time is {minutes:g} min, it must be above 0",
            code="out-of-range",
            where="minutes",
            repair="give the time that the bench is yours, such as 15",
        )
