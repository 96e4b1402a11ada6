"""Restricted likelihood of the noise of one output of one run, with all other readings of a fit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ipmclab.normal_equations import root_of_inverse
from ipmclab.progress import tick
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import Columns, without
from ipmclab.statespace.kernels import restricted
from ipmclab.statespace.terms import Terms


@dataclass(frozen=True, eq=False)
class Likelihood:
    """How likely the readings are under a noise, its scale chosen to make them most likely.

    Parameters
    ----------
    deviance : float
        Minus twice the restricted log likelihood (Patterson and Thompson 1971), of this output's readings given all
        others; up to a constant that is the same for all shapes with the same constants.
    criterion : float
        Bayes's information criterion, from the likelihood itself (which is comparable between different constants).
    variance : float
        Square of the scale, in units of the residual.
    products : float array, shape (n_directions + 1, n_directions + 1)
        What these readings add to the normal equations, residual last.
    """

    deviance: float
    criterion: float
    variance: float
    products: FloatArray


@dataclass(frozen=True, eq=False)
class Others:
    """What all other readings add to the normal equations, weighted by their own noise.

    Parameters
    ----------
    products : float array, shape (n_directions + 1, n_directions + 1)
        Residual last.
    """

    products: FloatArray

    @cached_property
    def root(self) -> tuple[FloatArray, float]:
        """A root of the inverse of those of the directions, and their log determinant: the same at every noise."""
        return root_of_inverse(self.products[:-1, :-1])


def likelihood(
    columns: Columns, others: Others, terms: Terms, entries: FloatArray, variance: float = 1.0
) -> Likelihood:
    """The likelihood at a shape of the noise.

    Parameters
    ----------
    columns : Columns
    others : Others
    terms : Terms
    entries : float array, shape (terms.shapes,)
    variance : float
        Where the search for the scale starts.
    """
    tick()
    every, logarithm = columns.products(terms, entries)
    own, of_constants = without(every, terms)
    root, of_directions = others.root
    levels, turn = np.linalg.eigh(root.T @ own[:-1, :-1] @ root)
    turned = (root @ turn).T
    variance, misfit, more = restricted(
        np.maximum(levels, 0.0),
        np.concatenate([turned @ own[:-1, -1], own[-1:, -1]]),
        np.concatenate([turned @ others.products[:-1, -1], others.products[-1:, -1]]),
        float(columns.count - terms.constants),
        variance,
    )
    of_directions += more
    full = columns.count * math.log(variance) + logarithm + misfit
    deviance = full - terms.constants * math.log(variance) + of_constants + of_directions
    if not math.isfinite(deviance):
        deviance = full = math.inf
    criterion = full + (terms.shapes + terms.constants) * math.log(columns.count)
    return Likelihood(deviance, criterion, variance, own / variance)
