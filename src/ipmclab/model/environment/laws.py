"""Laws: how parameters follow water content and temperature, each as a ratio to a declared state of reference.

Exponents and energies are parameters of the actuator like all others: ``environment.coupling_gain.exponent``.
What a law does not name does not happen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from ipmclab.model.environment.conditions import ABSOLUTE
from ipmclab.model.environment.hydration import PERCOLATION, REFERENCE_CONTENT, REFERENCE_TEMPERATURE, SITES
from ipmclab.model.environment.sorption import GAS, WATER, activity
from ipmclab.model.parameters import Declaration
from ipmclab.model.stages.kind import StageKind, is_there, number_of
from ipmclab.units import ACTIVATION_ENERGY, NUMBER, PER_KELVIN

PREFIX: Final = "environment."


class Place(NamedTuple):
    """The state in which parameters are asked for, and that of reference; arrays where several are asked for at once.

    ``content`` and ``reference`` are water contents, ``inverse`` is 1/T - 1/T_0 [1/K], ``warmer`` T - T_0 [K].
    """

    values: Mapping[str, Any]
    content: Any
    reference: Any
    inverse: Any
    warmer: Any

    @classmethod
    def of(cls, values: Mapping[str, Any], content: Any, temperature: Any) -> Place:
        """A state of some water content and temperature [degC]."""
        kelvin, origin = temperature + ABSOLUTE, values[REFERENCE_TEMPERATURE] + ABSOLUTE
        return cls(values, content, values[REFERENCE_CONTENT], 1.0 / kelvin - 1.0 / origin, kelvin - origin)

    def power(self, exponent: Any) -> Any:
        """(lambda/lambda_0)^exponent."""
        return (self.content / self.reference) ** exponent

    def conduction(self, exponent: Any) -> Any:
        """[(lambda - lambda_p)/(lambda_0 - lambda_p)]^exponent: what a membrane conducts above its percolation."""
        least = self.values[PERCOLATION]
        return ((self.content - least) / (self.reference - least)) ** exponent

    def activated(self, energy: Any) -> Any:
        """exp(-E/R (1/T - 1/T_0)): what grows with the temperature."""
        return np.exp(-energy / GAS * self.inverse)


Factors = dict[str, Any]
"""What parameters are multiplied by, by their names."""


@dataclass(frozen=True)
class Law:
    """One law.

    Parameters
    ----------
    kind : StageKind
    declarations : function of the number of branches to tuple of Declaration
    factors : function of a Place and the number of branches to dict of name to number
        What the law multiplies.
    """

    kind: StageKind
    declarations: Callable[[int], tuple[Declaration, ...]]
    factors: Callable[[Place, int], Factors]


def _kind(name: str, outputs: tuple[str, ...], **more: Any) -> StageKind:
    return StageKind(
        f"{PREFIX}{name}",
        f"{PREFIX}{name}.",
        group="environment",
        outputs=outputs,
        electrical="current" in outputs,
        to_determine="record in environments that differ more",
        **more,
    )


_ALL: Final = ("current", "displacement", "force")
_MOTION: Final = ("displacement", "force")


def _exponent(law: str, symbol: str, **more: Any) -> Declaration:
    return Declaration(f"{PREFIX}{law}.exponent", NUMBER, symbol, -50.0, 50.0, "linear", **more)


def _energy(law: str, symbol: str, **more: Any) -> Declaration:
    name = f"{PREFIX}{law}.energy"
    return Declaration(name, ACTIVATION_ENERGY, symbol, -500e3, 500e3, "linear", scale=1e4, **more)


def _branches(branches: int) -> tuple[Declaration, ...]:
    found = []
    for place in range(branches):
        law, first = f"branches.{place}", place == 0
        exponent = _exponent(law, f"n_{place + 1}", default=0.0, typical=1.0, likely=(0.7, 1.5) if first else None)
        # Springer: 10.5 kJ/mol of the H+ form; Li+ and Na+ have more.
        likely = (9e3, 20e3) if first else None
        found += [exponent, _energy(law, f"E_{place + 1}", default=0.0, typical=10.5e3, likely=likely)]
    return tuple(found)


def _branch_factors(place: Place, branches: int) -> Factors:
    found = {}
    for i in range(branches):
        exponent, energy = (place.values[f"{PREFIX}branches.{i}.{name}"] for name in ("exponent", "energy"))
        found[f"circuit.branches.{i}.resistivity"] = 1.0 / (place.conduction(exponent) * place.activated(energy))
    return found


def _dc_factors(place: Place, _branches: int) -> Factors:
    exponent, energy = (place.values[f"{PREFIX}dc_resistivity.{name}"] for name in ("exponent", "energy"))
    return {"circuit.dc_resistivity": 1.0 / (place.conduction(exponent) * place.activated(energy))}


def _permittivity_factors(place: Place, branches: int) -> Factors:
    factor = place.power(place.values[f"{PREFIX}permittivity.exponent"])
    return {f"circuit.branches.{i}.permittivity": factor for i in range(branches)}


def _sheet_factors(place: Place, _branches: int) -> Factors:
    name = f"{PREFIX}sheet_resistance."
    warmer = 1.0 + place.values[f"{name}temperature_coefficient"] * place.warmer
    return {"circuit.sheet_resistance": warmer * place.power(place.values[f"{name}exponent"])}


def _gain_factors(place: Place, _branches: int) -> Factors:
    exponent, energy = (place.values[f"{PREFIX}coupling_gain.{name}"] for name in ("exponent", "energy"))
    return {"coupling.gain": place.power(exponent) * place.activated(energy)}


def _rate_factors(place: Place, _branches: int) -> Factors:
    exponent, energy = (place.values[f"{PREFIX}coupling_rate.{name}"] for name in ("exponent", "energy"))
    rate = place.power(exponent) * place.activated(energy)
    return {"coupling.p1": rate, "coupling.p2": rate**2, "coupling.zero": rate}


def _modulus_factors(place: Place, _branches: int) -> Factors:
    values, name = place.values, f"{PREFIX}modulus."
    wetter = activity(values, place.content) - activity(values, place.reference)
    softer = (
        values[f"{name}humidity"] * wetter
        + values[f"{name}temperature"] * place.warmer
        + values[f"{name}humidity_temperature"] * wetter * place.warmer
    )
    return {"beam.modulus": np.exp(-softer)}


def _thickness_factors(place: Place, _branches: int) -> Factors:
    values, swelling = place.values, place.values[f"{PREFIX}thickness.swelling"]
    dry, there = 1.0 + swelling * place.reference, 1.0 + swelling * place.content
    # Mass of a face: what it was, and the water that has come since, over the thickness that it has now.
    water = values[SITES] * WATER * (place.content - place.reference) / values["beam.density"]
    return {"geometry.thickness": there / dry, "beam.density": (dry + water) / there}


LAWS: Final = (
    Law(
        # Ordered as the branches that they belong to.
        _kind(
            *("branches", _ALL),
            counted=True,
            speed=lambda values, name: _speed(values, name.removeprefix(f"{PREFIX}branches.")),
        ),
        _branches,
        _branch_factors,
    ),
    Law(
        _kind("dc_resistivity", _ALL),
        lambda _: (
            _energy("dc_resistivity", "E_dc", typical=10.5e3),
            _exponent("dc_resistivity", "n_dc", default=0.0),
        ),
        _dc_factors,
    ),
    Law(
        _kind("permittivity", _ALL),
        # A double layer's capacitance grows as sqrt(permittivity x concentration).
        lambda _: (_exponent("permittivity", "n_C", typical=0.5, likely=(0.0, 1.5)),),
        _permittivity_factors,
    ),
    Law(
        _kind("sheet_resistance", _ALL),
        lambda _: (
            # Bulk platinum; porous films have less.
            Declaration(
                *(f"{PREFIX}sheet_resistance.temperature_coefficient", PER_KELVIN, "α_R", -0.1, 0.1, "linear"),
                typical=3.9e-3,
                likely=(1e-3, 3.9e-3),
                scale=1e-3,
            ),
            _exponent("sheet_resistance", "n_s", default=0.0),
        ),
        _sheet_factors,
    ),
    Law(
        _kind("coupling_gain", _MOTION),
        lambda _: (
            # From Friend's displacements: 3.6 between 70 and 80 %RH, 1.0 between 60 and 70 %RH.
            _exponent("coupling_gain", "n_d", typical=1.0, likely=(0.0, 5.0)),
            _energy("coupling_gain", "E_d", default=0.0),
        ),
        _gain_factors,
    ),
    Law(
        _kind("coupling_rate", _MOTION),
        lambda _: (_exponent("coupling_rate", "n_r", typical=1.0), _energy("coupling_rate", "E_r", default=0.0)),
        _rate_factors,
    ),
    Law(
        _kind("modulus", _MOTION),
        # Fit to the table of Tang (2006) of bare Nafion.
        lambda _: (
            Declaration(
                *(f"{PREFIX}modulus.humidity", NUMBER, "b_h", -50.0, 50.0, "linear"),
                typical=1.013,
                likely=(0.0, 2.0),
            ),
            Declaration(
                *(f"{PREFIX}modulus.temperature", PER_KELVIN, "b_T", -1.0, 1.0, "linear"),
                default=0.0,
                typical=0.01103,
                likely=(0.0, 0.022),
                scale=0.01,
            ),
            Declaration(
                *(f"{PREFIX}modulus.humidity_temperature", PER_KELVIN, "b_hT", -1.0, 1.0, "linear"),
                default=0.0,
                typical=0.01077,
                likely=(0.0, 0.022),
                scale=0.01,
            ),
        ),
        _modulus_factors,
    ),
    Law(
        _kind("thickness", _ALL),
        # Springer's fit of bare Nafion; a plated strip swells less.
        lambda _: (
            Declaration(
                *(f"{PREFIX}thickness.swelling", NUMBER, "s_h", 0.0, 1.0, "linear"),
                typical=0.0126,
                likely=(0.003, 0.0126),
                scale=0.01,
            ),
        ),
        _thickness_factors,
    ),
)

KINDS: Final = tuple(law.kind for law in LAWS)

_BRANCHES: Final = LAWS[0].kind.prefix
_BY_PREFIX: Final = {law.kind.prefix: law for law in LAWS}


def laws_in(names: Iterable[str]) -> tuple[str, ...]:
    """The prefixes of the laws that these parameter names speak of.

    Examples
    --------
    >>> laws_in(["environment.coupling_gain.exponent", "coupling.gain"])
    ('environment.coupling_gain.',)
    """
    given = [name for name in names if name.startswith(PREFIX)]
    return tuple(prefix for prefix in _BY_PREFIX if is_there(given, prefix))


def law_declarations(prefixes: Iterable[str], branches: int) -> tuple[Declaration, ...]:
    """The parameters of some laws, for an actuator with so many branches."""
    return tuple(one for prefix in prefixes for one in _BY_PREFIX[prefix].declarations(branches))


def branches_with_law(names: Iterable[str]) -> int:
    """Of how many branches these names give the law."""
    return number_of(names, _BRANCHES)


def is_of_environment(name: str) -> bool:
    """Whether a parameter belongs to the laws or to the water, so that an actuator in one state lacks it.

    Examples
    --------
    >>> is_of_environment("hydration.film"), is_of_environment("beam.modulus")
    (True, False)
    """
    return name.startswith((PREFIX, "hydration."))


def law_factors(values: Mapping[str, Any], content: Any, temperature: Any) -> Iterator[tuple[str, Any]]:
    """Which parameters of an actuator its laws multiply by what, one law after the other, in a state of its water.

    Parameters
    ----------
    values : mapping of dotted name to number [SI]
        Every parameter, those of the laws too; arrays or complex numbers where a derivative is taken.
    content : number or array
        Water content.
    temperature : number or array [degC]
    """
    prefixes = laws_in(values)
    if prefixes:
        place, branches = Place.of(values, content, temperature), number_of(values, "circuit.branches.")
        for prefix in prefixes:
            yield from _BY_PREFIX[prefix].factors(place, branches).items()


def conducts_above(values: Mapping[str, float]) -> bool:
    """Whether a law needs the conductivity of the membrane, which has one above its percolation only."""
    return is_there(values, _BRANCHES) or is_there(values, f"{PREFIX}dc_resistivity.")


def _speed(values: Mapping[str, float], number: str) -> float:
    name = f"circuit.branches.{number}"
    return values[f"{name}.resistivity"] * values[f"{name}.permittivity"]
