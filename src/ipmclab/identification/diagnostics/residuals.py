"""Correlations of what a fit left: with itself, and with the voltage."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.output_diagnosis import OutputDiagnosis, Verdict
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.run import FloatArray

_LAGS: Final = 24  # at most: as many as a figure shows
_LONGEST: Final = 0.25  # of a record


def output_diagnosis(
    correlated: Correlated, record: PreparedRun, output: str, verdict: Verdict, basis: FloatArray
) -> OutputDiagnosis:
    """Correlations of the residuals of one output of one run.

    Parameters
    ----------
    correlated : Correlated
    record : PreparedRun
    output : str
    verdict : str
    basis : float array, shape (n_residual, n_directions)
        As ``imitated`` gives it.
    """
    problem = correlated.problem
    key = record.place, output
    piece, inside = problem.pieces[key], record.readings[output].exact_of_used
    white = correlated.whitened.residual[piece][inside]
    raw = correlated.left(key)[inside] * problem.noise[key]
    rows = _lags(len(white))
    voltage = _of_rows(_earlier(record, rows), record.readings[output].used)
    if len(rows):
        voltage = correlated.white(key, voltage)
        own = basis[piece]
        voltage -= (voltage @ own) @ own.T
    whitened = _correlations(white, rows)
    return OutputDiagnosis(
        label=record.label,
        output=output,
        verdict=verdict,
        rms=float(np.sqrt(np.mean(raw * raw))) if len(raw) else 0.0,
        scatter=record.readings[output].noise,
        lags=tuple(float(lag / record.run.rate) for lag in rows),
        autocorrelation=_correlations(raw, rows) if key in correlated.noise else whitened,
        whitened=whitened,
        with_voltage=_with(white, _of_rows(voltage, inside)),
        band=NORMAL_95 / max(len(white), 1) ** 0.5,
    )


@cache
def _lags(count: int) -> tuple[int, ...]:
    """From one row to a quarter of a record, evenly spaced as logarithms."""
    if count < 8:
        return ()
    return tuple(sorted({round(lag) for lag in np.geomspace(1.0, _LONGEST * count, _LAGS)}))


def _earlier(record: PreparedRun, lags: tuple[int, ...]) -> FloatArray:
    """The voltage so many rows earlier, a row for each lag; before the first that of a strip at rest, or the first."""
    voltage = record.run.voltage
    longest = max(lags, default=0)
    before = np.full(longest, voltage[0] if record.start == "free" else 0.0)
    whole = np.concatenate([before, voltage])
    return np.array([whole[longest - lag : len(whole) - lag] for lag in lags]).reshape(len(lags), len(voltage))


def _of_rows(values: FloatArray, wanted: npt.NDArray[np.bool_]) -> FloatArray:
    """Some columns; all of them without a copy."""
    return values if wanted.all() else values[:, wanted]


def _correlations(values: FloatArray, lags: tuple[int, ...]) -> tuple[float, ...]:
    power = float(values @ values)
    return tuple(float(values[lag:] @ values[: len(values) - lag]) / power if power > 0.0 else 0.0 for lag in lags)


def _with(one: FloatArray, others: FloatArray) -> tuple[float, ...]:
    sizes = np.sqrt((one @ one) * np.einsum("ij,ij->i", others, others))
    found = np.divide(others @ one, sizes, out=np.zeros(len(others)), where=sizes > 1e-300)
    return tuple(float(value) for value in found)
