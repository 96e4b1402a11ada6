"""An actuator in one state of its water: its laws applied, with all derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.environment.conditions import WaterState
from ipmclab.model.environment.hydration import PERCOLATION, REFERENCE_CONTENT
from ipmclab.model.environment.laws import conducts_above, is_of_environment, law_factors

FloatArray = npt.NDArray[np.float64]

_STEP: Final = 1e-100
"""Of a complex step: so small that its square vanishes compared with any number here."""


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
    for name, factor in law_factors(values, content, temperature):
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
