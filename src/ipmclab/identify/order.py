"""The order of what a strip has several of: branches and modes come back fastest first."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final

Key = Callable[[Mapping[str, float], str], float]
"""The time constant [s] of one of a kind, up to a factor that all of the kind share."""

_KINDS: Final[Mapping[str, Key]] = {
    "circuit.branches": lambda values, name: values[f"{name}.resistivity"] * values[f"{name}.permittivity"],
    "relaxation.displacement": lambda values, name: values[f"{name}.time_constant"],
    "relaxation.displacement_pair": lambda values, name: values[f"{name}.time_constant"],
    "relaxation.force": lambda values, name: values[f"{name}.time_constant"],
    "relaxation.force_pair": lambda values, name: values[f"{name}.time_constant"],
    "viscoelastic": lambda values, name: values[f"{name}.damping_ratio"] / values[f"{name}.frequency"],
}
_NUMBERED: Final = re.compile(rf"\b({'|'.join(re.escape(kind) for kind in _KINDS)})\.(\d+)\.")


class Order:
    """Where each branch and mode stands once they are sorted.

    Parameters
    ----------
    values : mapping of name to float [SI]
        Every parameter of the actuator, as the fit found them.

    Examples
    --------
    >>> slow_first = {"relaxation.force.0.time_constant": 9.0, "relaxation.force.1.time_constant": 2.0}
    >>> Order(slow_first)("relaxation.force.0.ratio")
    'relaxation.force.1.ratio'
    """

    def __init__(self, values: Mapping[str, float]) -> None:
        found: dict[str, set[int]] = {}
        for name in values:
            match = _NUMBERED.match(name)
            if match:
                found.setdefault(match[1], set()).add(int(match[2]))
        self._places: dict[tuple[str, int], int] = {}
        for kind, numbers in found.items():
            speed = {number: _KINDS[kind](values, f"{kind}.{number}") for number in sorted(numbers)}
            for new, old in enumerate(sorted(speed, key=speed.__getitem__)):
                self._places[kind, old] = new

    def __eq__(self, other: object) -> bool:
        """Whether everything stands in the same order."""
        return isinstance(other, Order) and self._places == other._places

    def __hash__(self) -> int:
        """Of the places."""
        return hash(tuple(self._places.items()))

    def __call__(self, text: str) -> str:
        """A name, or every name in a sentence, as it is called after sorting."""
        return _NUMBERED.sub(lambda match: f"{match[1]}.{self._places[match[1], int(match[2])]}.", text)
