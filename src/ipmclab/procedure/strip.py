"""What the steps share: the strip's dimensions, an actuator to fit, and how a fit passes on what it took as known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.fit import Fit, FittedParameter
from ipmclab.identification.solved import solved
from ipmclab.identification.uncertainty.covariance import uncertainty
from ipmclab.measurement.uncertain import Uncertain
from ipmclab.model import Actuator, load_actuator
from ipmclab.model.order import Order
from ipmclab.normal_equations import root
from ipmclab.sample import Sample

FloatArray = npt.NDArray[np.float64]

_NO_LEVERAGE: Final = 1e-9  # change of a logarithm for 1 % of what does not matter

OTHER_FITS: Final = "other fits that are as good"

GEOMETRY: Final = ("free_length", "clamped_length", "width", "thickness", "sensing_length")

_STANDS_IN: Final = "friend-2"
"""Gives a value to what a step does not look at; nothing of it is ever reported."""


def branch_names(count: int) -> tuple[str, ...]:
    """The parameters of the branches, in the order of an actuator's file."""
    return tuple(f"circuit.branches.{i}.{what}" for i in range(count) for what in ("resistivity", "permittivity"))


def actuator_of(
    name: str,
    known: Mapping[str, Uncertain],
    branches: int,
    *,
    sample: Sample | None = None,
    uncertain: Mapping[str, float] | None = None,
) -> Actuator:
    """An actuator with what is known so far.

    Parameters
    ----------
    name : str
    known : mapping of dotted name to Uncertain
    branches : int
    sample : Sample, optional
    uncertain : mapping of dotted name to float [SI], optional
        Standard uncertainties that it states; none unless given, so that a fit takes everything as exact.
    """
    other = load_actuator(_STANDS_IN).parameter_values
    values = {key: value for key, value in other.items() if not key.startswith("circuit.branches.")}
    for i in range(branches):
        source = min(i, 1)
        for what in ("resistivity", "permittivity"):
            values[f"circuit.branches.{i}.{what}"] = other[f"circuit.branches.{source}.{what}"] * 4.0 ** (i - source)
    values |= {key: amount.value for key, amount in known.items() if key in values}
    return Actuator(name, values, uncertain or {}, sample)


@dataclass(frozen=True, eq=False)
class FittedAmounts:
    """What a fit found, with what its own noise and everything that it was given contribute.

    Parameters
    ----------
    fit : Fit
    relative : mapping of dotted name to mapping of source to float
        Relative contributions to each free parameter, also to those that the fit did not determine.
    assumed : frozenset of str
        Sources of which nobody stated the uncertainty.
    elsewhere : tuple of mapping of dotted name to float [SI]
        The parameters of other fits that the readings do not distinguish from this one.
    """

    fit: Fit
    relative: Mapping[str, Mapping[str, float]]
    assumed: frozenset[str]
    elsewhere: tuple[Mapping[str, float], ...] = ()

    @property
    def determined(self) -> dict[str, Uncertain]:
        """Of the parameters that the fit determined."""
        return {name: one for name, one in self.all.items() if self.fit.parameters[name].determined}

    @property
    def all(self) -> dict[str, Uncertain]:
        """Of every free parameter, however little is known of it."""
        return {name: self.product({name: 1.0}) for name in self.relative}

    def product(self, powers: Mapping[str, float]) -> Uncertain:
        """A product of powers of parameters, which may be known where the parameters are not."""
        parts = dict[str, float]()
        for name, power in powers.items():
            for source, part in self.relative[name].items():
                parts[source] = parts.get(source, 0.0) + power * part
        value = _product({name: one.value for name, one in self.fit.parameters.items()}, powers)
        farthest = max((abs(np.log(_product(other, powers) / value)) for other in self.elsewhere), default=0.0)
        if farthest > NORMAL_95 * np.linalg.norm(list(parts.values())):
            parts[OTHER_FITS] = float(farthest) / NORMAL_95
        return Uncertain(value, {source: value * part for source, part in parts.items()}, self.assumed)


def _product(values: Mapping[str, float], powers: Mapping[str, float]) -> float:
    return float(np.prod([values[name] ** power for name, power in powers.items()]))


def amounts_of_fit(fit: Fit, held: Mapping[str, Uncertain], source: str) -> FittedAmounts:
    """What a fit found, with its contributions.

    Parameters
    ----------
    fit : Fit
        Of ``identify``, with everything that was held taken as exact; its free parameters are positive.
    held : mapping of dotted name to Uncertain
        What it was given as fixed.
    source : str
        What the contribution of its noise, and of what was known beforehand, is called.
    """
    estimate = solved(fit)
    correlated = estimate.correlated
    problem, solution = correlated.problem, correlated.solution
    names = [name for name, amount in held.items() if amount.parts and problem.base.get(name)]
    found = uncertainty(correlated, {}, names)
    asked = [unknown for _, unknown in problem.asked]
    order = Order(problem.in_reference(solution.theta, problem.records[0].place))
    parted = root(found.covariance)
    relative: dict[str, dict[str, float]] = {}
    for number, unknown in enumerate(asked):
        name = order(unknown.name)
        parameter = fit.parameters.get(name)
        if parameter is None or not unknown.log:
            continue
        wider = _wider(parameter, float(np.sqrt(max(found.covariance[number, number], 0.0))))
        parts = {f"{source}#{k}": wider * float(part) for k, part in enumerate(parted[number]) if part}
        for other in names:
            _add(parts, held[other], float(found.slopes[other][number]))
        relative[name] = parts
    used = [held[name] for name in names if np.any(np.abs(found.leverage[name]) > _NO_LEVERAGE)]
    assumed = frozenset().union(*(one.assumed for one in used))
    elsewhere = tuple(
        {order(u.name): u.value(rival.entries[u.name]) for u in asked if u.name in rival.entries}
        for rival in estimate.rivals
    )
    whole = tuple(one for one in elsewhere if relative.keys() <= one.keys())
    return FittedAmounts(fit, relative, assumed, whole)


def _wider(parameter: FittedParameter, own: float) -> float:
    """By what an interval is wider than the curvature says: few degrees of freedom, a profile, other minima."""
    low, high = parameter.interval
    if not (parameter.determined and own > 0.0 and low > 0.0 and np.isfinite(high)):
        return 1.0
    return max(1.0, 0.5 * float(np.log(high / low)) / NORMAL_95 / own)


def _add(parts: dict[str, float], amount: Uncertain, slope: float) -> None:
    for source, part in amount.parts.items():
        parts[source] = parts.get(source, 0.0) + slope * part
