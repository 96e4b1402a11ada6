"""The unknowns of a fit as one vector: shared, per run, and what only an observation needs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ipmclab.identification.problem.edge_delay import EdgeDelay
from ipmclab.identification.problem.free import FreeParameters, Prior
from ipmclab.identification.problem.record import (
    LONGEST_DELAY,
    PreparedRun,
    at_their_rows,
    ending_of,
    places_of_mountings,
)
from ipmclab.model.declared import declaration_of, largest_proportional
from ipmclab.model.environment.age import Age
from ipmclab.model.parameters import Parameter
from ipmclab.model.stages.coupling import ZERO
from ipmclab.named_matrix import Table, matrix_of
from ipmclab.run import FloatArray


@dataclass(frozen=True)
class Unknown:
    """One entry of the vector that a fit moves.

    Parameters
    ----------
    name : str
        With its place where it belongs to one run: ``circuit.contact_resistance[0]``.
    base : str
        Without it.
    place : int or None
        The run, or None when several share it.
    places : tuple of int or None
        The runs that share it; None for all.
    log : bool
        Whether the entry is the logarithm of the value; else the value over ``scale``.
    scale : float [SI]
        What counts as a change of order one of a linear unknown.
    lower, upper : float [SI]
    nuisance : bool
        Needed for the fit, but not asked for: starting states.
    prior : pair of float, optional
        Centre and standard deviation of what is known of the entry beforehand; or those of the range where it lies, in
        which every value is as likely as another.
    is_range : bool
        Whether the prior is such a range.
    follows : mapping of name to pair of float
        By how much that centre moves with the entry of another unknown, and the standard deviation of that one.
    deviation : float, optional
        Of what is known of the entry, with what it follows; counted from these where those are independent.
    """

    name: str
    base: str
    place: int | None
    log: bool
    scale: float
    lower: float
    upper: float
    nuisance: bool = False
    prior: tuple[float, float] | None = None
    is_range: bool = False
    places: tuple[int, ...] | None = None
    follows: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    deviation: float | None = None

    def belongs_to(self, place: int) -> bool:
        """Whether it says something of a run."""
        return place in self.places if self.places is not None else self.place in (None, place)

    def entry(self, value: float) -> float:
        """The entry of the vector for a value."""
        return math.log(value) if self.log else value / self.scale

    def value(self, entry: float) -> float:
        """The value that an entry stands for, inside the bounds."""
        value = math.exp(min(entry, 700.0)) if self.log else entry * self.scale
        return self.inside(value)

    def values(self, entries: FloatArray) -> FloatArray:
        """The values that many entries stand for."""
        values = np.exp(np.minimum(entries, 700.0)) if self.log else entries * self.scale
        return np.asarray(np.clip(values, self.lower, self.upper))

    def inside(self, value: float) -> float:
        """A value, or the bound that it lies beyond."""
        return min(max(value, self.lower), self.upper)

    def chain(self, value: float) -> float:
        """Derivative of the value with respect to its entry."""
        return value if self.log else self.scale

    def known(self, value: float, uncertainty: float) -> Unknown:
        """The same with a prior: normal in the entry, and so log-normal in the value of a logarithm."""
        return replace(self, prior=(self.entry(value), uncertainty / self.chain(value)), is_range=False)

    def within(self, middle: float, half: float) -> Unknown:
        """The same with a range [SI] for a prior: a rectangular distribution."""
        return replace(self.known(middle, half / math.sqrt(3.0)), is_range=True)

    def size(self, value: float) -> float:
        """Against what the error of its entry counts: a logarithm by itself, else its value or its scale."""
        return 1.0 if self.log else max(abs(value) / self.scale, 1.0)

    @property
    def beforehand(self) -> tuple[float, float] | None:
        """Value and standard uncertainty that were known beforehand [SI]; None where that was nothing, or a range."""
        if self.prior is None or self.is_range:
            return None
        value = self.value(self.prior[0])
        deviation = self.deviation
        if deviation is None:
            deviation = math.hypot(self.prior[1], *(slope * other for slope, other in self.follows.values()))
        return value, deviation * self.chain(value)

    @property
    def is_water(self) -> bool:
        """Whether it says how wet the strip was in a run."""
        return self.base in (WATER, HUMIDITY)

    @property
    def is_start(self) -> bool:
        """Whether it is an amplitude of the state in which a run begins."""
        return self.base.startswith(_START)

    @property
    def is_of_sensor(self) -> bool:
        """Whether a sensor adds it to its readings: a zero or a slope."""
        return self.base.startswith(("observation.offset.", "observation.drift."))

    @property
    def limits(self) -> tuple[float, float]:
        """Bounds of the entry."""
        return self.entry(self.lower), self.entry(self.upper)


WATER: Final = "observation.water_content"
"""The water content of one run, of which something is known beforehand."""

HUMIDITY: Final = "observation.humidity"
"""The relative humidity [percent] with which the strip was in equilibrium in one run, where that was assumed."""

_START: Final = "observation.initial_state."

_LEAST: Final = 1e-3  # of the error of a run's water that is its own, were all of it shared

_AGED: Final = 0.1  # of a logarithm from the first run to the last: what counts as much
_WATER: Final = (0.7, 40.0)  # water contents that a fit tries: above the percolation of the conductivity
_FAR: Final = 100.0  # Nyquist rates
FARTHEST: Final = 6.0
"""Standard uncertainties within which a number is sought that is free merely because it is uncertain."""

_ALIKE: Final = 1e-9  # of a variance, that is left of it beside others: rounding of a covariance leaves no less


def actuator_unknown(parameter: Parameter, place: int | None) -> Unknown:
    """The unknown of one actuator parameter."""
    name = parameter.name if place is None else f"{parameter.name}[{place}]"
    declared = declaration_of(parameter.name)
    least = None if declared is None else declared.least
    log = parameter.transform == "log" or least is not None
    scale = 1.0 if log or declared is None else declared.scale
    lower = parameter.lower if least is None else max(parameter.lower, least)
    return Unknown(name, parameter.name, place, log, scale, lower, parameter.upper)


def _of_run(
    base: str, place: int, scale: float, lower: float = -math.inf, upper: float = math.inf, *, nuisance: bool = False
) -> Unknown:
    """A linear unknown of one run."""
    return Unknown(f"{base}[{place}]", base, place, False, scale, lower, upper, nuisance)


def with_known(unknowns: Sequence[Unknown], priors: Mapping[str, Prior]) -> list[Unknown]:
    """The unknowns, with what is known of them beforehand."""
    known = [u if u.base not in priors else u.known(priors[u.base].value, priors[u.base].uncertainty) for u in unknowns]
    deviations = {u.base: (u.chain(priors[u.base].value), u.prior[1]) for u in known if u.prior is not None}
    found = []
    for unknown in known:
        if unknown.base in priors:
            prior, (chain, _) = priors[unknown.base], deviations[unknown.base]
            others = ((other, slope, *deviations[other]) for other, slope in prior.follows.items())
            unknown = replace(
                unknown, follows={one: (slope * own / chain, deviation) for one, slope, own, deviation in others}
            )
            if prior.merely_uncertain and unknown.beforehand is not None:
                # Not to be sought farther from what is known than any honest measurement lies.
                value, uncertainty = unknown.beforehand
                low, high = value - FARTHEST * uncertainty, value + FARTHEST * uncertainty
                unknown = replace(unknown, lower=max(unknown.lower, low), upper=min(unknown.upper, high))
        found.append(unknown)
    return found


def known_together(unknowns: Sequence[Unknown], covariance: Table) -> list[Unknown]:
    """Unknowns of which something is known beforehand, each following those before it with which it is wrong together.

    Parameters
    ----------
    unknowns : sequence of Unknown
        With a prior each, of its own standard deviation.
    covariance : mapping of name to mapping of name to float [SI]
        Of what is known, by ``base``.
    """
    names = [unknown.base for unknown in unknowns]
    deviations = [unknown.prior[1] if unknown.prior is not None else math.inf for unknown in unknowns]
    sizes = [math.sqrt(covariance[name][name]) for name in names]
    correlation = matrix_of(covariance, names) / np.outer(sizes, sizes)
    found: list[Unknown] = []
    for place, unknown in enumerate(unknowns):
        before = np.flatnonzero(correlation[place, :place])
        if unknown.prior is None or not len(before):
            found.append(unknown)
            continue
        aside = correlation[place, before]
        weights = np.linalg.pinv(correlation[np.ix_(before, before)], rcond=_ALIKE, hermitian=True) @ aside
        own = deviations[place] * math.sqrt(max(1.0 - float(weights @ aside), _ALIKE))
        follows = {
            names[other]: (float(weight) * deviations[place] / deviations[other], deviations[other])
            for other, weight in zip(before, weights, strict=True)
        }
        centre = unknown.prior[0]
        found.append(replace(unknown, prior=(centre, own), follows=follows, deviation=deviations[place]))
    return found


def _of_states(free: FreeParameters, records: Sequence[PreparedRun]) -> list[Unknown]:
    """The water content of each run that is not exact, and how fast parameters age."""
    found = []
    states = {one.place: one.state for one in records if one.state is not None}
    for name in dict.fromkeys(name for state in states.values() for name in state.shared):
        places = tuple(place for place, state in states.items() if name in state.shared)
        found.append(Unknown(name, name, None, False, 1.0, -FARTHEST, FARTHEST, True, (0.0, 1.0), places=places))
    for place, state in states.items():
        if state.water_content is None or state.standard_uncertainty <= 0.0:
            continue
        # What a sensor reads is normal in the humidity: in the water content it would count wet errors for less.
        if state.humidity_uncertainty and state.relative_humidity is not None:
            base, value, error, ends = HUMIDITY, state.relative_humidity, state.humidity_uncertainty, (0.0, 100.0)
        else:
            base, (value, error), ends = WATER, state.known, _WATER
        parts = {name: part / state.known[1] for name, part in state.shared.items()}
        own = error * math.sqrt(max(1.0 - sum(part**2 for part in parts.values()), _LEAST**2))
        follows = {name: (error * part, 1.0) for name, part in parts.items()}
        found.append(replace(_of_run(base, place, 1.0, *ends, nuisance=True).known(value, own), follows=follows))
    for name in free.age:
        doses = [state.doses[Age.of(name).scale] for state in states.values()]
        span = max(doses, default=0.0) - min(doses, default=0.0)
        found.append(Unknown(name, name, None, False, _AGED / (span or 1.0), -math.inf, math.inf))
    return found


def _of_delays(records: Sequence[PreparedRun], delays: Mapping[int, EdgeDelay]) -> list[Unknown]:
    """By how much the edges of each foreign record lie after its rows."""
    foreign = [record for record in records if record.delay_is_free]
    found = []
    for record in foreign:
        reach, known = LONGEST_DELAY * record.period, delays[record.place]
        own = _of_run("observation.delay", record.place, record.period, -reach, reach)
        # Steps show how their edges lie to each other, and so the rows of all of them confine one common shift: that
        # their limits agree is no reason to believe in the middle between them.
        found.append(replace(own.known(known.value, known.error * math.sqrt(len(foreign))), is_range=True))
    return found


def _of_sensors(free: FreeParameters, records: Sequence[PreparedRun]) -> list[Unknown]:
    """What sensors may add: what is freed by name, and what the readings are asked for."""
    found = []
    for what in ("offset", "drift"):
        for record in records:
            duration = float(record.run.time[-1] - record.run.time[0])
            for output, reading in record.readings.items():
                base = f"observation.{what}.{output}"
                if base not in free.observation and (what, output) not in record.unsettled:
                    continue
                scale = float(np.ptp(reading.values[reading.used])) or 1.0
                own = _of_run(base, record.place, scale if what == "offset" else scale / duration)
                least, most = record.limits(what, output)
                if math.isfinite(most) and base not in free.observation:
                    # A slope and what is slow in the strip cancel each other to any size; a zero follows its misfit.
                    middle, half = 0.5 * (least + most), 0.5 * (most - least)
                    own = replace(own, scale=half, lower=least, upper=most).within(middle, half)
                found.append(own)
    return found


def unknowns_of(
    free: FreeParameters,
    parameters: Mapping[str, Parameter],
    records: Sequence[PreparedRun],
    *,
    states: Mapping[int, int] | None = None,
    delays: Mapping[int, EdgeDelay] | None = None,
) -> tuple[Unknown, ...]:
    """Every unknown, in a fixed order.

    Parameters
    ----------
    free : FreeParameters
    parameters : mapping of name to Parameter
    records : sequence of PreparedRun
    states : mapping of place to int
        Number of unknown starting amplitudes of the runs that do not start from rest.
    delays : mapping of place to EdgeDelay
        What is known beforehand of the edges of foreign records.
    """
    found = [actuator_unknown(parameters[name], None) for name in free.shared]
    rates = [record.run.rate for record in records if {"force", "displacement"} & set(record.readings)]
    if rates:
        # A zero far beyond the Nyquist rate cannot be seen: without a bound it runs away.
        found = [replace(u, upper=min(u.upper, _FAR * math.pi * max(rates))) if u.base == ZERO else u for u in found]
    for name in free.per_run:
        found += [actuator_unknown(parameters[name], record.place) for record in records]
    for name in free.per_mounting:
        for mounting, places in places_of_mountings((record.place, record.run) for record in records).items():
            shared = actuator_unknown(parameters[name], None)
            found.append(replace(shared, name=f"{name}{ending_of(mounting)}", places=places))
    found = with_known(found, free.priors)
    if free.together:
        tied = {u.name: u for u in known_together([u for u in found if u.name in free.together], free.together)}
        found = [tied.get(u.name, u) for u in found]
    for number, unknown in enumerate(found):
        # No larger than one of a strip where a search would have it of any size.
        largest = largest_proportional(unknown.base)
        if unknown.prior is None and largest is not None and math.isfinite(largest):
            found[number] = unknown.within(0.0, largest)
    found += _of_delays(records, delays or at_their_rows(records))
    found += _of_states(free, records)
    found += _of_sensors(free, records)
    for place, count in (states or {}).items():
        found += amplitudes(place, count)
    return tuple(found)


def amplitudes(place: int, count: int) -> list[Unknown]:
    """The unknowns of the state in which a run begins."""
    return [_of_run(f"{_START}{number}", place, 1.0, nuisance=True) for number in range(count)]
