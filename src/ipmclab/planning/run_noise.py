"""The noise that the next run will have, as the runs of a fit had it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.fit.fit import Fit
from ipmclab.statespace.shape import Shape, spread_by
from ipmclab.statespace.terms import Terms

FloatArray = npt.NDArray[np.float64]

NOT_EXCLUDED: Final = "drift-not-excluded"
"""The finding of a fit that a drift would look as the slow answer of the strip."""


@dataclass(frozen=True, eq=False)
class RunNoise:
    """Noise of one output.

    Parameters
    ----------
    deviation : float [SI]
        Of a residual: what its rows are weighed by.
    shape : Shape
        In units of that deviation.
    step : float [s]
        Of its autoregression or walk; 0 where it is white.
    slope_not_excluded : bool
        Whether no run of the fit would have shown a slope: a run that turns back would.
    """

    deviation: float
    shape: Shape
    step: float = 0.0
    slope_not_excluded: bool = False

    @classmethod
    def of(cls, fit: Fit, output: str) -> RunNoise:
        """That of the latest run in which an output was read; of white noise the mean square over runs.

        A zero or a slope that some run had for itself, the next one has too.
        """
        observations = fit.observations
        doubted = any(one.code == NOT_EXCLUDED and one.channel == output for one in fit.findings)
        own = [one for one in observations if output in one.noise]
        zero, slope = (
            any(output in one for one in each) for each in zip(*((o.offset, o.drift) for o in own), strict=True)
        )
        model = own[-1].noise_model.get(output)
        if model is None:
            deviation = math.sqrt(sum(one.noise[output] ** 2 for one in own) / len(own))
            return cls(deviation, Shape(Terms(offset=zero, trend=slope), np.zeros(0), 1.0))
        deviation = own[-1].noise[output]
        terms = model.terms
        terms = Terms(terms.order, terms.walk, terms.white, terms.offset or terms.walk or zero, terms.trend or slope)
        return cls(deviation, Shape(terms, model.entries, (model.driven / deviation) ** 2), model.step, doubted)

    def constants(self, time: FloatArray, voltage: FloatArray) -> FloatArray:
        """The columns of a zero and a slope of the sensor, shape (n_time, n), where a run has them for itself."""
        turns_back = bool(voltage.min(initial=0.0) < 0.0 < voltage.max(initial=0.0))
        columns = [np.ones(len(time))] if self.shape.terms.offset else []
        if self.shape.terms.trend and not (self.slope_not_excluded and turns_back):
            columns.append(time - time.mean())
        return np.array(columns).reshape(len(columns), len(time)).T

    def score_covariance(self, rows: FloatArray, rate: float) -> FloatArray:
        """``rows' V rows`` for the covariance V of the noise in standard deviations; it is no faster than it was read.

        Parameters
        ----------
        rows : float array, shape (n_time, n)
        rate : float [Hz]
        """
        if not (self.shape.terms.order or self.shape.terms.walk):
            return self.shape.variance * (rows.T @ rows)
        steps = np.full(len(rows), max(round(1.0 / (rate * self.step)), 1), dtype=np.int64)
        return spread_by(rows, steps, self.shape)
