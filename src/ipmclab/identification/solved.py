"""The solved problem behind a fit, for what may follow: profiles, samples, each run left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.unseen import Unseen
from ipmclab.identification.problem.order import Order
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.again import Fitted
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.valleys import Rival
from ipmclab.model.parameters import Parameter
from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimate:
    """The solved problem, and what was found out about the runs on the way.

    ``parameters`` are those of the actuator that was given. ``rivals`` are other fits that the
    readings do not tell from the solution. ``unseen`` are stages that were taken out of the problem;
    ``beside`` is the fit that still had them, where there are any. ``white`` is the same point in the problem without
    zeros and slopes of sensors beside it, or the point under the noise where that is as good.
    """

    parameters: Mapping[str, Parameter]
    problem: Problem
    solution: Solution
    rivals: tuple[Rival, ...]
    findings: tuple[Finding, ...]
    correlated: Correlated
    unseen: tuple[Unseen, ...] = ()
    beside: Correlated | None = None
    white: tuple[Problem, Solution] | None = None


def solved(fit: Fit) -> Estimate:
    """The solved problem behind a fit.

    Raises
    ------
    InputError
        There is none in a fit that was read from a file.
    """
    if not isinstance(fit.estimate, Estimate):
        raise InputError(
            "this fit was read from a file, which does not hold the readings",
            code="fit-without-readings",
            where="fit",
            repair="identify again from its runs, and use the fit that returns",
        )
    return fit.estimate


def fitted(fit: Fit) -> Fitted:
    """Where fits to other readings of the same runs start.

    Raises
    ------
    InputError
        As ``solved``.
    """
    estimate = solved(fit)
    starts = [rival.vector_of(estimate.problem.unknowns, estimate.solution.theta) for rival in estimate.rivals]
    correlated = estimate.correlated
    return Fitted(correlated.problem, correlated.solution.theta, correlated.solution.evaluation, starts)


def values_of(problem: Problem, thetas: Sequence[FloatArray]) -> dict[str, FloatArray]:
    """The value [SI] of each parameter in each of some fits, shape (n_fits,).

    Branches and modes are named by their place in the row of time constants, in each fit anew; NaN where what is free
    has another place there.
    """
    first = problem.records[0].place
    asked = [(place, unknown) for place, unknown in enumerate(problem.unknowns) if not unknown.nuisance]
    each = []
    for theta in thetas:
        order = Order(problem.in_reference(theta, first))
        each.append({order(unknown.name): unknown.value(float(theta[place])) for place, unknown in asked})
    names = dict.fromkeys(name for one in each for name in one)
    return {name: np.array([one.get(name, np.nan) for one in each]) for name in names}
