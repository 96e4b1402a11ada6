"""The information of runs on the parameters of a fit, before they are recorded.

``identify`` takes least squares of the readings whatever their noise. With the Jacobian J of some runs, their rows in
standard deviations of the noise, the covariance V of the noise, H = J'J and M = J'VJ, its covariance is H^-1 M H^-1.
Their information is therefore H M^+ H; under white noise it is H itself. H and M of runs add. What a run has for
itself, the zero of a sensor or how wet the strip was, is projected out of J before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.normal_equations import pseudo_inverse
from ipmclab.planning.answer import Answer
from ipmclab.planning.run_noise import RunNoise

FloatArray = npt.NDArray[np.float64]

_NOTHING: Final = 1e-9  # part of a column that is left after what the run has for itself: rounding


@dataclass(frozen=True, eq=False)
class RunInformation:
    """The information of runs; the entries of what is fitted come first, then fixed values with a stated uncertainty.

    Parameters
    ----------
    products : float array, shape (n, n + n_held)
        J'J.
    score_covariance : float array, shape (n, n)
        J'VJ of the entries.
    rivals : tuple of RunInformation
        The same for each rival, with how much of the way to it the strip is (0 or 1) as one entry more, the last.
    """

    products: FloatArray
    score_covariance: FloatArray
    rivals: tuple[RunInformation, ...] = ()

    def __add__(self, other: RunInformation) -> RunInformation:
        """The information of runs together."""
        rivals = tuple(one + another for one, another in zip(self.rivals, other.rivals, strict=True))
        return RunInformation(self.products + other.products, self.score_covariance + other.score_covariance, rivals)

    @property
    def information(self) -> FloatArray:
        """About the entries, then between them and the held values, shape (n, n + n_held)."""
        count = len(self.score_covariance)
        own = self.products[:, :count]
        found = own @ pseudo_inverse(self.score_covariance) @ own
        found = 0.5 * (found + found.T)
        return np.hstack([found, found @ pseudo_inverse(own) @ self.products[:, count:]])


def information_of(
    answer: Answer, noise: Mapping[str, RunNoise], rate: float, to_rivals: Sequence[Mapping[str, FloatArray]] = ()
) -> RunInformation:
    """The information of a run.

    Parameters
    ----------
    answer : Answer
    noise : mapping of output to RunNoise
    rate : float [Hz]
    to_rivals : sequence of mapping of output to float array, shape (n_time,) [SI]
        How far each rival answers from the strip.
    """
    outputs = list(noise)

    def stacked(of: Callable[[str], FloatArray]) -> FloatArray:
        return np.vstack([of(output) / noise[output].deviation for output in outputs])

    rows = stacked(
        lambda output: np.column_stack(
            [answer.entries[output], answer.held[output], *(one[output] for one in to_rivals)]
        )
    )
    left = _without(rows, _of_the_run(answer, noise, stacked), water_row=bool(answer.water))
    count, held, length = answer.entries[outputs[0]].shape[1], answer.held[outputs[0]].shape[1], len(answer.time)
    score_covariance = left[length * len(outputs) :].T @ left[length * len(outputs) :]
    for place, output in enumerate(outputs):
        score_covariance = score_covariance + noise[output].score_covariance(
            left[place * length : (place + 1) * length], rate
        )
    products = left.T @ left
    own, asked = slice(0, count), slice(0, count + held)
    rivals = []
    for place in range(count + held, len(products)):
        some = np.ix_([*range(count), place], [*range(count), place])
        rivals.append(RunInformation(products[some], score_covariance[some]))
    return RunInformation(products[own, asked], score_covariance[own, own], tuple(rivals))


def _of_the_run(
    answer: Answer, noise: Mapping[str, RunNoise], stacked: Callable[[Callable[[str], FloatArray]], FloatArray]
) -> FloatArray:
    """The columns of what a run has for itself: zeros and slopes of sensors, parameters, and last its water."""
    constants = {output: each.constants(answer.time, answer.voltage) for output, each in noise.items()}

    def of_sensors(output: str) -> FloatArray:
        return np.hstack([each if name == output else np.zeros_like(each) for name, each in constants.items()])

    columns = [stacked(of_sensors), stacked(lambda output: answer.own[output])]
    if answer.water:
        columns.append(stacked(lambda output: answer.water[output][:, None]))
    return np.hstack(columns)


def _without(rows: FloatArray, aside: FloatArray, *, water_row: bool) -> FloatArray:
    """Columns without what the last others can make up; the water is known to one standard error, a row of its own."""
    if water_row:
        rows = np.vstack([rows, np.zeros(rows.shape[1])])
        aside = np.vstack([aside, np.eye(aside.shape[1])[-1]])
    length = np.linalg.norm(aside, axis=0)
    aside = aside[:, length > 0.0] / length[length > 0.0]
    if not aside.shape[1]:
        return rows
    basis, weights, _ = np.linalg.svd(aside, full_matrices=False)
    basis = basis[:, weights > _NOTHING * weights[0]]
    left = rows - basis @ (basis.T @ rows)
    left[:, np.linalg.norm(left, axis=0) <= _NOTHING * np.linalg.norm(rows, axis=0)] = 0.0
    return np.asarray(left)
