"""The blocks of a structure written out as one function of its parameters.

A stage is asked once for its block, with terms in place of numbers: what it does with them is written down, line by
line, and becomes a function that does the same with numbers, in the same order and with the same digits. It takes a
fraction of the time that the stages take, which look up names and fill matrices. A stage that does more than
arithmetic, such as solving equations, is no such function, and is asked each time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from ipmclab.model.blocks import Block
from ipmclab.model.structure import Structure

FloatArray = npt.NDArray[np.float64]


class _Term:
    """A number that is not known yet, by the name that it has in the function."""

    def __init__(self, name: str, lines: list[str]) -> None:
        self.name, self._lines = name, lines

    def _made(self, operation: str, *terms: Any) -> _Term:
        if not all(isinstance(term, (_Term, float, int)) for term in terms):
            raise TypeError("no plain number")
        name = f"t{len(self._lines)}"
        self._lines.append(f"{name} = {operation.format(*map(_shown, terms))}")
        return _Term(name, self._lines)

    def __add__(self, other: Any) -> _Term:
        return self._made("{} + {}", self, other)

    def __radd__(self, other: Any) -> _Term:
        return self._made("{} + {}", other, self)

    def __sub__(self, other: Any) -> _Term:
        return self._made("{} - {}", self, other)

    def __rsub__(self, other: Any) -> _Term:
        return self._made("{} - {}", other, self)

    def __mul__(self, other: Any) -> _Term:
        return self._made("{} * {}", self, other)

    def __rmul__(self, other: Any) -> _Term:
        return self._made("{} * {}", other, self)

    def __truediv__(self, other: Any) -> _Term:
        return self._made("{} / {}", self, other)

    def __rtruediv__(self, other: Any) -> _Term:
        return self._made("{} / {}", other, self)

    def __pow__(self, other: Any) -> _Term:
        return self._made("{} ** {}", self, other)

    def __neg__(self) -> _Term:
        return self._made("-{}", self)

    def _decided(self, *_: Any) -> NoReturn:
        """What hangs on the number itself is no line that holds for all numbers."""
        raise TypeError("a stage that decides by its parameters is not written out")

    __bool__ = __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _decided
    __hash__ = None  # type: ignore[assignment]


class _Terms(Mapping[str, Any]):
    """The parameters as terms; it knows which were asked for."""

    def __init__(self, names: Iterable[str], lines: list[str]) -> None:
        self._names, self._lines = tuple(names), lines
        self.asked: dict[str, _Term] = {}

    def __getitem__(self, name: str) -> _Term:
        if name not in self._names:
            raise KeyError(name)
        return self.asked.setdefault(name, _Term(f"p{len(self.asked)}", self._lines))

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@dataclass(frozen=True, eq=False)
class WrittenOut:
    """The blocks of a structure.

    Parameters
    ----------
    blocks : tuple of Block
        Their matrices hold no numbers.
    names : tuple of str
        The parameters on which they depend.
    function : callable
        From the values of these to the entries (``cascade.entries_of``).
    """

    blocks: tuple[Block, ...]
    names: tuple[str, ...]
    function: Callable[..., tuple[float, ...]]

    def entries(self, values: Mapping[str, float]) -> FloatArray:
        """The entries of the blocks for these parameters [SI]."""
        return np.array(self.function(*[values[name] for name in self.names]), dtype=np.float64)

    def entries_of_many(self, values: Mapping[str, Any], sets: int) -> FloatArray:
        """The same for many parameter sets, those of which there are many as arrays: shape (n_sets, n_entries)."""
        columns = self.function(*[values[name] for name in self.names])
        found = np.empty((sets, len(columns)))
        for place, column in enumerate(columns):
            found[:, place] = column
        return found


def written_out(structure: Structure) -> WrittenOut | None:
    """The blocks of a structure written out; None where its stages do more than arithmetic.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> strip = load_actuator("friend-2")
    >>> found = written_out(strip.structure)
    >>> first = strip.blocks()[0]
    >>> found.entries(strip.parameter_values)[:4].reshape(2, 2).tolist() == first.a.tolist()
    True
    """
    lines: list[str] = []
    terms = _Terms(structure.declarations, lines)
    try:
        blocks = structure.blocks(terms)
        entries = [_shown(entry) for b in blocks for matrix in (b.a, b.b, b.c, b.d) for entry in matrix.flat]
    except (TypeError, ValueError, AttributeError, ArithmeticError):
        return None
    body = "".join(f"    {line}\n" for line in lines)
    parameters = ", ".join(term.name for term in terms.asked.values())
    source = f"def entries({parameters}):\n{body}    return ({', '.join(entries)},)\n"
    made: dict[str, Any] = {}
    exec(compile(source, __file__, "exec"), {}, made)
    return WrittenOut(blocks, tuple(terms.asked), made["entries"])


def _shown(term: Any) -> str:
    """A term by its name, a number with all its digits."""
    return term.name if isinstance(term, _Term) else repr(float(term))
