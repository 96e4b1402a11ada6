"""The order of what a strip has several of: branches and modes come back fastest first."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.model.kinds import edition, kinds


class Order:
    """Where each branch and mode stands once they are sorted.

    Parameters
    ----------
    values : mapping of name to float [SI]
        Every parameter of the actuator, as the fit found them.
    among : iterable of str, optional
        Names of parameters: only branches and modes that have one among them are sorted.

    Examples
    --------
    >>> slow_first = {"relaxation.force.0.time_constant": 9.0, "relaxation.force.1.time_constant": 2.0}
    >>> Order(slow_first)("relaxation.force.0.ratio")
    'relaxation.force.1.ratio'
    """

    def __init__(self, values: Mapping[str, float], among: Iterable[str] | None = None) -> None:
        speeds, self._numbered = _speeds(edition())
        found: dict[str, set[int]] = {}
        for name in values if among is None else among:
            match = self._numbered.search(name)
            if match:
                found.setdefault(match[1], set()).add(int(match[2]))
        self._places: dict[tuple[str, int], int] = {}
        for kind, numbers in found.items():
            speed = {number: speeds[kind](values, f"{kind}.{number}") for number in sorted(numbers)}
            for new, old in enumerate(sorted(speed, key=speed.__getitem__)):
                self._places[kind, old] = new

    def __eq__(self, other: object) -> bool:
        """Whether everything stands in the same order."""
        return isinstance(other, Order) and self._places == other._places

    def holds(self, values: Mapping[str, Any]) -> npt.NDArray[np.bool_]:
        """Whether strips stand in this order, each value a number or an array of shape (n,); shape (n,), or ()."""
        speeds, _ = _speeds(edition())
        found = np.bool_(True)
        latest: dict[str, Any] = {}
        for (kind, number), _ in sorted(self._places.items(), key=lambda one: one[1]):
            speed = speeds[kind](values, f"{kind}.{number}")
            found = found & (latest.get(kind, -np.inf) <= speed)
            latest[kind] = speed
        return np.asarray(found)

    def __hash__(self) -> int:
        """Of the places."""
        return hash(tuple(self._places.items()))

    def __call__(self, text: str) -> str:
        """A name, or every name in a sentence, as it is called after sorting."""
        return self._numbered.sub(lambda match: f"{match[1]}.{self._places[match[1], int(match[2])]}.", text)


def exchangeable(names: Iterable[str]) -> list[list[str]]:
    """Names of parameters in groups: branches and modes of one kind are in one if the same of each is named.

    What is known of one alone cannot be said of another.

    Examples
    --------
    >>> exchangeable(["relaxation.force.0.ratio", "relaxation.force.1.ratio", "relaxation.force.1.time_constant"])
    [['relaxation.force.0.ratio'], ['relaxation.force.1.ratio', 'relaxation.force.1.time_constant']]
    """
    _, numbered = _speeds(edition())
    own: dict[tuple[str, str], list[str]] = {}
    for name in names:
        match = numbered.search(name)
        if match:
            own.setdefault((match[1], match[2]), []).append(name)
    groups: dict[tuple[str, frozenset[str]], list[str]] = {}
    for (kind, number), named in own.items():
        endings = frozenset(name.replace(f"{kind}.{number}.", "", 1) for name in named)
        groups.setdefault((kind, endings), []).extend(named)
    return list(groups.values())


@lru_cache(maxsize=4)
def _speeds(_edition: int) -> tuple[Mapping[str, Callable[[Mapping[str, float], str], float]], re.Pattern[str]]:
    """How fast one of each kind is that a strip has several of, and their names in a text; many fits ask for it."""
    speeds = {kind.prefix.removesuffix("."): kind.speed for kind in kinds() if kind.speed is not None}
    return speeds, re.compile(rf"\b({'|'.join(map(re.escape, speeds))})\.(\d+)\.")
