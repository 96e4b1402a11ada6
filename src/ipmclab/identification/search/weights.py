"""What readings weigh: one over the noise that a fit leaves of them."""

from __future__ import annotations

import math

import numpy as np

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import Solution, known_beforehand


def found_noise(problem: Problem, solution: Solution) -> dict[tuple[int, str], float]:
    """Standard deviation of the residuals of each run and output, for the parameters that they had to feed."""
    pieces = problem.pieces
    total = sum(piece.stop - piece.start for piece in pieces.values())
    fed = len(problem.unknowns) - known_beforehand(solution.evaluation)
    freedom = max(total - fed, 1.0) / total
    noise = {}
    for key, piece in pieces.items():
        residual = solution.evaluation.residual[piece]
        active = max(int(np.count_nonzero(residual)), 1)  # a bound that holds says nothing about noise
        sigma = problem.noise[key] * math.sqrt(float(residual @ residual) / (active * freedom))
        noise[key] = max(sigma, problem.floors[key])
    return noise
