"""What a further run is for, as a number that it makes smaller [nats]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.planning.answer import Answer
from ipmclab.planning.knowledge import Knowledge

FloatArray = npt.NDArray[np.float64]

GoalName = Literal["parameters", "prediction", "model"]


class Goal(Protocol):
    """What a further run is for."""

    def loss(self, known: Knowledge) -> float:
        """How far the goal is away."""


class Parameters:
    """Smallest volume of the joint interval of all parameters (D-optimal)."""

    def loss(self, known: Knowledge) -> float:
        """Half the logarithm of the determinant of their covariance."""
        count = len(known.beforehand)
        return 0.5 * float(np.linalg.slogdet(known.covariance[:count, :count])[1])


@dataclass(frozen=True, eq=False)
class Prediction:
    """Smallest variance of what is predicted for some inputs (I-optimal).

    Parameters
    ----------
    products : mapping of output to float array, shape (n + n_held, n + n_held)
        Mean over rows and inputs of the products of the derivatives, over the mean square of the answer.
    """

    products: dict[str, FloatArray]

    @classmethod
    def of(cls, answers: Sequence[Answer]) -> Prediction:
        """From what the strip answers to the inputs."""
        products = {}
        for output in answers[0].entries:
            rows = [np.hstack([answer.entries[output], answer.held[output]]) for answer in answers]
            power = sum(float(np.mean(answer.outputs[output] ** 2)) for answer in answers)
            products[output] = np.sum([each.T @ each / len(each) for each in rows], axis=0) / max(power, 1e-300)
        return cls(products)

    def errors(self, known: Knowledge) -> dict[str, float]:
        """Root mean square error of the prediction of each output, over that of the answer."""
        return {
            output: math.sqrt(max(float(np.sum(products * known.covariance)), 0.0))
            for output, products in self.products.items()
        }

    def loss(self, known: Knowledge) -> float:
        """Half the logarithm of the mean relative variance, for each parameter."""
        squares = [error**2 for error in self.errors(known).values()]
        return 0.5 * math.log(max(sum(squares) / len(squares), 1e-300))


@dataclass(frozen=True)
class Model:
    """Largest evidence for the rival that is distinguished worst, if it is true (T-optimal).

    Parameters
    ----------
    units : tuple of float
        What counts as much for each rival: amounts of a stage that nobody knows are not compared with each other.
    """

    units: tuple[float, ...]

    @classmethod
    def of(cls, offers: Sequence[Knowledge]) -> Model:
        """From what each single run would leave known: as much as the best run says of each of several rivals."""
        each = np.array([one.evidence for one in offers])
        return cls(tuple(np.maximum(each.max(axis=0), 1e-300)) if each.ndim > 1 and each.shape[1] > 1 else (1.0,))

    def loss(self, known: Knowledge) -> float:
        """Minus the expected gain of the logarithm of the likelihood."""
        pairs = zip(known.evidence, self.units, strict=False)
        return -0.5 * min((found / unit for found, unit in pairs), default=0.0)
