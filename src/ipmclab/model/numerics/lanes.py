"""Many parameter sets of one linear actuator through one compiled loop, which is written from their joined system."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import System
from ipmclab.model.numerics import lanes_loop
from ipmclab.model.numerics.cascade import Wiring
from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.discretise import balanced
from ipmclab.model.numerics.lanes_loop import CHUNK, ENTRY, NONE, ONE
from ipmclab.model.numerics.vectors_loop import WIDTH, on_lines
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

MOST_STATES: Final = 16
"""Of a system whose loop is written out: its length, and how long it takes to compile, grows with their square."""

_one_at_a_time: Final = threading.Lock()

Gathered = tuple[tuple[int, str], ...]
"""Output and name in ``lanes_loop.TALLIES``."""


class Lanes:
    """The recursion of many systems of one structure over one period.

    Parameters
    ----------
    pattern : int array, shape (n_outputs + n_states, n_states + 1)
        As in ``lanes_loop.loop_source``.
    entries : float array, shape (n_sets, n_entries)
        Of each system, in the order of the pattern.
    start : float array, shape (n_sets, n_states)
        The states at row 0 for 1 V there.
    """

    def __init__(self, pattern: npt.NDArray[np.int8], entries: FloatArray, start: FloatArray) -> None:
        self.sets, self._outputs = len(entries), len(pattern) - start.shape[1]
        self._pattern, self._entries, self._start = pattern, entries, start

    @classmethod
    def joined(cls, system: System, like: System, period: float, hold: Hold) -> Lanes:
        """Of joined systems, whatever their poles.

        From rest, with the input straight between rows, ``x+ = E x + b0 u + b1 u+`` for every hold. With z = x - b1 u
        this is ``z+ = E z + (b0 + E b1) u``: the voltage of one row only, whatever the hold, and z begins at -b1 u.

        Parameters
        ----------
        system : System
            With matrices of shape (n_sets, ...), linear, driven by the voltage alone.
        like : System
            The same for one parameter set. It gives the scales of the states, so that digits do not hang on which sets
            come together.
        period : float [s]
        hold : "zero", "zero-before" or "first"
        """
        state, begin, end = _transition(system, like, period, hold)
        step = np.concatenate([state, begin + state @ end], axis=-1)
        read = np.concatenate([system.c, system.d + system.c @ end], axis=-1)
        matrices = np.concatenate([read, step], axis=-2)
        pattern = _pattern(system, like, with_end=hold != "zero")
        return cls(np.where(pattern, ENTRY, NONE).astype(np.int8), matrices[:, pattern], -end[..., 0])

    @classmethod
    def modal(cls, numbers: FloatArray, wiring: Wiring, chosen: Sequence[int]) -> Lanes:
        """Of the modes of cascades.

        Parameters
        ----------
        numbers : float array, shape (n_sets, 13 sections + 4)
            As ``modal_loop.modal_sections`` has them.
        wiring : Wiring
        chosen : sequence of int
            Places of the outputs in ``ports.OUTPUTS``.
        """
        sections = sorted({section for output in chosen for section in wiring.reads[output]})
        modes = [2 * section + k for section in sections for k in range(wiring.states[section])]
        place = {mode: column for column, mode in enumerate(modes)}
        voltage, count = len(modes), 2 * wiring.sections
        weights = 3 * wiring.sections
        directs = weights + 4 * count
        rows: list[dict[int, int | None]] = []  # where each number stands by its column; None for a one
        for output in chosen:
            read = [mode for mode in modes if mode // 2 in wiring.reads[output]]
            own: dict[int, int | None] = {place[mode]: weights + output * count + mode for mode in read}
            rows.append({**own, voltage: directs + output})
        for mode in modes:
            section, is_second = divmod(mode, 2)
            p, q, s = (3 * section + k for k in range(3))
            if is_second:
                before: dict[int, int | None] = {voltage: None} if section == 0 else {place[mode - 1]: None}
                rows.append({**before, place[mode]: s})
            else:
                chained = {place[mode + 1]: q} if section and mode + 1 in place else {}
                rows.append({place[mode]: p, **chained, voltage: None})
        pattern = np.zeros((len(rows), voltage + 1), dtype=np.int8)
        for row, entries in enumerate(rows):
            for column, number in entries.items():
                pattern[row, column] = ONE if number is None else ENTRY
        taken = [number for entries in rows for _, number in sorted(entries.items()) if number is not None]
        return cls(pattern, numbers[:, taken], numbers[:, [directs + 4 + mode for mode in modes]])

    def outputs(self, voltage: FloatArray, found: FloatArray) -> None:
        """Write the outputs of all sets.

        Parameters
        ----------
        voltage : float array, shape (1 or n_sets, n_time) [V]
        found : float array, shape (n_sets, n_outputs, n_time)
        """
        self._run(voltage, None, found)

    def gather(self, voltage: FloatArray, gathered: Gathered) -> FloatArray:
        """What is gathered along the way, shape (n_gathered, n_sets); no output is kept."""
        groups = self._run(voltage, gathered, np.zeros((0, 0, 0)))
        first = self._states + 1 + self._outputs
        return groups[:, first : first + len(gathered)].transpose(1, 0, 2).reshape(len(gathered), -1)[:, : self.sets]

    @property
    def _states(self) -> int:
        return int(self._start.shape[1])

    def _run(self, voltage: FloatArray, gathered: Gathered | None, found: FloatArray) -> FloatArray:
        """The groups after the last row, shape (n_groups, n_places, WIDTH)."""
        shared = len(voltage) == 1
        run = _loop(self._pattern.shape, self._pattern.tobytes(), self._outputs, gathered, shared)
        count, first = -(-self.sets // WIDTH), self._states + 1 + self._outputs
        tallies = gathered or ()
        head = first + len(tallies)
        (flat,) = on_lines((count, (head + self._entries.shape[1]) * WIDTH))
        groups = flat.reshape(count, -1, WIDTH)
        filled = np.minimum(np.arange(count * WIDTH), self.sets - 1)  # the last group is filled up with the last set
        groups[:, head:] = self._entries[filled].reshape(count, WIDTH, -1).transpose(0, 2, 1)
        start = self._start * voltage[:, :1]
        groups[:, : self._states] = start[filled].reshape(count, WIDTH, -1).transpose(0, 2, 1)
        for place, (_, name) in enumerate(tallies):
            groups[:, first + place] = lanes_loop.TALLIES[name][1]
        run(flat, voltage, np.empty((CHUNK, WIDTH)), np.empty((self._outputs, CHUNK, WIDTH)), found)
        return groups


def _pattern(system: System, like: System, *, with_end: bool) -> npt.NDArray[np.bool_]:
    """Where outputs and next states can have entries, of the states and of the voltage.

    Taken from what leads where, and not from numbers, of which a long period makes some zero.
    """
    a, b, c, d = (
        np.any(getattr(system, name) != 0.0, axis=0) | (getattr(like, name) != 0.0) for name in ("a", "b", "c", "d")
    )
    state = a | np.eye(len(a), dtype=bool)
    for _ in range(len(a).bit_length()):
        state = state @ state
    drive = state @ b
    direct = d | c @ drive if with_end else d
    return np.vstack([np.hstack([c, direct]), np.hstack([state, drive])])


def _transition(system: System, like: System, period: float, hold: Hold) -> tuple[FloatArray, FloatArray, FloatArray]:
    """E, b0 and b1 of each system, shapes (n_sets, n, n) and twice (n_sets, n, 1)."""
    from ipmclab.model.numerics.transitions_loop import room, transitions_of_many

    n = system.a.shape[-1]
    _, scales = balanced(like.a)
    a, drive = np.ascontiguousarray(system.a), np.ascontiguousarray(system.b)
    step = np.empty((len(a), n, 2 + n))
    transitions_of_many(a, drive, scales, np.array([period]), room(n, 1, moved=False), step)
    held, ramped, state = np.split(step, [1, 2], axis=-1)
    nothing = np.zeros_like(held)
    if hold == "zero":
        return state, held, nothing
    if hold == "zero-before":
        return state, nothing, held
    return state, held - ramped, ramped


def _loop(*asked: Any) -> Callable[..., None]:
    """The compiled loop of a pattern: threads that ask for the same one get the same one."""
    with _one_at_a_time:
        return _made(*asked)


@lru_cache(maxsize=64)
def _made(
    shape: tuple[int, int], pattern: bytes, outputs: int, gathered: Gathered | None, shared: bool
) -> Callable[..., None]:
    """What Numba keeps of it on disk is known by its name."""
    asked = repr((shape, pattern, outputs, gathered, shared))
    name = f"lanes_{hashlib.sha256(asked.encode()).hexdigest()[:16]}"
    entries = np.frombuffer(pattern, dtype=np.int8).reshape(shape)
    source = lanes_loop.loop_source(name, entries, outputs, gathered, shared=shared)
    made: dict[str, Any] = {}
    # Numba keeps compiled code for the file that a function stands in: this one's is the file that wrote it.
    exec(compile(source, lanes_loop.__file__, "exec"), lanes_loop.WORDS, made)
    run: Callable[..., None] = kernel(made[name])
    return run
