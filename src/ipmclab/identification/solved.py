"""The solved problem behind a fit, for what may follow: profiles, samples, each run left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.unseen import Unseen
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.valleys import Rival
from ipmclab.model.parameters import Parameter
from ipmclab.run import Finding


@dataclass(frozen=True, eq=False)
class Estimate:
    """The solved problem, and what was found out about the runs on the way.

    ``parameters`` are those of the actuator that was given. ``rivals`` are other fits that the
    readings do not distinguish from the solution. ``unseen`` are stages that were taken out of the problem;
    ``with_unseen`` is the fit that still had them, where there are any. ``white`` is the same point in the problem
    without the additional zeros and slopes of sensors, or the point under the noise where that is as good.
    """

    parameters: Mapping[str, Parameter]
    problem: Problem
    solution: Solution
    rivals: tuple[Rival, ...]
    findings: tuple[Finding, ...]
    correlated: Correlated
    unseen: tuple[Unseen, ...] = ()
    with_unseen: Correlated | None = None
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
