"""The path that needs no poles: a system over intervals of any length, with or without static laws at ports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.model.assemble import System
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.discretise import Transition, transitions

if TYPE_CHECKING:
    from ipmclab.model.numerics.dense_laws_loop import Columns

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

LONGEST: Final = 0.02
"""Length [s] beyond which an interval is divided where there are laws, whose straight lines are an approximation."""

_MOST_PARTS: Final = 500


def parts(system: System, durations: FloatArray) -> IndexArray:
    """Into how many parts the intervals of each kind are divided: one in a linear system, which is exact anyway."""
    if system.law_ports is None:
        return np.ones(len(durations), dtype=np.int64)
    return np.clip(np.ceil(durations / LONGEST - 1e-6), 1, _MOST_PARTS).astype(np.int64)


@dataclass(frozen=True, eq=False)
class LawNumbers:
    """What the compiled loops need of the laws of a system.

    Parameters
    ----------
    forms : int array, shape (n_laws,)
    coefficients : float array, shape (n_laws, 3)
    ports : tuple of float arrays
        ``c`` and ``d`` of the ports, shapes (n_laws, n_states) and (n_laws, n_inputs).
    reach : float array, shape (n_outputs, n_laws)
    drop : float array, shape (n_kinds + 1, n_laws, n_laws) [ohm]
        See ``dense_laws_loop.Columns``.
    """

    forms: IndexArray
    coefficients: FloatArray
    ports: tuple[FloatArray, FloatArray]
    reach: FloatArray
    drop: FloatArray


def law_numbers(system: System, law_end: FloatArray) -> LawNumbers:
    """The laws of a system for transitions with this ``law_end``, shape (n_kinds, n_states, n_laws)."""
    ports = system.law_ports
    assert ports is not None
    drop = np.concatenate([-(ports.loop + ports.c @ law_end), -ports.loop[None]])
    return LawNumbers(
        forms=np.array([law.form for law in ports.laws], dtype=np.int64),
        coefficients=np.array([law.coefficients for law in ports.laws], dtype=np.float64),
        ports=(np.ascontiguousarray(ports.c), np.ascontiguousarray(ports.d)),
        reach=np.ascontiguousarray(ports.reach),
        drop=np.ascontiguousarray(drop),
    )


class Dense:
    """A system over kinds of intervals.

    Parameters
    ----------
    system : System
    move : Transition
        Leading axis: the kinds.
    """

    def __init__(self, system: System, move: Transition) -> None:
        self._read = np.hstack([system.d, system.c])
        self._step = np.concatenate([move.constant, move.slope, move.state, move.law_begin], axis=-1)
        self._inputs = len(system.inputs)
        self._laws = None if system.law_ports is None else law_numbers(system, np.ascontiguousarray(move.law_end))
        if self._laws is not None:
            self._columns = _columns(self._laws, self._read, self._step, move.law_end)

    @classmethod
    def of(cls, system: System, durations: npt.ArrayLike) -> Dense:
        """The system over intervals of these durations [s]."""
        move = transitions([system], durations)
        return cls(
            system, Transition(move.state[0], move.constant[0], move.slope[0], move.law_begin[0], move.law_end[0])
        )

    def run(self, course: Course, x: FloatArray, outputs: FloatArray) -> None:
        """Write the outputs, and leave the last state in ``x``; as ``kernels.dense``.

        Raises
        ------
        IpmclabError
            The equation of a law has no solution in floating point.
        """
        laws = self._laws
        if laws is None:
            from ipmclab.model.numerics.kernels import dense

            dense(self._step, self._read, course, x, outputs)
            return
        from ipmclab.model.numerics.dense_laws_loop import LawTable, dense_laws, room

        table, written = LawTable(laws.forms, laws.coefficients), room(self._columns, self._inputs)
        check_solved(dense_laws(self._columns, table, laws.drop, course, x, outputs, written))


def _columns(laws: LawNumbers, read: FloatArray, step: FloatArray, law_end: FloatArray) -> Columns:
    """The numbers of ``dense_laws``; arrays as in ``Dense``."""
    from ipmclab.model.numerics.dense_laws_loop import Columns
    from ipmclab.model.numerics.law_rows_loop import law_rows
    from ipmclab.model.numerics.vectors_loop import filled

    c, d = laws.ports
    given = d.shape[1]

    def as_columns(rows: FloatArray) -> FloatArray:
        made = np.zeros((*rows.shape[:-2], rows.shape[-1], filled(rows.shape[-2])))
        made[..., : rows.shape[-2]] = np.swapaxes(rows, -1, -2)
        return made

    def at_end(direct: FloatArray, of_state: FloatArray) -> FloatArray:
        """What is read of the inputs at the end, and of the state there."""
        found = of_state @ step
        found[..., :given] += direct
        found[..., given : 2 * given] += direct
        return found

    shown = np.concatenate([step, at_end(read[:, :given], read[:, given:])], axis=-2)
    added = np.concatenate([law_end, read[:, given:] @ law_end + laws.reach], axis=-2)
    return Columns(
        step=np.concatenate([as_columns(shown), as_columns(at_end(d, c))], axis=-1),
        end=as_columns(added),
        drop=as_columns(laws.drop),
        outputs=as_columns(np.hstack([read, laws.reach])),
        ports=as_columns(np.hstack([d, c])),
        laws=law_rows(int(laws.forms[0]), laws.coefficients),
    )


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
