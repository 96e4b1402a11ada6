"""A pole of the coupling beside its zero: a slow part of force or motion that need not be of the coupling at all.

A zero that nearly cancels a pole leaves one pole for everything fast, and a slow part of a few percent. Noise looks
like such a part somewhere, and so does a circuit that is held a percent or two off: the drop over the electrodes
follows the current. A fit of the readings without it is then as good, though it lies higher than the chi-square of one
parameter allows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.stated import stated_covariance
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.tangent import entry_errors
from ipmclab.identification.search.valleys import SURE, SURELY_SOMEWHERE, Rival
from ipmclab.model import Actuator
from ipmclab.named_matrix import matrix_of
from ipmclab.normal_equations import root
from ipmclab.run import FloatArray

_SAME_POLE: Final = 0.1  # of a pole: a zero nearer than that leaves a slow part of less than a tenth of d(0)
_HELD: Final = 0.02  # of what is held without a stated uncertainty: as well as four probes and a fit know it
_CIRCUIT: Final = ("circuit.", "leak.")

COUPLING: Final = ("coupling.gain", "coupling.zero", "coupling.p1", "coupling.p2")
"""The parameters of d(s)."""


def has_doublet(values: Mapping[str, float]) -> bool:
    """Whether a real pole of d(s) = K_d (s + Z_d)/(s^2 + P_1d s + P_2d) lies beside its zero.

    Parameters
    ----------
    values : mapping of name to float [SI]

    Examples
    --------
    >>> from ipmclab.identification.search.doublet import has_doublet
    >>> has_doublet({"coupling.zero": 0.1, "coupling.p1": 2.9, "coupling.p2": 0.28})
    True
    """
    zero, p1, p2 = (values[f"coupling.{name}"] for name in ("zero", "p1", "p2"))
    under = 0.25 * p1**2 - p2
    if under < 0.0:
        return False
    fast = 0.5 * p1 + math.sqrt(under)
    return any(abs(zero - pole) < _SAME_POLE * pole for pole in (fast, p2 / fast))


def without_doublet(
    lowest: tuple[Problem, Solution], higher: tuple[Problem, Solution], actuator: Actuator
) -> Rival | None:
    """Another minimum, where the readings tell the solution from it by a doublet alone that need not be there.

    Both are compared with the circuit that is held moved as far as it may be off: by its stated uncertainty (together
    what an earlier fit found together), else by 2 %, to first order.

    Parameters
    ----------
    lowest, higher : pair of Problem and Solution
        The two minima, each with its problem: starting amplitudes may be as many as its own start tells apart.
    actuator : Actuator
        With the uncertainties that are stated.
    """
    (problem, solution), (its, other) = lowest, higher
    place = problem.records[0].place
    if not has_doublet(problem.values(solution.theta, place)) or has_doublet(its.values(other.theta, place)):
        return None
    free = {unknown.base for unknown in problem.unknowns}
    known = actuator.parameter_values
    held = {
        name: value
        for name, value in problem.base.items()
        if name.startswith(_CIRCUIT) and name not in free and value and name in known
    }
    off = _may_be_off(actuator, held)
    variance = solution.evaluation.per_residual
    costs = [_loosened(of, one, list(held), off, variance) for of, one in (lowest, higher)]
    if costs[1] - costs[0] > SURELY_SOMEWHERE * variance:
        return None
    return Rival.of(its, other.theta, entry_errors(other.evaluation) * math.sqrt(variance * SURE))


def _may_be_off(actuator: Actuator, held: Mapping[str, float]) -> FloatArray:
    """By how much each value that is held [SI] is off as each of as many independent causes is one deviation off."""
    stated = actuator.standard_uncertainties
    found = np.diag([stated.get(name) or _HELD * abs(value) for name, value in held.items()])
    uncertain = [number for number, name in enumerate(held) if stated.get(name)]
    table = stated_covariance(actuator, [name for name in held if stated.get(name)])
    together = matrix_of(table, table)
    if np.count_nonzero(together - np.diag(together.diagonal())):
        found[np.ix_(uncertain, uncertain)] = root(together)
    return found


def _loosened(problem: Problem, solution: Solution, held: Sequence[str], off: FloatArray, variance: float) -> float:
    """The least cost with what is held free to move about its value, to first order."""
    if not held:
        return solution.evaluation.cost
    moved = problem.fixed_jacobian(solution.theta, held) @ off
    jacobian = solution.evaluation.jacobian
    columns = np.hstack([jacobian, moved])
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    known = np.hstack([np.zeros((len(held), jacobian.shape[1])), math.sqrt(variance) * np.eye(len(held))]) / size
    rows = np.vstack([columns / size, known])
    residual = np.concatenate([solution.evaluation.residual, np.zeros(len(held))])
    step = np.linalg.lstsq(rows, residual, rcond=1e-8)[0]
    left = residual - rows @ step
    return float(left @ left)
