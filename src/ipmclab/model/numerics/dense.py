"""The path that needs no poles: a system over intervals of any length, with or without static laws at ports."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.model.assemble import System
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.discretise import step_of

if TYPE_CHECKING:
    from ipmclab.model.numerics.dense_loop import Columns, LawTable

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

LONGEST: Final = 0.02
"""Length [s] beyond which an interval is divided where there are laws, whose straight lines are an approximation."""

_MOST_PARTS: Final = 500


def parts(system: System, durations: FloatArray) -> IndexArray:
    """Into how many parts the intervals of each kind are divided: one in a linear system, which is exact anyway."""
    return np.ones(len(durations), dtype=np.int64) if system.law_ports is None else law_parts(durations)


def law_parts(durations: FloatArray) -> IndexArray:
    """The same where there are laws."""
    return np.clip(np.ceil(durations / LONGEST - 1e-6), 1, _MOST_PARTS).astype(np.int64)


class Dense:
    """A system over kinds of intervals.

    Parameters
    ----------
    system : System
    step : float array, shape (n_kinds, n, 2 n_inputs + n + 2 n_laws)
        Of ``discretise.step_of``.
    """

    def __init__(self, system: System, step: FloatArray) -> None:
        self._inputs, ports = len(system.inputs), system.law_ports
        self._step, self._read = step, np.hstack([system.d, system.c])
        self._columns: Columns | None = None
        if ports is not None:
            from ipmclab.model.numerics.dense_loop import columns_of, law_table

            self._table: LawTable = law_table(ports.laws)
            read, seen = np.hstack([self._read, ports.reach]), np.hstack([ports.d, ports.c, ports.loop])
            self._columns = columns_of(self._step, read, seen, self._table, self._inputs)

    @classmethod
    def of(cls, system: System, durations: npt.ArrayLike) -> Dense:
        """The system over intervals of these durations [s]."""
        return cls(system, step_of(system, durations))

    def run(self, course: Course, x: FloatArray, outputs: FloatArray) -> None:
        """Write the outputs, and leave the last state in ``x``; as ``kernels.dense``.

        Raises
        ------
        IpmclabError
            The equation of a law has no solution in floating point.
        """
        if self._columns is None:
            linear(self._step, self._read, course, x, outputs)
            return
        from ipmclab.model.numerics.dense_loop import NO_TRACE, dense, room

        check_solved(dense(self._columns, self._table, course, x, outputs, room(self._columns, self._inputs), NO_TRACE))


def linear(step: FloatArray, read: FloatArray, course: Course, x: FloatArray, outputs: FloatArray) -> None:
    """Write the outputs of a system without laws, and leave the last state in ``x``.

    Parameters
    ----------
    step : float array, shape (n_kinds, n, 2 n_inputs + n)
        Of ``discretise.step_of``.
    read, course, x, outputs
        As of ``kernels.dense``.
    """
    from ipmclab.model.numerics.kernels import dense
    from ipmclab.model.numerics.vectors_loop import filled

    kinds, n, count = step.shape
    columns = np.zeros((kinds, count, filled(n)))
    columns[..., :n] = step.transpose(0, 2, 1)
    dense(columns, read, course, x, np.empty(filled(n)), outputs)


def check_solved(failed: int) -> None:
    """Refuse results after an interval whose equation had no solution.

    Raises
    ------
    IpmclabError
    """
    if failed >= 0:
        raise IpmclabError(
            f"the leak has no current in floating point at interval {failed}: its numbers overflow",
            code="no-solution",
            where="leak",
            repair="give a voltage of the size that strips see, and a leak of theirs",
        )
