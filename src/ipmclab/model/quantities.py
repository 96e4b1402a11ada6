"""What readings determine of a strip whatever its parameters are called: resistances, time constants, static gains.

Parameters may trade against each other; what follows from all of them together is then known all the same.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import System
from ipmclab.model.blocks import Block
from ipmclab.model.ports import OUTPUTS
from ipmclab.model.stages.beam import resonance, tip_stiffness
from ipmclab.units import (
    CAPACITANCE,
    DISPLACEMENT_PER_VOLT,
    FORCE_PER_VOLT,
    FREQUENCY,
    RESISTANCE,
    STIFFNESS,
    STRAIN_COEFFICIENT,
    TIME,
    Quantity,
)

if TYPE_CHECKING:
    from ipmclab.model.actuator import Actuator

FloatArray = npt.NDArray[np.float64]

_HALF_POWER: Final = math.sqrt(0.5)
_ROUNDING: Final = 1e-14
_GRID: Final = 120  # frequencies among which the first crossing is sought


@dataclass(frozen=True)
class Derived:
    """A quantity that follows from the parameters of a strip.

    Parameters
    ----------
    words : str
        What it is called in tables.
    quantity : Quantity
        Gives the units.
    positive : bool
        Whether it cannot be negative: its errors are then those of its logarithm.
    """

    words: str
    quantity: Quantity
    positive: bool = True


AT_ONCE: Final = "circuit.high_frequency_resistance"
"""What the current shows in the moment of an edge."""

AT_REST: Final = "coupling.static"
"""d(0): how far a constant voltage bends."""

DERIVED: Final[Mapping[str, Derived]] = {
    AT_ONCE: Derived("high-frequency resistance", RESISTANCE),
    "circuit.dc_resistance": Derived("dc resistance", RESISTANCE),
    "circuit.capacitance": Derived("charge stored per volt", CAPACITANCE),
    "circuit.time_constants": Derived("time constant of the current", TIME),
    AT_REST: Derived("d(0)", STRAIN_COEFFICIENT),
    "displacement.static_gain": Derived("static gain, displacement", DISPLACEMENT_PER_VOLT, positive=False),
    "displacement.bandwidth": Derived("bandwidth, displacement", FREQUENCY),
    "force.static_gain": Derived("static gain, force", FORCE_PER_VOLT, positive=False),
    "force.bandwidth": Derived("bandwidth, force", FREQUENCY),
    "beam.stiffness": Derived("stiffness at the sensing point", STIFFNESS),
    "beam.resonance": Derived("resonance", FREQUENCY),
}
"""By name; of the time constants each has its number behind the name, the fastest 0."""


@lru_cache(maxsize=64)
def derived(name: str) -> Derived:
    """What a quantity is, of the time constants each.

    Examples
    --------
    >>> derived("circuit.time_constants.1").words
    'time constant 2 of the current'
    """
    base, _, number = name.rpartition(".")
    if not number.isdigit():
        return DERIVED[name]
    whole = DERIVED[base]
    return Derived(whole.words.replace("constant", f"constant {int(number) + 1}"), whole.quantity, whole.positive)


def quantities_of(
    actuator: Actuator, outputs: Collection[str], highest: float, longest: float = math.inf
) -> dict[str, float]:
    """What follows from the parameters of a strip [SI].

    The electrical ones are those of the joined circuit as its clamp shows them: current over voltage is
    Y(s) = I/V, the high-frequency resistance is 1/Y(∞), the dc resistance 1/Y(0), the charge stored per volt Y'(0) (the
    area under the current after a step of 1 V, what flows for ever taken off), the time constants are one over its
    poles. They are given of a lumped circuit without a leak: there they are the same at every voltage. The bandwidth is
    the lowest frequency at which the answer to the voltage has fallen to 0.71 of that to a constant one.

    Parameters
    ----------
    actuator : Actuator
    outputs : collection of str
        What was read: of nothing else static gain and bandwidth are given.
    highest : float [Hz]
        Up to which a bandwidth is sought.
    longest : float [s]
        How long readings last from the first edge on. A longer time constant is not given; where there is one, neither
        are the dc resistance and the charge, which show when all of them have passed.

    Returns
    -------
    quantities : dict of name to float [SI]

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> strip = load_actuator("friend-2")
    >>> found = quantities_of(strip, ["current", "displacement"], highest=100.0)
    >>> {name: float(f"{value:.4g}") for name, value in found.items() if name.startswith("circuit")}
    {'circuit.high_frequency_resistance': 16.57, 'circuit.dc_resistance': 86.92, 'circuit.capacitance': 0.245,
     'circuit.time_constants.0': 0.7519, 'circuit.time_constants.1': 15.76}
    """
    values = actuator.parameter_values
    found: dict[str, float] = {}
    if "current" in outputs and actuator.structure.is_lumped:
        found |= _of_circuits(actuator.structure.electrical.block(values), 1, longest)[0]
    if {"displacement", "force"} & set(outputs):
        found[AT_REST] = values["coupling.gain"] * values["coupling.zero"] / values["coupling.p2"]
        found["beam.stiffness"] = float(abs(tip_stiffness(values)))
        found["beam.resonance"] = resonance(values).frequency
    for output in ("displacement", "force"):
        if output in outputs and not actuator.structure.leak:
            found |= _of_motion(actuator.system, output, highest)
    return found


def quantities_of_each(
    actuator: Actuator,
    points: Sequence[Mapping[str, float]],
    outputs: Collection[str],
    highest: float,
    longest: float = math.inf,
) -> list[dict[str, float]]:
    """What follows from each of several sets of the parameters of one strip; the rest as ``quantities_of``.

    Parameters
    ----------
    actuator : Actuator
    points : sequence of mapping of dotted name to float [SI]
        Every parameter of the actuator.
    outputs : collection of str
    highest : float [Hz]
    longest : float [s]
    """
    own, structure = actuator.parameter_values, actuator.structure
    if set(outputs) == {"current"} and structure.is_lumped and structure.takes_arrays:
        columns = {name: [point[name] for point in points] for name in own}
        together: Any = {name: np.array(one) if len({*one}) > 1 else one[0] for name, one in columns.items()}
        return _of_circuits(structure.electrical.block(together), len(points), longest)
    moved = [{name: point[name] for name in own if point[name] != own[name]} for point in points]
    return [quantities_of(actuator.replace(**changes), outputs, highest, longest) for changes in moved]


def _of_circuits(circuit: Block, count: int, longest: float) -> list[dict[str, float]]:
    """The electrical quantities of the circuits whose matrices stand in a block, that axis first."""
    row, column = circuit.outputs.index("current"), circuit.inputs.index("voltage")
    a, b, c, d = (
        np.broadcast_to(one, (count, *one.shape[-2:])) for one in (circuit.a, circuit.b, circuit.c, circuit.d)
    )
    b, c, d = b[:, :, column, None], c[:, row, None], d[:, row, column]
    poles = np.linalg.eigvals(a)
    hidden = [_hides_a_pole(own) for own in poles]
    fine = np.flatnonzero(np.logical_not(hidden))
    charged, again = np.zeros_like(b), np.zeros_like(b)
    charged[fine] = np.linalg.solve(a[fine], b[fine])
    again[fine] = np.linalg.solve(a[fine], charged[fine])
    conductance = d - (c @ charged)[:, 0, 0]
    capacitance = -(c @ again)[:, 0, 0]
    found: list[dict[str, float]] = []
    for k in range(count):
        own = {AT_ONCE: float(1.0 / d[k])}
        if not hidden[k]:
            lags = np.sort(-1.0 / poles[k].real).tolist()
            if not lags or lags[-1] <= longest:
                if conductance[k] > _ROUNDING * d[k]:
                    own["circuit.dc_resistance"] = float(1.0 / conductance[k])
                own["circuit.capacitance"] = float(capacitance[k])
            own |= {f"circuit.time_constants.{number}": lag for number, lag in enumerate(lags) if lag <= longest}
        found.append(own)
    return found


def _of_motion(system: System, output: str, highest: float) -> dict[str, float]:
    row = OUTPUTS.index(output)
    b, c, d = system.b[:, 0], system.c[row], system.d[row, 0]

    def answer(frequency: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        turned = 2j * math.pi * np.asarray(frequency)[..., None, None] * np.eye(len(b)) - system.a
        return np.asarray(np.linalg.solve(turned, b[:, None])[..., 0] @ c + d)

    poles = np.linalg.eigvals(system.a)
    if _hides_a_pole(poles):
        return {}
    static = float(answer(0.0).real)
    found = {f"{output}.static_gain": static}
    slowest = float(np.min(np.abs(poles))) / (2.0 * math.pi)
    if slowest >= highest:
        return found

    def above(logarithm: npt.ArrayLike) -> FloatArray:
        return np.abs(answer(np.exp(logarithm))) - _HALF_POWER * abs(static)

    grid = np.linspace(math.log(0.01 * slowest), math.log(highest), _GRID)
    # Where even the first has fallen, the answer to a constant voltage is rounding compared with that to a slow one.
    fallen = int(np.argmax(above(grid) < 0.0))
    if fallen:
        from scipy.optimize import brentq

        found[f"{output}.bandwidth"] = math.exp(brentq(above, grid[fallen - 1], grid[fallen], xtol=1e-12))
    return found


def _hides_a_pole(poles: npt.NDArray[np.float64] | npt.NDArray[np.complex128]) -> bool:
    """Whether the slowest pole is rounding compared with the fastest: what the strip does in the end is then not
    known."""
    sizes = np.abs(poles)
    return bool(sizes.min(initial=np.inf) <= _ROUNDING * sizes.max(initial=0.0))
