"""Numbers that are not known yet: what stages do with them is written down, to be done again with any numbers.

A stage that does more than arithmetic with its parameters, such as solving equations, refuses terms, and so does one
that decides by them: no list of operations holds for all numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, NoReturn

REFUSED: Final = (TypeError, ValueError, AttributeError, ArithmeticError)
"""What is raised where a computation takes no terms."""

PARAMETER, ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, NEGATE = range(-1, 6)
"""What a term is made by."""


class Term:
    """A number that is not known yet: a parameter, or what an operation makes of others.

    The same operation on the same terms is the same term; one that changes nothing makes none.

    Parameters
    ----------
    known : dict
        All terms of one computation.
    operation : int
    given : tuple of Term and float
        What the operation is done to; of a parameter its name.
    """

    __slots__ = ("_known", "given", "operation")

    def __init__(self, known: dict[Any, Term], operation: int, *given: Any) -> None:
        self._known, self.operation, self.given = known, operation, given

    def _made(self, operation: int, *given: Any) -> Term:
        if not all(isinstance(one, (Term, float, int)) for one in given):
            raise TypeError("no plain number")
        key = operation, *(id(one) if isinstance(one, Term) else repr(float(one)) for one in given)
        if key not in self._known:
            self._known[key] = Term(self._known, operation, *given)
        return self._known[key]

    def __add__(self, other: Any) -> Term:
        return self if _is(other, 0.0) else self._made(ADD, self, other)

    def __radd__(self, other: Any) -> Term:
        return self if _is(other, 0.0) else self._made(ADD, other, self)

    def __sub__(self, other: Any) -> Term:
        return self if _is(other, 0.0) else self._made(SUBTRACT, self, other)

    def __rsub__(self, other: Any) -> Term:
        return -self if _is(other, 0.0) else self._made(SUBTRACT, other, self)

    def __mul__(self, other: Any) -> Any:
        if _is(other, 0.0):
            return 0.0
        return self if _is(other, 1.0) else self._made(MULTIPLY, self, other)

    def __rmul__(self, other: Any) -> Any:
        if _is(other, 0.0):
            return 0.0
        return self if _is(other, 1.0) else self._made(MULTIPLY, other, self)

    def __truediv__(self, other: Any) -> Term:
        return self if _is(other, 1.0) else self._made(DIVIDE, self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return 0.0 if _is(other, 0.0) else self._made(DIVIDE, other, self)

    def __pow__(self, other: Any) -> Any:
        if isinstance(other, Term):
            raise TypeError("an exponent that is not known yet")
        if _is(other, 0.0):
            return 1.0
        return self if _is(other, 1.0) else self._made(POWER, self, other)

    def __neg__(self) -> Term:
        return self._made(NEGATE, self)

    def _decided(self, *_: Any) -> NoReturn:
        """What depends on the number itself is no operation that holds for all numbers."""
        raise TypeError("a stage that decides by its parameters takes no terms")

    __bool__ = __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = _decided
    __hash__ = None  # type: ignore[assignment]


def is_zero(entry: Any) -> bool:
    """Whether an entry is a plain 0."""
    return _is(entry, 0.0)


def _is(given: Any, number: float) -> bool:
    return isinstance(given, (float, int)) and given == number


class Terms(Mapping[str, Any]):
    """Parameters as terms, by name."""

    def __init__(self, names: Iterable[str]) -> None:
        known: dict[Any, Term] = {}
        self._terms = {name: Term(known, PARAMETER, name) for name in names}

    def __getitem__(self, name: str) -> Term:
        return self._terms[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._terms)

    def __len__(self) -> int:
        return len(self._terms)
