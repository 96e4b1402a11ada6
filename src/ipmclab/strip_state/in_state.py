"""The parameters of a strip in the state of one run: aged by what it had been through, then moved by its laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.model import Actuator
from ipmclab.model.declared import declaration_of
from ipmclab.model.environment import WaterState
from ipmclab.model.environment import in_state as moved_by_laws
from ipmclab.model.environment.age import Age, grown
from ipmclab.model.environment.laws import is_of_environment
from ipmclab.run import FloatArray
from ipmclab.strip_state.run_state import RunState


@dataclass(frozen=True, eq=False)
class InState:
    """The parameters in one state, and their derivatives.

    Parameters
    ----------
    values : dict of name to float [SI]
        Every parameter; those of the laws stand as they were given.
    names : tuple of str
        Those that move with anything that was asked for: the columns of the derivatives.
    by : float array, shape (n_asked, n_names) [SI]
        By each parameter of the reference state that was asked for.
    by_water : float array, shape (n_names,) [SI]
        By the water content.
    by_rate : mapping of name to float array, shape (n_names,) [SI]
        By each rate at which a parameter ages, by its name.
    """

    values: dict[str, float]
    names: tuple[str, ...]
    by: FloatArray
    by_water: FloatArray
    by_rate: Mapping[str, FloatArray]


def in_state(
    reference: Mapping[str, float],
    state: RunState,
    names: Sequence[str],
    *,
    water: float | None = None,
    rates: Mapping[str, float] | None = None,
) -> InState:
    """The parameters of a strip in the state of a run, with derivatives.

    Parameters
    ----------
    reference : mapping of name to float [SI]
        Every parameter, as it is in the reference state of the laws and before the strip aged.
    state : RunState
    names : sequence of str
        Parameters by which derivatives are asked for.
    water : float, optional
        The water content, where it is another one than that of the state.
    rates : mapping of name to float, optional
        How fast parameters age.
    """
    factors = grown(rates or {}, state.doses)
    aged = {name: value * factors.get(name, 1.0) for name, value in reference.items()}
    doses = {name: state.doses[Age.of(name).scale] for name in rates or ()}
    content = state.water_content if water is None else water
    # An actuator without laws is the same in any state.
    moved = moved_by_laws(aged, WaterState(content or 1.0, state.temperature or 0.0))
    place = {name: number for number, name in enumerate(moved.parameters)}
    columns = [place[name] for name in names]
    by = moved.jacobian[:, columns].T * np.array([factors.get(name, 1.0) for name in names])[:, None]
    by_rate = {
        name: moved.jacobian[:, place[Age.of(name).parameter]] * (aged[Age.of(name).parameter] * dose)
        for name, dose in doses.items()
    }
    by_water = moved.by_state[:, 0]
    values, inside = _within(moved.values)
    by, by_water = by * inside, by_water * inside
    by_rate = {name: column * inside for name, column in by_rate.items()}
    moves = np.flatnonzero(np.any([by_water, *by, *by_rate.values()], axis=0))
    return InState(
        values={**aged, **values},
        names=tuple(moved.names[row] for row in moves),
        by=np.ascontiguousarray(by[:, moves]),
        by_water=by_water[moves],
        by_rate={name: column[moves] for name, column in by_rate.items()},
    )


def strip_in_state(actuator: Actuator, state: RunState, rates: Mapping[str, float]) -> Actuator:
    """A strip in a state, without laws.

    Parameters
    ----------
    actuator : Actuator
        As it is in the reference state.
    state : RunState
    rates : mapping of name to float
        How fast parameters age.
    """
    found = in_state(actuator.parameter_values, state, (), water=state.found, rates=rates)
    stages = {name: value for name, value in found.values.items() if not is_of_environment(name)}
    return Actuator(actuator.name, stages, sample=actuator.sample)


def _within(values: Mapping[str, float]) -> tuple[dict[str, float], npt.NDArray[np.bool_]]:
    """Values that strips can have, and which did already: a search goes where a law leads out of them."""
    found, inside = {}, []
    for name, value in values.items():
        declared = declaration_of(name)
        bounded = value if declared is None else min(max(value, declared.lower), declared.upper)
        found[name] = bounded
        inside.append(bounded == value)
    return found, np.array(inside)
