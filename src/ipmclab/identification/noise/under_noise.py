"""Questions to the readings whose answers hang on their noise: whether a run began at rest, and whether a stage shows.

White noise is what a first fit takes for granted. Under autocorrelated noise a start from rest is contradicted,
and a stage is seen, far more often than the tests for white noise say.
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from ipmclab.confidence import REJECT
from ipmclab.identification.noise.correlate import Correlated


def at_rest_after_all(under: Correlated, places: Set[int]) -> dict[int, list[int]]:
    """Runs whose start differs from rest by no more than their noise does, and the entries of their start.

    Parameters
    ----------
    under : Correlated
    places : set of int
        Of the runs whose start was freed because white noise would contradict rest.
    """
    if not under.shapes:
        return {}
    found: dict[int, list[int]] = {}
    for place in places:
        there = [
            column
            for column, unknown in enumerate(under.problem.unknowns)
            if unknown.is_start and unknown.place == place
        ]
        if there and could_be_zero(under, there):
            found[place] = there
    return found


def could_be_zero(under: Correlated, columns: Sequence[int]) -> bool:
    """Whether some linear unknowns differ from zero by no more than the noise makes them (Wald's test, 0.1 %)."""
    from scipy.special import chdtrc

    theta, jacobian = under.solution.theta[list(columns)], under.solution.evaluation.jacobian
    own, others = jacobian[:, columns], np.delete(jacobian, columns, axis=1)
    if others.shape[1]:
        own = own - others @ np.linalg.lstsq(others, own, rcond=1e-12)[0]
    beyond = own[under.problem.beforehand]
    middle = beyond.T @ beyond
    for key, piece in under.problem.pieces.items():
        middle = middle + under.spread(own[piece], key)
    # The score of zero, beside its covariance: no inverse of what the readings hardly see.
    score = own.T @ (own @ theta)
    statistic = float(score @ np.linalg.lstsq(middle, score, rcond=1e-10)[0])
    return bool(chdtrc(len(columns), statistic) > REJECT)
