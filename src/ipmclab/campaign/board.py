"""How far a campaign has come, from what it has written alone: a board of samples and experiments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ipmclab.campaign.state import as_begun
from ipmclab.prediction.scores import fit_in_words


@dataclass(frozen=True)
class Square:
    """The runs of one sample in one experiment.

    Parameters
    ----------
    planned, kept, flagged : int
    """

    planned: int
    kept: int
    flagged: int

    def __str__(self) -> str:
        """As people read it."""
        if not self.planned:
            return ""
        flagged = f", {self.flagged} flagged" if self.flagged else ""
        return f"{self.kept} of {self.planned}{flagged}"


@dataclass(frozen=True)
class Board:
    """A campaign at a glance.

    Parameters
    ----------
    title : str
    samples, parts : tuple of str
    squares : mapping of (sample, experiment) to Square
    following : str, optional
        The run that comes next; None where nothing is left.
    models : mapping of sample to str
        How well what was identified of it predicts runs that were not used for it, or why nothing was; empty before.
    """

    title: str
    samples: tuple[str, ...]
    parts: tuple[str, ...]
    squares: Mapping[tuple[str, str], Square]
    following: str | None
    models: Mapping[str, str] = field(default_factory=dict)

    @property
    def done(self) -> int:
        """How many runs need not be recorded any more."""
        return sum(one.kept + one.flagged for one in self.squares.values())

    @property
    def planned(self) -> int:
        """How many runs there are."""
        return sum(one.planned for one in self.squares.values())


def board_of(events: Sequence[Mapping[str, Any]]) -> Board | None:
    """The board of a campaign; None where none was begun.

    Parameters
    ----------
    events : sequence of mapping
        As ``read_events`` gives them.

    Examples
    --------
    >>> plan = ["s1/force/room/step 1 V/1", "s1/force/room/step 1 V/2", "s2/force/room/step 1 V/1"]
    >>> begun = {"event": "campaign", "title": "two strips", "plan": plan}
    >>> board = board_of([begun, {"event": "recorded", "run": plan[0], "verdict": "kept"}])
    >>> str(board.squares["s1", "force"]), board.following, f"{board.done} of {board.planned}"
    ('1 of 2', 's1/force/room/step 1 V/2', '1 of 3')
    """
    begun = as_begun(events)
    if begun is None:
        return None
    plan: list[str] = begun["plan"]
    verdicts = {one["run"]: one["verdict"] for one in events if one["event"] == "recorded"}
    places: dict[tuple[str, str], list[str]] = {}
    for run in plan:
        sample, part, _ = run.split("/", 2)
        places.setdefault((sample, part), []).append(run)
    squares = {
        place: Square(
            len(runs),
            sum(verdicts.get(run) == "kept" for run in runs),
            sum(verdicts.get(run) == "flagged" for run in runs),
        )
        for place, runs in places.items()
    }
    following = next((run for run in plan if verdicts.get(run) not in ("kept", "flagged")), None)
    return Board(
        begun["title"],
        _once(sample for sample, _ in places),
        _once(part for _, part in places),
        squares,
        following,
        _models(events),
    )


def _models(events: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    found: dict[str, list[str]] = {}
    for one in {one["model"]: one for one in events if one["event"] == "model"}.values():
        scores = ", ".join(f"{name} {fit_in_words(score)}" for name, score in one["scores"].items())
        found.setdefault(one["sample"], []).append(one["failure"] or scores or "no other run")
    return {sample: "; ".join(parts) for sample, parts in found.items()}


def _once(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))
