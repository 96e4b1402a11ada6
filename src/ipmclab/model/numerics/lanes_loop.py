"""Many linear systems of one structure, side by side in the lanes of a processor.

The state of one system moves by ``z+ = A z + b u`` and reads ``y = C z + d u`` for every hold (``lanes.Lanes``). Which
entries of these matrices are not zero, and which are one, is the same for all parameter sets of an actuator. From that
pattern ``loop_source`` writes the loop out: one statement for each state and each output, of variables that hold a
number of each system (``vectors_loop``). States and what is gathered stay in these from row to row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics import vectors_loop
from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.vectors_loop import SQUARE, WIDTH, begin_of, turned

FloatArray = npt.NDArray[np.float64]

CHUNK: Final = 128
"""Rows whose outputs are made before they are put where they belong: memory is written in runs of 1 kB."""

NONE, ENTRY, ONE = 0, 1, 2
"""What a matrix may have at a place. A one costs no load and no product."""

TALLIES: Final[dict[str, tuple[str, float]]] = {
    "sum": ("{sum} + y", 0.0),
    "squares": ("plus({squares}, y, y)", 0.0),
    "largest": ("above(y, {largest}, y, {largest})", -np.inf),
    "smallest": ("above({smallest}, y, y, {smallest})", np.inf),
    "peak": ("above(size(y), {size}, y, {peak})", np.nan),
    "peak_row": ("above(size(y), {size}, row, {peak_row})", np.nan),
    "size": ("above(size(y), {size}, size(y), {size})", -1.0),
    "final": ("y", np.nan),
}
"""What a loop can gather of an output y, in this order: how each row changes it, and with what it begins."""


@kernel
def fill(voltage: FloatArray, first_set: int, begin: int, rows: int, lanes: FloatArray) -> None:
    """The voltages of some rows, side by side, one row of ``voltage`` for each system; the last one fills up."""
    for i in range(WIDTH):
        own = voltage[min(first_set + i, voltage.shape[0] - 1)]
        for t in range(rows):
            lanes[t, i] = own[begin + t]


@kernel
def spread(lanes: FloatArray, first_set: int, begin: int, rows: int, outputs: FloatArray) -> None:
    """Outputs that lie side by side, put where each system has its own: shape (n_sets, n_outputs, n_time)."""
    sets, count, length = outputs.shape
    beside, own = begin_of(lanes), begin_of(outputs)
    there, whole = min(WIDTH, sets - first_set), rows // SQUARE * SQUARE
    for o in range(count):
        squares = there // SQUARE * SQUARE
        for i in range(0, squares, SQUARE):
            place = ((first_set + i) * count + o) * length + begin
            for t in range(0, whole, SQUARE):
                turned(beside, (o * CHUNK + t) * WIDTH + i, WIDTH, own, place + t, count * length)
        for i in range(there):
            for t in range(whole if i < squares else 0, rows):
                outputs[first_set + i, o, begin + t] = lanes[o, t, i]


WORDS: Final = {**vars(vectors_loop), "CHUNK": CHUNK, "fill": fill, "spread": spread}
"""What the source of a loop speaks of."""


def loop_source(
    name: str, pattern: npt.NDArray[np.int8], outputs: int, gathered: Sequence[tuple[int, str]] | None, *, shared: bool
) -> str:
    """The loop for one pattern, as source text of a function.

    A group of WIDTH systems is one row of ``groups``: states, voltage, outputs, what is gathered, then the coefficients
    in the order of the pattern, each for all lanes.

    Parameters
    ----------
    name : str
        Of the function.
    pattern : int array, shape (n_outputs + n_states, n_states + 1)
        What the matrices have for the states, then for the voltage: NONE, an ENTRY, or a ONE.
    outputs : int
        How many of the rows are outputs, which come first; the others are the states.
    gathered : sequence of (output, name in TALLIES), optional
        In the order of TALLIES for each output. Where it is left out, every output is written.
    shared : bool
        Whether one voltage drives all systems.
    """
    states, tallies = pattern.shape[1] - 1, gathered or ()
    first = states + 1 + outputs
    head = first + len(tallies)
    moving = _row(
        pattern,
        outputs,
        gathered,
        entry=lambda place: f"load(g, {(head + place) * WIDTH})",
        written=lambda output, y: f"store(beside, ({output} * CHUNK + t) * WIDTH, {y})",
    )
    begun = [f"z{j} = load(g, {j * WIDTH})" for j in range(states)]
    begun += [f"s{k} = load(g, {(first + k) * WIDTH})" for k in range(len(tallies))]
    given = "alike(voltage[0, begin + t])" if shared else "load(own, t * WIDTH)"
    filled = "" if shared else "fill(voltage, group * WIDTH, begin, rows, inputs)"
    ended = [f"store(g, {(first + k) * WIDTH}, s{k})" for k in range(len(tallies))]
    return f"""
