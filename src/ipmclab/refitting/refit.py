"""A fit made again to other readings of the same runs: many strips, or many repeats, under the same voltages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.engine import Engine, Here
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.problem import Problem
from ipmclab.kinds import tell_kinds
from ipmclab.one_thread import on_one_thread
from ipmclab.progress import OnProgress, reporting_to, stage
from ipmclab.refitting.again import Fitted, fits_again, fitted, values_of

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Refits:
    """What ``refit`` found.

    Parameters
    ----------
    values : mapping of name to float array, shape (n_fits,) [SI]
        The value of each parameter in each fit; NaN where a fit did not end.
    converged : bool array, shape (n_fits,)
    """

    values: Mapping[str, FloatArray]
    converged: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.converged)

    def __getitem__(self, name: str) -> FloatArray:
        """The values of one parameter."""
        return self.values[name]


@tell_kinds
@on_one_thread
def refit(
    fit: Fit,
    readings: Sequence[Mapping[str, npt.ArrayLike]],
    *,
    engine: Engine | None = None,
    progress: OnProgress | None = None,
) -> Refits:
    """Fit again to other readings of the same runs: where a circuit is read by its current, many fits side by side.

    Voltages, weights, noise and what is free are those of the fit, and every search starts from it (and from the other
    fits that it found as good). No intervals are worked out: ``identify`` gives these for one strip, ``bootstrap`` from
    draws. Readings that the fit did not use are not used here either; one at the end of its range stays what it was.

    Parameters
    ----------
    fit : Fit
        What ``identify`` returned.
    readings : sequence of mapping of output to float array, shape (n_fits, n_time) [SI]
        For each run of the fit, in their order: its outputs, one row for each fit.
    engine : Engine, optional
        Who fits: this process where it is left out. The answer is the same, to the last bit.
    progress : function of (str, float), optional
        Called with what is being done, and the fraction that is done.

    Returns
    -------
    refits : Refits

    Raises
    ------
    InputError
        A fit that was read from a file; not one mapping for each run, an output that is missing, another shape than
        that of the run, a reading that is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab import identify, load_actuator, refit, simulate, simulate_many
    >>> strip = load_actuator("friend-2")
    >>> fit = identify(strip, simulate(strip, "step 1 V", duration=20, rate=50), free="circuit.dc_resistivity")
    >>> others = simulate_many(strip, "step 1 V", {"circuit.dc_resistivity": [40.0, 50.0]}, duration=20, rate=50)
    >>> refit(fit, [{"current": others["current"]}])["circuit.dc_resistivity"].round(6).tolist()
    [40.0, 50.0]
    """
    start = fitted(fit)
    pieces = _differences(start.problem, readings)
    count = len(pieces[0][1]) if pieces else 0
    with reporting_to(progress):
        stage(f"{count} fits", 0.0, 1.0, usual=count)
        thetas = fits_again(start, _shifts(start, pieces, count), count, engine or Here())
    converged = np.array([theta is not None for theta in thetas], dtype=bool)
    values = {}
    # In addition to the fit itself, which has every name though no other one ends.
    for name, found in values_of(start.problem, [start.theta, *(one for one in thetas if one is not None)]).items():
        values[name] = np.full(count, np.nan)
        values[name][converged] = found[1:]
    return Refits(values, converged)


def _shifts(start: Fitted, pieces: Sequence[tuple[tuple[int, str], FloatArray]], count: int) -> Iterator[FloatArray]:
    """By how much the residuals of the problem change with the readings of each fit."""
    for fit in range(count):
        shift = np.zeros_like(start.here.residual)
        for key, differences in pieces:
            shift[start.problem.pieces[key]] = start.problem.shift(key, differences[fit][None])[0]
        yield shift


def _differences(
    problem: Problem, readings: Sequence[Mapping[str, npt.ArrayLike]]
) -> list[tuple[tuple[int, str], FloatArray]]:
    """Old less new readings of each output of each run, weighted, shape (n_fits, n_used)."""
    if len(readings) != len(problem.records):
        raise InputError(
            f"there are readings of {len(readings)} runs, and the fit has {len(problem.records)}",
            code="unequal-lengths",
            where="readings",
            repair="give one mapping for each run of the fit, in their order",
        )
    found: list[tuple[tuple[int, str], FloatArray]] = []
    for record, given in zip(problem.records, readings, strict=True):
        for output, reading in record.readings.items():
            where = f"readings[{record.place}]: {output}"
            if output not in given:
                raise InputError(
                    "the fit used these readings, and there are none",
                    code="missing-readings",
                    where=where,
                    repair=f"give {output} as an array of shape (n_fits, {len(reading.values)})",
                )
            values = np.atleast_2d(np.asarray(given[output], dtype=np.float64))
            sets = len(found[0][1]) if found else len(values)
            if values.shape != (sets, len(reading.values)):
                raise InputError(
                    f"the array has shape {values.shape}",
                    code="unequal-lengths",
                    where=where,
                    repair=f"give one row of {len(reading.values)} readings for each fit",
                )
            new = values[:, reading.used]
            if not np.isfinite(new).all():
                raise InputError(
                    "a reading is not finite", code="bad-readings", where=where, repair="leave this fit out"
                )
            key = record.place, output
            weights = (1.0 if reading.weights is None else reading.weights[reading.used]) / problem.noise[key]
            measured = reading.side[reading.used] == 0
            found.append((key, np.where(measured, (reading.values[reading.used] - new) * weights, 0.0)))
    return found
