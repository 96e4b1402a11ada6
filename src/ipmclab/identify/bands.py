"""How far a simulated output may lie from the truth, and from what would be read: bands from a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.identify.fit import Fit
from ipmclab.identify.observation import Observation
from ipmclab.model.sensitivity import sensitivities
from ipmclab.run import Run

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bands:
    """A simulated run with its uncertainty.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    predicted : mapping of output to float array, shape (n_time,) [SI]
    of_parameters : mapping of output to float array, shape (n_time,) [SI]
        Standard deviation from the parameters: of the strip's answer itself.
    of_noise : mapping of output to float array, shape (n_time,) [SI]
        Standard deviation of the noise of a reading, as the runs of the fit had it: zero and drift of a new run are not
        known beforehand, so those of the fit count as spread.
    left_out : tuple of str
        Free parameters of which nothing is known: the band does not contain what they may change.
    """

    time: FloatArray
    predicted: Mapping[str, FloatArray]
    of_parameters: Mapping[str, FloatArray]
    of_noise: Mapping[str, FloatArray]
    left_out: tuple[str, ...]

    def interval(self, output: str, level: float = 0.95, *, of_readings: bool = True) -> tuple[FloatArray, FloatArray]:
        """Ends between which a reading lies (or the strip's answer itself) with a probability, shape (n_time,) each.

        Raises
        ------
        InputError
            A probability that is not between 0 and 1.
        """
        from scipy.special import ndtri

        if not 0.0 < level < 1.0:
            raise InputError(
                f"a probability of {level:g} is none",
                code="bad-level",
                where="level",
                repair="give one between 0 and 1, such as 0.95",
            )
        noise = self.of_noise[output] if of_readings else 0.0
        reach = float(ndtri(0.5 + 0.5 * level)) * np.sqrt(self.of_parameters[output] ** 2 + np.square(noise))
        return self.predicted[output] - reach, self.predicted[output] + reach


def prediction_bands(fit: Fit, run: Run) -> Bands:
    """Simulate a fitted actuator at the voltage of a run that starts at rest, with bands.

    The parameters count to first order, with the errors and correlations of the fit.

    Parameters
    ----------
    fit : Fit
    run : Run
        Its time, voltage and hold are used; what was read is not.

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab import Run, identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> clean = simulate(strip, "step 1 V", duration=40, rate=50)
    >>> noise = 1e-4 * np.random.default_rng(20261121).standard_normal(2000)
    >>> run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
    >>> fit = identify(strip, [run], free="electrical")
    >>> bands = prediction_bands(fit, simulate(strip, "sine 1 V 0.2 Hz", duration=10, rate=50))
    >>> low, high = bands.interval("current")
    >>> bool(1.9e-4 < np.median(high - bands.predicted["current"]) < 2.1e-4)
    True
    """
    outputs = list(dict.fromkeys(name for observation in fit.observations for name in observation.noise))
    free = [name for name in fit.parameters if name in fit.actuator.parameter_values]
    errors = np.array([fit.parameters[name].standard_error for name in free])
    known = [name for name, error in zip(free, errors, strict=True) if np.isfinite(error)]
    found = sensitivities(fit.actuator, known, run.time, run.voltage, run.hold, outputs=outputs)
    deviation = errors[np.isfinite(errors)]
    correlation = np.array([[fit.correlations[one][other] for other in known] for one in known])
    covariance = correlation.reshape(len(known), len(known)) * np.outer(deviation, deviation)
    since = run.time - run.time[0]
    predicted: dict[str, FloatArray] = {}
    of_parameters: dict[str, FloatArray] = {}
    of_noise: dict[str, FloatArray] = {}
    for row, output in enumerate(outputs):
        slopes = found.parameters[row]
        predicted[output] = np.asarray(found.values[row])
        of_parameters[output] = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance, slopes), 0.0))
        seen = [observation for observation in fit.observations if output in observation.noise]
        of_noise[output] = _of_noise(seen, output, since)
    return Bands(run.time, predicted, of_parameters, of_noise, tuple(name for name in free if name not in set(known)))


def _of_noise(seen: Sequence[Observation], output: str, since: FloatArray) -> FloatArray:
    """Root of the mean square over the runs of a fit."""
    total = np.zeros(len(since))
    for observation in seen:
        model = observation.noise_model.get(output)
        total += observation.noise[output] ** 2 if model is None else model.deviation(since) ** 2
        total += (observation.offset.get(output, 0.0) + observation.drift.get(output, 0.0) * since) ** 2
    return np.asarray(np.sqrt(total / len(seen)))
