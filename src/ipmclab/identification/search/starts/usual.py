"""A start that no record shows: the coupling of a usual strip."""

from __future__ import annotations

import numpy as np

from ipmclab.identification.problem.problem import Problem
from ipmclab.model.declared import MOTION, declaration_of, in_group
from ipmclab.model.stages.coupling import GAIN
from ipmclab.run import FloatArray


def usual_coupling(problem: Problem, near: FloatArray) -> FloatArray | None:
    """The coupling of a usual strip, with the gain that these readings ask for; None where no coupling is free.

    Parameters
    ----------
    problem : Problem
    near : float array, shape (n_unknown,)
        Gives all else.
    """
    theta = near.copy()
    if not any(in_group(MOTION, [unknown.base]) for unknown in problem.unknowns):
        return None
    gain = None
    for place, unknown in enumerate(problem.unknowns):
        declared = declaration_of(unknown.base)
        if in_group(MOTION, [unknown.base]) and declared is not None and declared.usual is not None:
            theta[place] = unknown.entry(unknown.inside(declared.usual))
            gain = place if unknown.base == GAIN else gain
    if gain is not None:
        here = problem.evaluate(theta)
        # Motion is in proportion to the gain: its derivative by the logarithm is the motion itself.
        motion = here.jacobian[:, gain]
        factor = float(motion @ (motion - here.residual)) / max(float(motion @ motion), 1e-300)
        theta[gain] += np.log(factor) if factor > 0.0 else 0.0
    return theta
