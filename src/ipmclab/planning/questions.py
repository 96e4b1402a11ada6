"""What is asked of a fitted strip: the runs within the limits, the information of each, and what is known after it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.fit.fit import Fit
from ipmclab.identification.diagnostics.score_directions import one_step_along
from ipmclab.model import Actuator
from ipmclab.model.environment import Environment
from ipmclab.planning.answer import Answer, FittedStrip
from ipmclab.planning.candidates import Allowance, Candidate
from ipmclab.planning.draws import Samples, drawn_strips
from ipmclab.planning.goals import Goal, GoalName, Model, Parameters, Prediction
from ipmclab.planning.information import RunInformation, information_of
from ipmclab.planning.knowledge import Knowledge
from ipmclab.planning.proposal import ProposedRun
from ipmclab.planning.rivals import Rival, rivals_of
from ipmclab.planning.run_noise import RunNoise
from ipmclab.rig.safety.limit import words
from ipmclab.ties import largest_first

FloatArray = npt.NDArray[np.float64]

RATE: Final = 50.0
"""Rows each second, where the noise of a fit does not say how often it was read."""


@dataclass(frozen=True, eq=False)
class Belief:
    """What is known of a strip: at its fitted values, or at each of the values that it may have.

    Parameters
    ----------
    known : tuple of Knowledge
        At each of the values.
    aims : tuple of Goal
        What further runs are for, at each of them.
    predicted : tuple of Prediction
    """

    known: tuple[Knowledge, ...]
    aims: tuple[Goal, ...]
    predicted: tuple[Prediction, ...]

    def after(self, informations: Sequence[RunInformation]) -> Belief:
        """What is known after a further run."""
        known = tuple(one.after(each) for one, each in zip(self.known, informations, strict=True))
        return replace(self, known=known)

    @cached_property
    def loss(self) -> float:
        """How far the goal is away, on average over the values [nats]."""
        return float(np.mean([aim.loss(one) for aim, one in zip(self.aims, self.known, strict=True)]))

    @property
    def errors(self) -> FloatArray:
        """Standard error of each entry, shape (n,): the middle one over the values."""
        return np.asarray(np.median([one.errors for one in self.known], axis=0))

    @property
    def open(self) -> npt.NDArray[np.bool_]:
        """Entries of which nothing is known at most of the values, shape (n,)."""
        return np.asarray(np.mean([one.open for one in self.known], axis=0) > 0.5)

    @property
    def rank(self) -> int:
        """Combinations of the entries that the readings determine at all."""
        return int(np.median([one.rank for one in self.known]))

    @property
    def evidence(self) -> tuple[float, ...]:
        """Mean squared standard errors by which each rival differs, if it is true."""
        return tuple(np.mean([one.evidence for one in self.known], axis=0).tolist())

    @property
    def prediction_errors(self) -> dict[str, float]:
        """Root mean square error of the prediction of each output, over that of the answer."""
        each = [one.errors(known) for one, known in zip(self.predicted, self.known, strict=True)]
        return {name: math.sqrt(float(np.mean([one[name] ** 2 for one in each]))) for name in each[0]}


Offer = tuple[ProposedRun, Belief]
"""A run, and what is known after it."""


class Questions:
    """The runs of a strip within the limits, and the information of each.

    Parameters
    ----------
    fit : Fit
    goal : "parameters", "prediction" or "model"
    ways : mapping of experiment to Allowance
        The ways in which it can be recorded; one without a name where there is only one.
    inputs : sequence of Candidate
        For which a prediction is wanted.
    rival : str, Actuator, Fit or None
    draws : int or Samples
        At how many values that the strip may have it is asked; at those of the fit with 0.
    """

    def __init__(
        self,
        fit: Fit,
        goal: GoalName,
        ways: Mapping[str, Allowance],
        inputs: Sequence[Candidate],
        rival: str | Actuator | Fit | None,
        draws: int | Samples,
    ) -> None:
        self.fit, self.ways = fit, ways
        self.strip = FittedStrip(fit)
        self.strips = drawn_strips(self.strip, draws)
        self.home = self.strip.last_condition
        self._noise = {output: RunNoise.of(fit, output) for output in self.strip.outputs}
        most = max(one.limits.voltage.most for one in ways.values())
        self.rivals = rivals_of(self.strip, rival, most) if goal == "model" else ()
        self.tried, self.refused = 0, Counter[str]()
        self._doubts: dict[tuple[str, Candidate], str] = {}
        self._told: list[tuple[str, Candidate, tuple[RunInformation, ...]]] = []
        for name, allowed in ways.items():
            self._ask(name, allowed)
        rate = max(self._rate(one) for one in ways.values())
        predicted = tuple(Prediction.of([one.answer(each, rate) for each in inputs]) for one in self.strips)
        before = Knowledge.of(self.strip)
        aims: tuple[Goal, ...] = predicted if goal == "prediction" else (Parameters(),) * len(self.strips)
        if goal == "model":
            informations = [each for _, _, each in self._told]
            aims = tuple(Model.of([before.after(each[k]) for each in informations]) for k in range(len(self.strips)))
        self.start = Belief((before,) * len(self.strips), aims, predicted)

    @cached_property
    def first_offers(self) -> list[Offer]:
        """What each run would gain as the very next one."""
        return self.offers(self.start, self.home)

    def offers(self, belief: Belief, place: Environment | None) -> list[Offer]:
        """What each run would gain as the next one, the most for a minute first."""
        found = []
        for name, candidate, informations in self._told:
            after = belief.after(informations)
            time = self.ways[name].time(candidate, place)
            gain, rate = belief.loss - after.loss, self._rate(self.ways[name])
            found.append((ProposedRun(candidate, time, gain, experiment=name, rate=rate), after))
        return [found[k] for k in largest_first([run.gain_per_minute for run, _ in found])]

    def with_remarks(self, run: ProposedRun) -> ProposedRun:
        """A run with what is to be thought of before it is recorded."""
        one, allowed = run.candidate, self.ways[run.experiment]
        said = allowed.limits.remarks(one.signal, one.duration, self._rate(allowed))
        doubt = self._doubts.get((run.experiment, one))
        return replace(run, remarks=(*said, doubt) if doubt else said)

    def _rate(self, allowed: Allowance) -> float:
        steps = [one.step for one in self._noise.values() if one.step > 0.0]
        return allowed.rate or (1.0 / min(steps) if steps else RATE)

    def _ask(self, name: str, allowed: Allowance) -> None:
        rate = self._rate(allowed)
        noise = {output: one for output, one in self._noise.items() if output in (allowed.reads or self._noise)}
        shown = {"voltage", "current", *noise}
        rivals = [[_at(one, strip) for one in self.rivals] for strip in self.strips]
        for candidate in allowed.candidates(rate):
            self.tried += 1
            answers = [strip.answer(candidate, rate) for strip in self.strips]
            limits = [allowed.refusal(candidate, _readings(one, shown), rate) for one in answers]
            passed = Counter(one for one in limits if one)
            if 2 * passed.total() > len(limits):
                self.refused[passed.most_common(1)[0][0]] += 1
                continue
            if passed:
                limit = words(passed.most_common(1)[0][0])
                self._doubts[name, candidate] = (
                    f"the strip may pass the limit of the {limit}: it does so at {passed.total()} of {len(limits)} "
                    "values that the fit allows"
                )
            informations = tuple(
                information_of(
                    answer, noise, rate, [strip.difference_to(one.actuator, candidate, answer) for one in its]
                )
                for strip, answer, its in zip(self.strips, answers, rivals, strict=True)
            )
            self._told.append((name, candidate, informations))


def _readings(answer: Answer, shown: set[str]) -> dict[str, FloatArray]:
    return {name: each for name, each in {"voltage": answer.voltage, **answer.outputs}.items() if name in shown}


def _at(rival: Rival, strip: FittedStrip) -> Rival:
    """A stage that the strip may lack, given to the strip at other values; another model stays as it is."""
    along = rival.direction
    return rival if along is None else replace(rival, actuator=one_step_along(along, strip.actuator))
