"""Least squares beside slopes of sensors, once it is settled that the noise does not weigh the readings.

Least squares counts every reading as one. What is known of a slope from the rows at 0 V is then outvoted by thousands
of readings that a slow noise, or what the model lacks, makes worth as much as a few: the slope goes where they want it,
takes up the strip's own slow answer, and spoils the prediction. ``Zero.under`` holds both against each other as they
are worth. Where the noise weighs the readings itself, it does that for all of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from ipmclab.identification.noise.correlate import Again, Correlated
from ipmclab.identification.noise.pieces import System, refine_noise
from ipmclab.identification.noise.zeros import DriftingProblem

_MORE: Final = 1.1  # times as much as white noise, from which a slope moves


def with_worth(least: Correlated, again: Again) -> Correlated:
    """Least squares with what is known of slopes held against readings that are worth what their noise makes of them.

    Parameters
    ----------
    least : Correlated
        Of least squares, every reading counted as one.
    again : function of (Problem, Solution)
        The minimum of a problem, from near it and from elsewhere.
    """
    zeros = {
        key: zero.under(least.shapes[key], least.pieces[key].steps) if key in least.shapes else zero
        for key, zero in least.zeros.items()
    }
    if all(zero.times <= _MORE for zero in zeros.values()):
        return least
    problem = DriftingProblem(least.problem.plain, zeros)
    near = replace(least.solution, evaluation=problem.evaluate(least.solution.theta))
    found, solution = again(problem, near)
    plain = found.plain.evaluate(solution.theta)
    pieces = [piece for key, piece in least.pieces.items() if key in least.shapes]
    shapes = refine_noise(System(found.plain, plain, pieces), least.shapes)
    return replace(least, problem=found, solution=solution, plain=plain, shapes=shapes)
