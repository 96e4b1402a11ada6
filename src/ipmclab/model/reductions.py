"""Reductions: the numbers that many simulations are reduced to, gathered along the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, unknown_name
from ipmclab.model.ports import OUTPUTS
from ipmclab.units import CHANNELS, TIME, Quantity

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Reduction:
    """One number of one output of one simulation.

    Parameters
    ----------
    definition : str
    gathered : tuple of str
        What is gathered along the rows, names in ``numerics.lanes_loop.TALLIES``.
    made : function of the gathered numbers, the count of rows, and the period [s]
    """

    definition: str
    gathered: tuple[str, ...]
    made: Callable[[Mapping[str, FloatArray], int, float], FloatArray]


REDUCTIONS: Final[dict[str, Reduction]] = {
    "final": Reduction("the last row", ("final",), lambda of, _rows, _period: of["final"]),
    "mean": Reduction("the mean of all rows", ("sum",), lambda of, rows, _period: of["sum"] / rows),
    "rms": Reduction(
        "the root of the mean square of all rows", ("squares",), lambda of, rows, _period: np.sqrt(of["squares"] / rows)
    ),
    "maximum": Reduction("the largest of all rows", ("largest",), lambda of, _rows, _period: of["largest"]),
    "minimum": Reduction("the smallest of all rows", ("smallest",), lambda of, _rows, _period: of["smallest"]),
    "peak": Reduction(
        "the value of largest magnitude, with its sign", ("peak", "size"), lambda of, _rows, _period: of["peak"]
    ),
    "peak_time": Reduction(
        "when it is first reached [s]", ("peak_row", "size"), lambda of, _rows, period: of["peak_row"] * period
    ),
}
"""By the name behind the dot: ``displacement.peak``."""


def quantity_of(metric: str) -> Quantity:
    """What the number of a reduction is.

    Examples
    --------
    >>> quantity_of("displacement.peak").display_unit, quantity_of("displacement.peak_time").display_unit
    ('mm', 's')
    """
    output, _, reduction = metric.partition(".")
    return TIME if reduction == "peak_time" else CHANNELS[output]


@dataclass(frozen=True)
class Reduced:
    """Some reductions of some outputs.

    Parameters
    ----------
    names : tuple of str
        Such as ``displacement.peak``.
    """

    names: tuple[str, ...]

    @classmethod
    def of(cls, names: Sequence[str]) -> Reduced:
        """The reductions of these names.

        Raises
        ------
        InputError
            None, an unknown one, or one twice.

        Examples
        --------
        >>> Reduced.of(["displacement.peak", "current.mean"]).outputs
        ('current', 'displacement')
        """
        known = [f"{output}.{name}" for output in OUTPUTS for name in REDUCTIONS]
        for name in names:
            if name not in known:
                raise unknown_name("metric", name, known, where="reduce")
        if not names or len(set(names)) < len(names):
            raise InputError(
                f"the metrics are {', '.join(names) or 'none'}",
                code="bad-metrics",
                where="reduce",
                repair=f"name each once, such as displacement.peak; behind the dot one of {', '.join(REDUCTIONS)}",
            )
        return cls(tuple(names))

    @property
    def outputs(self) -> tuple[str, ...]:
        """The outputs that they are numbers of, in the order of ``OUTPUTS``."""
        asked = {name.partition(".")[0] for name in self.names}
        return tuple(output for output in OUTPUTS if output in asked)

    def gathered(self, tallies: Sequence[str]) -> tuple[tuple[int, str], ...]:
        """What is to be gathered: places in ``outputs``, and names of tallies in the order in which these are known."""
        needed = {
            (self.outputs.index(output), tally)
            for output, _, name in (metric.partition(".") for metric in self.names)
            for tally in REDUCTIONS[name].gathered
        }
        return tuple(sorted(needed, key=lambda one: (one[0], tallies.index(one[1]))))

    def made(self, numbers: Mapping[tuple[int, str], FloatArray], rows: int, period: float) -> dict[str, FloatArray]:
        """The metrics by name, from what was gathered."""
        found = {}
        for metric in self.names:
            output, _, name = metric.partition(".")
            place, reduction = self.outputs.index(output), REDUCTIONS[name]
            of = {tally: numbers[place, tally] for tally in reduction.gathered}
            found[metric] = np.array(reduction.made(of, rows, period))
        return found

    def of_outputs(self, values: FloatArray, period: float) -> dict[str, FloatArray]:
        """The metrics of outputs, shape (n_sets, n_outputs, n_time); rows without a reading (NaN) are left out.

        They are NaN where there is no reading at all.
        """
        there: npt.NDArray[np.bool_] = ~np.isnan(values)
        sized = np.where(there, np.abs(values), -1.0)
        peaks = np.argmax(sized, axis=-1)
        some: npt.NDArray[np.bool_] = np.any(there, axis=-1)
        zeroed = np.where(there, values, 0.0)
        # A mean over the readings that there are, handed on as a sum over all rows.
        share = values.shape[-1] / np.maximum(there.sum(axis=-1), 1)
        every = {
            "sum": zeroed.sum(axis=-1) * share,
            "squares": (zeroed**2).sum(axis=-1) * share,
            "largest": np.where(there, values, -np.inf).max(axis=-1),
            "smallest": np.where(there, values, np.inf).min(axis=-1),
            "peak": np.take_along_axis(zeroed, peaks[..., None], axis=-1)[..., 0],
            "peak_row": peaks.astype(np.float64),
            "size": sized.max(axis=-1),
            "final": values[..., -1],
        }
        numbers = {
            (place, name): np.where(some[:, place], of[:, place], np.nan)
            for place in range(values.shape[1])
            for name, of in every.items()
        }
        return self.made(numbers, values.shape[-1], period)
