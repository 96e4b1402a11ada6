"""What is proposed to be recorded next, and what is expected of it: data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from ipmclab.planning.candidates import Candidate
from ipmclab.planning.goals import GoalName
from ipmclab.shown import Shown
from ipmclab.units import significant


@dataclass(frozen=True)
class ProposedRun:
    """A run that is worth its time.

    Parameters
    ----------
    candidate : Candidate
    time : float [s]
        On the bench, with rest, hydration and soaking.
    gain : float [nats]
        By how much it brings the goal nearer, after the runs before it.
    remarks : tuple of str
        What is to be thought of before it is recorded.
    experiment : str
        Of a campaign, as which it is recorded.
    number : int
        Its place among the runs of all strips, counted from 1.
    rate : float [Hz]
        Rows each second, at which its information was computed.
    """

    candidate: Candidate
    time: float
    gain: float
    remarks: tuple[str, ...] = ()
    experiment: str = ""
    number: int = 0
    rate: float = 0.0

    @property
    def gain_per_minute(self) -> float:
        """Gain for each minute on the bench [nats/min]."""
        return 60.0 * self.gain / self.time

    def __str__(self) -> str:
        """The run in words."""
        where = "" if self.candidate.condition is None else f" at {self.candidate.condition}"
        return f"{self.candidate.signal} for {self.candidate.duration:g} s{where}"

    def to_table(self) -> dict[str, Any]:
        """In the types that JSON has."""
        condition = self.candidate.condition
        return {
            "number": self.number or None,
            "experiment": self.experiment or None,
            "signal": str(self.candidate.signal),
            "duration": self.candidate.duration,
            "rate": self.rate or None,
            "condition": None if condition is None else str(condition),
            "bench_time": self.time,
            "gain": self.gain,
            "gain_per_minute": self.gain_per_minute,
            "remarks": list(self.remarks),
        }


@dataclass(frozen=True)
class Expected:
    """One parameter before and after the runs of a plan.

    Parameters
    ----------
    name, unit : str
    value : float [SI]
    before, after : float
        Standard error: of the logarithm, or of the value [SI] where it may be zero; infinite where a direction that
        moves it stays open.
    interval_before, interval_after : pair of float [SI]
        95 %.
    determined_before, determined_after : bool
    is_log : bool
        Whether the entry is a logarithm.
    """

    name: str
    unit: str
    value: float
    before: float
    after: float
    interval_before: tuple[float, float]
    interval_after: tuple[float, float]
    determined_before: bool
    determined_after: bool
    is_log: bool = True


@dataclass(frozen=True, eq=False)
class Proposal(Shown):
    """Runs to record next.

    Parameters
    ----------
    goal : "parameters", "prediction" or "model"
    runs : tuple of ProposedRun
        In the order in which they are worth most; each counts on those before it.
    best_of_kind : tuple of ProposedRun
        Of each kind of signal the run that would be worth most as the next one, the best first.
    expected : tuple of Expected
        Each parameter of the fit.
    rank_before, rank_after : int
        Combinations of the parameters that the readings determine at all.
    predicted : mapping of output to pair of float
        Root mean square error of what is predicted for the inputs, over that of the answer, before and after.
    evidence : mapping of rival to pair of float
        By how many standard errors the rival would differ if it is true, by the runs alone: after the first one
        and after all. Of a stage whose size nobody knows, for the amount that its name states.
    shows : mapping of rival to mapping of name to (float [SI], unit)
        For a stage the least of it that all runs would show, at two standard errors.
    refused : mapping of limit to int
        How many of the runs that were tried would pass it.
    tried : int
    draws : int
        Over how many values that the strip may have the gains are averaged; errors are then the middle ones. They
        hold at the fitted values with 0.
    remarks : tuple of str
        What the plan depends on.
    """

    goal: GoalName
    runs: tuple[ProposedRun, ...]
    best_of_kind: tuple[ProposedRun, ...]
    expected: tuple[Expected, ...]
    rank_before: int
    rank_after: int
    predicted: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    evidence: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    shows: Mapping[str, Mapping[str, tuple[float, str]]] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    tried: int = 0
    draws: int = 0
    remarks: tuple[str, ...] = ()

    def to_table(self) -> dict[str, Any]:
        """In the types that JSON has."""
        return {
            "goal": self.goal,
            "bench_time": self.time,
            "runs": [one.to_table() for one in self.runs],
            "best_of_kind": [one.to_table() for one in self.best_of_kind],
            "expected": [asdict(one) for one in self.expected],
            "rank": {"before": self.rank_before, "after": self.rank_after},
            "predicted": {name: {"before": one, "after": other} for name, (one, other) in self.predicted.items()},
            "evidence": {name: {"first": one, "all": other} for name, (one, other) in self.evidence.items()},
            "shows": {
                name: {key: {"value": value, "unit": unit} for key, (value, unit) in each.items()}
                for name, each in self.shows.items()
            },
            "refused": dict(self.refused),
            "tried": self.tried,
            "draws": self.draws,
            "remarks": list(self.remarks),
        }

    @property
    def time(self) -> float:
        """Of all runs on the bench [s]."""
        return sum(one.time for one in self.runs)

    def __str__(self) -> str:
        """A line for each run, and one for each parameter."""
        lines = [f"{len(self.runs)} runs in {self.time / 60.0:.3g} min"]
        lines += [f"  {place}. {run}" for place, run in enumerate(self.runs, 1)]
        width = max((len(one.name) for one in self.expected), default=0)
        lines += [
            f"  {one.name:<{width}}  standard error {significant(one.before, 3)} -> {significant(one.after, 3)}"
            for one in self.expected
        ]
        return "\n".join(lines)

    __repr__ = __str__
