"""Laws: how parameters follow water content and temperature, each as a ratio to a declared state of reference.

Exponents and energies are parameters of the actuator like all others: ``environment.coupling_gain.exponent``.
What a law does not name does not happen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.environment.conditions import ABSOLUTE, WaterState
from ipmclab.model.environment.hydration import PERCOLATION, REFERENCE_CONTENT, REFERENCE_TEMPERATURE, SITES
from ipmclab.model.environment.sorption import GAS, WATER, activity
from ipmclab.model.parameters import Declaration
from ipmclab.model.stages.kind import StageKind, is_there, number_of
from ipmclab.units import ACTIVATION_ENERGY, NUMBER, PER_KELVIN

FloatArray = npt.NDArray[np.float64]

PREFIX: Final = "environment."

_STEP: Final = 1e-100
"""Of a complex step: so small that its square vanishes compared with any number here."""


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


@dataclass(frozen=True, eq=False)
class Moved:
    """The parameters of an actuator in one state of its water, and how they depend on those that it states.

    Parameters
    ----------
    values : dict of dotted name to float [SI]
        Every parameter of the stages, none of the laws.
    names : tuple of str
        Those of ``values``, the rows of the matrices.
    parameters : tuple of str
        Every parameter of the actuator, those of its laws too: the columns of ``jacobian``.
    jacobian : float array, shape (n_names, n_parameters) [SI]
        Derivative of each value by each parameter.
    by_state : float array, shape (n_names, 2) [SI]
        Derivative of each value by the water content and by the temperature [1/K].
    """

    values: dict[str, float]
    names: tuple[str, ...]
    parameters: tuple[str, ...]
    jacobian: FloatArray
    by_state: FloatArray


def moved_values(values: Mapping[str, Any], content: Any, temperature: Any) -> dict[str, Any]:
    """Values of the parameters in a state of the water: those of the stages alone.

    Parameters
    ----------
    values : mapping of dotted name to number [SI]
        Every parameter, those of the laws too; arrays or complex numbers where a derivative is taken.
    content : number or array
        Water content.
    temperature : number or array [degC]
    """
    found = {name: value for name, value in values.items() if not is_of_environment(name)}
    prefixes = laws_in(values)
    if prefixes:
        place, branches = Place.of(values, content, temperature), number_of(values, "circuit.branches.")
        for prefix in prefixes:
            for name, factor in _BY_PREFIX[prefix].factors(place, branches).items():
                found[name] = found[name] * factor
    return found


def values_in(values: Mapping[str, float], state: WaterState) -> dict[str, float]:
    """The values of an actuator's parameters in a state of its water, without derivatives.

    Raises
    ------
    InputError
        A water content at which the membrane does not conduct.

    Examples
    --------
    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> strip = {**STANDARD, "coupling.gain": 1e-8, "environment.coupling_gain.exponent": 2.0,
    ...          "environment.coupling_gain.energy": 0.0}
    >>> values_in(strip, WaterState(2.0 * 7.219, 20.0))
    {'coupling.gain': 4e-08}
    """
    check_conducts(values, state)
    moved = moved_values(values, state.water_content, state.temperature)
    return {name: float(value) for name, value in moved.items()}


def in_state(values: Mapping[str, float], state: WaterState) -> Moved:
    """The values of an actuator's parameters in a state of its water, with all derivatives.

    Parameters
    ----------
    values : mapping of dotted name to float [SI]
        Every parameter of the actuator, those of its laws too: ``actuator.parameter_values``.
    state : WaterState

    Returns
    -------
    moved : Moved

    Raises
    ------
    InputError
        A water content at which the membrane does not conduct.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> strip = load_actuator("friend-2+environment.permittivity")
    >>> wet = in_state(strip.parameter_values, WaterState(water_content=14.0, temperature=20.0))
    >>> row = wet.names.index("circuit.branches.0.permittivity")
    >>> round(wet.values["circuit.branches.0.permittivity"], 6)
    0.167084
    >>> round(float(wet.jacobian[row, wet.parameters.index("environment.permittivity.exponent")]), 6)
    0.110666
    """
    check_conducts(values, state)
    parameters = tuple(values)
    of_laws = [name for name in parameters if is_of_environment(name)]
    # One column for each parameter of the laws, for density (in its own law) and for the state; the last moves nothing.
    moving = [*of_laws, *(["beam.density"] if "beam.density" in values else [])]
    size = len(moving) + 3
    columns: dict[str, Any] = dict(values)
    for place, name in enumerate(moving):
        columns[name] = np.full(size, complex(values[name]))
        columns[name][place] += 1j * _STEP
    content, temperature = np.full(size, complex(state.water_content)), np.full(size, complex(state.temperature))
    content[-3] += 1j * _STEP
    temperature[-2] += 1j * _STEP
    found = {
        name: np.broadcast_to(np.asarray(value), size)
        for name, value in moved_values(columns, content, temperature).items()
    }
    names, place_of = tuple(found), {name: place for place, name in enumerate(parameters)}
    jacobian = np.zeros((len(names), len(parameters)))
    by_state = np.zeros((len(names), 2))
    for row, name in enumerate(names):
        slopes = found[name].imag / _STEP
        jacobian[row, [place_of[one] for one in moving]] = slopes[: len(moving)]
        if name not in moving:  # a factor times its own value
            own = values[name]
            jacobian[row, place_of[name]] = found[name][-1].real / own if own else 1.0
        by_state[row] = slopes[-3:-1]
    return Moved({name: float(found[name][-1].real) for name in names}, names, parameters, jacobian, by_state)


def conducts_above(values: Mapping[str, float]) -> bool:
    """Whether a law needs the conductivity of the membrane, which has one above its percolation only."""
    return is_there(values, _BRANCHES) or is_there(values, f"{PREFIX}dc_resistivity.")


def check_conducts(values: Mapping[str, float], state: WaterState) -> None:
    """Refuse a water content at which the membrane does not conduct, where a law needs its conductivity.

    Raises
    ------
    InputError
    """
    if not conducts_above(values):
        return
    least = values[PERCOLATION]
    for content, what in ((state.water_content, "the water content"), (values[REFERENCE_CONTENT], REFERENCE_CONTENT)):
        if content <= least:
            raise InputError(
                f"{what} is {content:g}, and a membrane conducts above {least:g}",
                code="too-dry",
                where=PERCOLATION,
                repair="ask for a wetter state, or correct the percolation of the membrane",
            )


def _speed(values: Mapping[str, float], number: str) -> float:
    name = f"circuit.branches.{number}"
    return values[f"{name}.resistivity"] * values[f"{name}.permittivity"]
