"""Which runs of several strips to record next: the time on the bench goes to the strip that gains most with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ipmclab.fit.fit import Fit
from ipmclab.model import Actuator
from ipmclab.planning.candidates import Allowance
from ipmclab.planning.draws import Samples
from ipmclab.planning.goals import GoalName
from ipmclab.planning.proposal import Proposal, ProposedRun
from ipmclab.planning.propose import INPUTS, check_asked, greedy, inputs_of, proposal_of
from ipmclab.planning.questions import Questions


@dataclass(frozen=True)
class StripsProposal:
    """Runs of several strips to record next.

    Parameters
    ----------
    goal : "parameters", "prediction" or "model"
    of : mapping of sample to Proposal
        The runs of each, and what is expected of them.
    remarks : tuple of str
    """

    goal: GoalName
    of: Mapping[str, Proposal]
    remarks: tuple[str, ...] = ()

    @property
    def runs(self) -> tuple[tuple[str, ProposedRun], ...]:
        """Every run with its sample, in the order in which they are worth most."""
        found = [(sample, run) for sample, one in self.of.items() for run in one.runs]
        return tuple(sorted(found, key=lambda pair: pair[1].number))

    @property
    def time(self) -> float:
        """Of all runs on the bench [s]."""
        return sum(run.time for _, run in self.runs)

    def to_table(self) -> dict[str, Any]:
        """In the types that JSON has."""
        return {
            "goal": self.goal,
            "bench_time": self.time,
            "runs": [{"sample": sample, **run.to_table()} for sample, run in self.runs],
            "samples": {sample: one.to_table() for sample, one in self.of.items()},
            "remarks": list(self.remarks),
        }

    def __str__(self) -> str:
        """A line for each run."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        yield f"{len(self.runs)} runs in {self.time / 60.0:.3g} min"
        for sample, run in self.runs:
            yield f"  {run.number}. {sample}: {run}"

    __repr__ = __str__


def propose_for_strips(
    fits: Mapping[str, Fit],
    ways: Mapping[str, Mapping[str, Allowance]],
    *,
    goal: GoalName = "parameters",
    minutes: float = 15.0,
    inputs: Sequence[str] = INPUTS,
    rival: str | Actuator | Fit | None = None,
    draws: int | Mapping[str, Samples] = 0,
) -> StripsProposal:
    """Propose which runs of several strips to record next.

    What is known of each strip counts as much: the gains of all of them add.

    Parameters
    ----------
    fits : mapping of sample to Fit
    ways : mapping of sample to mapping of experiment to Allowance
        How each can be recorded.
    goal, minutes, inputs, rival
        As ``propose_runs`` takes them.
    draws : int or mapping of sample to Samples

    Raises
    ------
    InputError
        What ``propose_runs`` refuses.

    Examples
    --------
    A strip of which more is known needs fewer further runs.

    >>> from dataclasses import replace
    >>> import numpy as np
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip, fits = load_actuator("friend-2"), {}
    >>> for name, noise in (("a", 1e-5), ("b", 1e-3)):
    ...     run = simulate(strip, "step 1 V", duration=20, rate=20)
    ...     read = run.current + noise * np.random.default_rng(20261123).standard_normal(len(run))
    ...     fits[name] = identify(strip, replace(run, current=read), free="circuit.dc_resistivity")
    >>> ways = {name: {"current": Allowance(longest=40.0, rate=20.0)} for name in fits}
    >>> proposal = propose_for_strips(fits, ways, minutes=6)
    >>> proposal.of["a"].time <= proposal.of["b"].time + 60.0
    True
    """
    asked = inputs_of(inputs)
    for one in fits.values():
        check_asked(one, goal, minutes)
    questions = {
        sample: Questions(
            fit, goal, ways[sample], asked, rival, draws if isinstance(draws, int) else draws.get(sample, 0)
        )
        for sample, fit in fits.items()
    }
    taken = greedy(questions, 60.0 * minutes)
    return StripsProposal(goal, {sample: proposal_of(one, goal, taken[sample]) for sample, one in questions.items()})