def {name}(groups, voltage, inputs, lanes, outputs):
    on_cache_lines()
    own, beside = begin_of(inputs), begin_of(lanes)
    for group in range(groups.shape[0]):
        g = behind(begin_of(groups), group * groups.shape[1])
        {_below(begun, 8)}
        for begin in range(0, voltage.shape[1], CHUNK):
            rows = min(CHUNK, voltage.shape[1] - begin)
            {filled}
            for t in range(rows):
                {_below([f"u = {given}", "row = alike(float(begin + t))", *moving], 16)}
            {"spread(lanes, group * WIDTH, begin, rows, outputs)" if gathered is None else ""}
        {_below(ended, 8)}
"""


def device_source(
    name: str, pattern: npt.NDArray[np.int8], outputs: int, gathered: Sequence[tuple[int, str]] | None
) -> str:
    """The same for a GPU, one system to each of its threads; parameters as ``loop_source``."""
    states, tallies = pattern.shape[1] - 1, gathered or ()
    moving = _row(
        pattern,
        outputs,
        gathered,
        entry=lambda place: f"c{place}",
        written=lambda output, y: f"outputs[i, {output}, t] = {y}",
    )
    begun = [f"c{place} = entries[i, {place}]" for place in range(np.count_nonzero(pattern == ENTRY))]
    begun += [f"z{j} = start[i, {j}]" for j in range(states)]
    begun += [f"s{k} = {TALLIES[tally][1]}" for k, (_, tally) in enumerate(tallies)]
    ended = [f"tallied[{k}, i] = s{k}" for k in range(len(tallies))]
    return f"""
def {name}(entries, start, voltage, tallied, outputs):
    i = cuda.grid(1)
    if i < entries.shape[0]:
        own = i if voltage.shape[0] > 1 else 0
        {_below(begun, 8)}
        for t in range(voltage.shape[1]):
            {_below(["u = voltage[own, t]", "row = float(t)", *moving], 12)}
        {_below(ended, 8)}
"""


def _row(
    pattern: npt.NDArray[np.int8],
    outputs: int,
    gathered: Sequence[tuple[int, str]] | None,
    *,
    entry: Callable[[int], str],
    written: Callable[[int, str], str],
) -> list[str]:
    """The statements of one row: outputs are read from the states z and the voltage u, then the states move.

    Every sum is one product and then ``plus``, or ``plus`` alone, so that no compiler chooses where to round.
    """
    states, place = pattern.shape[1] - 1, 0
    read, moved = [], []
    for row, entries in enumerate(pattern):
        terms = [f"z{j}" for j in range(states)] + ["u"]
        total = " + ".join(terms[column] for column in np.flatnonzero(entries == ONE).tolist())
        for column in np.flatnonzero(entries == ENTRY).tolist():
            product = entry(place), terms[column]
            total = f"plus({total}, {', '.join(product)})" if total else " * ".join(product)
            place += 1
        total = total or "alike(0.0)"
        if row >= outputs:
            moved.append(total)
        elif gathered is None:
            read.append(written(row, total))
        else:
            places = {tally: f"s{k}" for k, (output, tally) in enumerate(gathered) if output == row}
            read.append(f"y = {total}")
            read += [f"{own} = " + TALLIES[tally][0].format(**places) for tally, own in places.items()]
    return [*read, *(f"n{j} = {total}" for j, total in enumerate(moved)), *(f"z{j} = n{j}" for j in range(states))]


def _below(lines: Sequence[str], indent: int) -> str:
    return f"\n{' ' * indent}".join(lines) or "pass"
