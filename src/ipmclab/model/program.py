"""What a computation makes of parameters, as a list of operations: done again with numbers, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.terms import PARAMETER, Term

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

_SIGNS: Final = ("{} + {}", "{} - {}", "{} * {}", "{} / {}", "{} ** {}", "-{}")


@dataclass(frozen=True, eq=False)
class Program:
    """A list of operations.

    What it computes with is in slots: the parameters, the constants, and what each operation makes.

    Parameters
    ----------
    names : tuple of str
        The parameters.
    constants : float array
    operations : int array, shape (n_operations, 3)
        What is done (``terms``), and the slots of what it is done to.
    places : int array
        The slots of what is asked.
    """

    names: tuple[str, ...]
    constants: FloatArray
    operations: IndexArray
    places: IndexArray

    @classmethod
    def of(cls, entries: Iterable[Any]) -> Program:
        """The operations that some entries need, each a term or a number."""
        asked = list(entries)
        order = list(_in_order(asked))
        parameters = [term for term in order if term.operation == PARAMETER]
        made = [term for term in order if term.operation != PARAMETER]
        numbers = [one for term in made for one in term.given] + asked
        constants = sorted({float(one) for one in numbers if not isinstance(one, Term)})
        slots = {id(term): slot for slot, term in enumerate(parameters)}
        fixed = {number: len(slots) + k for k, number in enumerate(constants)}
        slots |= {id(term): len(parameters) + len(constants) + k for k, term in enumerate(made)}

        def slot(one: Any) -> int:
            return slots[id(one)] if isinstance(one, Term) else fixed[float(one)]

        operations = [(term.operation, slot(term.given[0]), slot(term.given[-1])) for term in made]
        return cls(
            tuple(term.given[0] for term in parameters),
            np.array(constants, dtype=np.float64),
            np.array(operations, dtype=np.int64).reshape(-1, 3),
            np.array([slot(one) for one in asked], dtype=np.int64),
        )

    def written(self) -> Callable[..., tuple[Any, ...]]:
        """The same as a function of Python, from the parameters to what is asked; it takes arrays as well."""
        begin = len(self.names) + len(self.constants)
        shown = [f"p{k}" for k in range(len(self.names))] + [repr(float(one)) for one in self.constants]
        shown += [f"t{k}" for k in range(len(self.operations))]
        lines = [
            f"    {shown[begin + k]} = {_SIGNS[operation].format(shown[left], shown[right])}\n"
            for k, (operation, left, right) in enumerate(self.operations.tolist())
        ]
        asked = "".join(f"{shown[place]}, " for place in self.places)
        made: dict[str, Any] = {}
        source = f"def entries({', '.join(shown[: len(self.names)])}):\n{''.join(lines)}    return ({asked})\n"
        exec(compile(source, __file__, "exec"), {}, made)
        function: Callable[..., tuple[Any, ...]] = made["entries"]
        return function

    def run(self, values: FloatArray, moved: IndexArray, width: int) -> tuple[FloatArray, FloatArray]:
        """What is asked, and its derivatives.

        Parameters
        ----------
        values : float array
            The parameters.
        moved : int array
            The parameter that each column is a derivative by; none where it is negative.
        width : int
            Of the derivatives: a multiple of ``vectors_loop.WIDTH``; columns behind the others are 0.

        Returns
        -------
        entries : float array, shape (n_entries,)
        slopes : float array, shape (n_entries, width)
        """
        from ipmclab.model.numerics.program_loop import run

        every = np.zeros((len(self.names) + len(self.constants) + len(self.operations), width))
        entries, slopes = np.empty(len(self.places)), np.empty((len(self.places), width))
        run(self.operations, self.constants, self.places, values, moved, every, entries, slopes)
        return entries, slopes


def _in_order(entries: Iterable[Any]) -> Iterator[Term]:
    """All terms that some entries are made of, each after those that it is made of."""
    seen: set[int] = set()
    waiting = [one for one in entries if isinstance(one, Term)][::-1]
    while waiting:
        term = waiting[-1]
        missing = [one for one in term.given if isinstance(one, Term) and id(one) not in seen]
        if missing and id(term) not in seen:
            waiting += missing[::-1]
            continue
        waiting.pop()
        if id(term) not in seen:
            seen.add(id(term))
            yield term
