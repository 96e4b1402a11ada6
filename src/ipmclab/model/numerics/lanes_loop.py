"""Many linear systems of one structure, side by side in the lanes of a processor.

The state of one system moves by ``z+ = A z + b u`` and reads ``y = C z + d u`` for every hold (``lanes.Lanes``). Which
entries of these matrices are not zero, and which are one, is the same for all parameter sets of an actuator. From that
pattern ``loop_source`` writes the loop out: one statement for each state and each output, in which every product is one
load of a coefficient of all systems that lie side by side. A compiler turns exactly this form into vector operations:
all in one flat array, at places that are numbers in the source, because it cannot know of two arrays that they are
apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel

FloatArray = npt.NDArray[np.float64]

WIDTH: Final = 16
"""Systems side by side: two vectors of the widest processors, so that one goes on while the other waits for its memory.

Of 32, outputs would be written a tenth faster still, and metrics, which change memory in each row, a quarter slower.
"""

CHUNK: Final = 32
"""Rows whose outputs are made before they are put where they belong: 16 kB, which stay in the first cache."""

NONE, ENTRY, ONE = 0, 1, 2
"""What a matrix may have at a place. A one costs no load and no product."""

TALLIES: Final[dict[str, tuple[str, float]]] = {
    "sum": ("{sum} + y", 0.0),
    "squares": ("{squares} + y * y", 0.0),
    "largest": ("y if y > {largest} else {largest}", -np.inf),
    "smallest": ("y if y < {smallest} else {smallest}", np.inf),
    "peak": ("y if abs(y) > {size} else {peak}", np.nan),
    "peak_row": ("row if abs(y) > {size} else {peak_row}", np.nan),
    "size": ("abs(y) if abs(y) > {size} else {size}", -1.0),
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
    for o in range(outputs.shape[1]):
        beside = lanes[o]
        for i in range(min(WIDTH, outputs.shape[0] - first_set)):
            own = outputs[first_set + i, o, begin : begin + rows]
            for t in range(rows):
                own[t] = beside[t, i]


@kernel
def _multiply(left: FloatArray, right: FloatArray, result: FloatArray) -> None:
    """``result = left right``; what is zero on the left costs nothing, and leaves an exact zero."""
    n = left.shape[0]
    for i in range(n):
        for j in range(n):
            result[i, j] = 0.0
        for k in range(n):
            factor = left[i, k]
            if factor != 0.0:
                for j in range(n):
                    result[i, j] += factor * right[k, j]


@kernel
def exponentials(generators: FloatArray, reach: float, weights: FloatArray, results: FloatArray) -> None:
    """Exponentials of many small matrices, shape (n_sets, n, n): scaled, by their series, squared.

    What is squared is the exponential less 1, so that what moves slowly keeps its digits. The series to the twelfth
    power is put together from four powers (Paterson and Stockmeyer 1973), which takes five products in place of eleven.

    Parameters
    ----------
    generators : float array, shape (n_sets, n, n)
    reach : float
        The norm down to which each is scaled; 0.25 makes the thirteenth term vanish.
    weights : float array, shape (13,)
        1/k! for each k from 0.
    results : float array, shape (n_sets, n, n)
        Written.
    """
    n = generators.shape[1]
    power = np.empty((4, n, n))
    inner, product = np.empty((n, n)), np.empty((n, n))
    for s in range(generators.shape[0]):
        norm = 0.0
        for j in range(n):
            column = 0.0
            for i in range(n):
                column += abs(generators[s, i, j])
            norm = max(norm, column)
        squarings = int(np.ceil(np.log2(norm / reach))) if reach < norm < 1e300 else 0
        factor = 2.0 ** (-squarings)
        for i in range(n):
            for j in range(n):
                power[0, i, j] = generators[s, i, j] * factor
        for k in range(1, 4):
            _multiply(power[0], power[k - 1], power[k])
        for i in range(n):
            for j in range(n):
                inner[i, j] = weights[12] * power[3, i, j]
        for first in (8, 4):
            for i in range(n):
                for j in range(n):
                    for k in range(3):
                        inner[i, j] += weights[first + 1 + k] * power[k, i, j]
                inner[i, i] += weights[first]
            _multiply(power[3], inner, product)
            inner[:, :] = product
        for i in range(n):
            for j in range(n):
                for k in range(3):
                    product[i, j] += weights[1 + k] * power[k, i, j]
        for _ in range(squarings):
            inner[:, :] = product
            _multiply(inner, inner, product)
            for i in range(n):
                for j in range(n):
                    product[i, j] += 2.0 * inner[i, j]
        for i in range(n):
            for j in range(n):
                results[s, i, j] = product[i, j]
            results[s, i, i] += 1.0


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
    states = pattern.shape[1] - 1
    first_output = states + 1
    first_tally = first_output + outputs
    coefficient = first_tally + len(gathered or ())
    lines = ["u = volts" if shared else f"u = {_at(states)}", *(f"z{j} = {_at(j)}" for j in range(states))]
    for row, entries in enumerate(pattern):
        terms = []
        for column in np.flatnonzero(entries).tolist():
            term = f"z{column}" if column < states else "u"
            if entries[column] == ENTRY:
                term = f"{_at(coefficient)} * {term}"
                coefficient += 1
            terms.append(term)
        total = " + ".join(terms) or "0.0"
        if row >= outputs:
            lines.append(f"{_at(row - outputs)} = {total}")
        elif gathered is None:
            lines.append(f"{_at(first_output + row)} = {total}")
        else:
            places = {tally: _at(first_tally + k) for k, (output, tally) in enumerate(gathered) if output == row}
            lines.append(f"y = {total}")
            lines += [f"{place} = " + TALLIES[tally][0].format(**places) for tally, place in places.items()]
    own = ["for i in range(WIDTH):", f"    {_at(states)} = inputs[t, i]"]
    keep = [f"for o in range({outputs}):", "    for i in range(WIDTH):"]
    keep += [f"        lanes[o, t, i] = g[{first_output * WIDTH} + o * WIDTH + i]"]
    each_row = ["volts = voltage[0, begin + t]"] if shared else own
    each_row += ["row = float(begin + t)", "for i in range(WIDTH):", *(f"    {line}" for line in lines)]
    each_row += keep if gathered is None else []
    inner = "\n".join(f"                {line}" for line in each_row)
    filled = "" if shared else "fill(voltage, group * WIDTH, begin, rows, inputs)"
    spread_out = "spread(lanes, group * WIDTH, begin, rows, outputs)" if gathered is None else ""
    return f"""
def {name}(first, last, groups, voltage, outputs):
    inputs, lanes = np.empty((CHUNK, WIDTH)), np.empty(({outputs}, CHUNK, WIDTH))
    for group in range(first, last):
        g = groups[group]
        for begin in range(0, voltage.shape[1], CHUNK):
            rows = min(CHUNK, voltage.shape[1] - begin)
            {filled}
            for t in range(rows):
{inner}
            {spread_out}
"""


def _at(place: int) -> str:
    return f"g[{place * WIDTH} + i]"
