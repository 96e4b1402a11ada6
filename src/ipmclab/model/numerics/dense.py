"""The path that needs no poles: a system over intervals of any length, with or without static laws at ports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.model.assemble import System
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.discretise import Transition, transitions

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
        See ``dense_laws_loop.dense_laws``.
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
        self._law_end = np.ascontiguousarray(move.law_end)
        self._laws = None if system.law_ports is None else law_numbers(system, self._law_end)

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
        from ipmclab.model.numerics.dense_laws_loop import LawTable, Readings, Steps, dense_laws

        steps = Steps(self._step, self._law_end, laws.drop)
        readings = Readings(np.hstack([self._read, laws.reach]), np.hstack([laws.ports[1], laws.ports[0]]))
        check_solved(dense_laws(steps, readings, LawTable(laws.forms, laws.coefficients), course, x, outputs))


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
