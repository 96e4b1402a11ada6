"""A slow pole beside its zero is no certainty about the fast ones."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.procedure import SEED, VirtualStrip
from ipmclab import Run, identify, load_actuator
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.search.doublet import COUPLING, _loosened, _may_be_off, has_doublet, without_doublet
from ipmclab.identification.search.solve import Solution

FRIEND = load_actuator("friend-2")
STEPS = {
    10: (
        0.025142,
        0.0047969,
        0.0050388,
        0.00024767,
        0.02097,
        1.3664,
        43.029,
        0.2051,
        0.12286,
        23.882,
        0.48448,
        1.414e9,
    ),
    17: (
        0.025049,
        0.0050148,
        0.0049611,
        0.00024381,
        0.021173,
        1.3552,
        43.194,
        0.0908,
        0.1242,
        23.792,
        0.48575,
        1.506e9,
    ),
}
"""What the first five steps of a procedure found, in two trials of ``benchmarks.procedure``."""

HELD = (
    *(f"geometry.{key}" for key in ("free_length", "clamped_length", "width", "thickness", "sensing_length")),
    *("circuit.sheet_resistance", "circuit.dc_resistivity"),
    *(f"circuit.branches.{i}.{what}" for i in (0, 1) for what in ("resistivity", "permittivity")),
    "beam.modulus",
)


@pytest.fixture(scope="module")
def pressed() -> dict[int, list[Run]]:
    """The force of those trials."""
    strip = VirtualStrip(FRIEND)
    generator = np.random.default_rng([SEED, 1])
    found = {}
    for trial in range(max(STEPS) + 1):
        procedure = strip.procedure(generator)
        if trial in STEPS:
            found[trial] = [run for _, run in procedure.coupling]
    return found


@pytest.mark.parametrize("trial", STEPS)
def test_fast_poles_are_not_known_where_a_doublet_stands_for_one(pressed: dict[int, list[Run]], trial: int) -> None:
    """Noise, and a circuit held 2 % off, look like a slow part of 2 %: P_1d is 15.9 there, and not 2.8 to 5 %."""
    strip = FRIEND.replace(**dict(zip(HELD, STEPS[trial], strict=True)))
    fit = identify(strip, pressed[trial], free=COUPLING)
    assert has_doublet(fit.actuator.parameter_values)
    assert not any(parameter.determined for parameter in fit.parameters.values())
    low, high = fit.parameters["coupling.p1"].interval
    assert low < FRIEND["coupling.p1"] < high


def test_a_zero_counts_beside_either_pole_and_never_beside_complex_ones() -> None:
    def near(zero: float, poles: tuple[complex, complex]) -> bool:
        p1, p2 = (poles[0] + poles[1]).real, (poles[0] * poles[1]).real
        return has_doublet({"coupling.zero": zero, "coupling.p1": p1, "coupling.p2": p2})

    assert near(0.19, (3.0, 0.2))
    assert near(3.2, (3.0, 0.2))
    assert not near(0.15, (3.0, 0.2))
    assert not near(1.0, (1.0 + 0.5j, 1.0 - 0.5j))


@pytest.mark.parametrize("correlation", [0.0, -0.99])
def test_a_circuit_that_an_earlier_fit_found_is_off_together(correlation: float) -> None:
    """Least squares with the errors of what is held among the noise, whose covariance is then that of both."""
    names = ["circuit.sheet_resistance", "circuit.branches.0.resistivity"]
    deviations = np.array([0.02, 0.5]) * [FRIEND[name] for name in names]
    together = np.outer(deviations, deviations) * [[1.0, correlation], [correlation, 1.0]]
    earlier = {
        "covariance": {"names": names, "rows": together.tolist()},
        "values": {name: FRIEND[name] for name in names},
    }
    stating = dict(zip(names, deviations.tolist(), strict=True))
    strip = replace(FRIEND, standard_uncertainties=stating, fit_table=earlier)
    generator = np.random.default_rng(SEED)
    jacobian, residual = generator.standard_normal((40, 3)), generator.standard_normal(40)
    moved, variance = generator.standard_normal((40, 2)) / deviations, 0.3
    here = SimpleNamespace(jacobian=jacobian, residual=residual, cost=float(residual @ residual))
    problem: Any = SimpleNamespace(fixed_jacobian=lambda *_: moved)
    solution: Any = SimpleNamespace(theta=None, evaluation=here)
    off = _may_be_off(strip, {name: FRIEND[name] for name in names})
    found = _loosened(problem, solution, names, off, variance)
    root = np.linalg.cholesky(np.eye(40) + moved @ together @ moved.T / variance)
    columns, right = np.linalg.solve(root, jacobian), np.linalg.solve(root, residual)
    left = right - columns @ np.linalg.lstsq(columns, right, rcond=None)[0]
    assert found == pytest.approx(float(left @ left), rel=1e-6)


class WithStarts:
    """A coupling seen beside some starting states, whose entries are known to a hundredth; its circuit is held."""

    records = (SimpleNamespace(place=0),)

    def __init__(self, zero: float, starts: int) -> None:
        names = (*COUPLING, *(f"observation.initial_state.{number}[0]" for number in range(starts)))
        self.unknowns = tuple(SimpleNamespace(name=name, base=name) for name in names)
        self.base = {"circuit.dc_resistivity": FRIEND["circuit.dc_resistivity"]}
        self.found = {"coupling.zero": zero, "coupling.p1": 2.9, "coupling.p2": 0.28}
        rows = np.vstack([100.0 * np.eye(len(names), 40), np.full(40, 1.0)])
        self.solution = Solution(np.zeros(len(names)), Evaluation(rows), True, "", 1)

    def values(self, theta: np.ndarray, place: int) -> dict[str, float]:
        assert (len(theta), place) == (len(self.unknowns), 0)
        return self.found

    def fixed_jacobian(self, theta: np.ndarray, names: Any) -> np.ndarray:
        assert len(theta) == len(self.unknowns)
        return np.zeros((40, len(names)))


def test_minima_with_other_numbers_of_starting_states_are_compared() -> None:
    """How many states the readings tell apart hangs on where a search begins: an index out of bounds ended a fit."""
    beside_a_doublet: Any = WithStarts(zero=0.1, starts=2)
    without: Any = WithStarts(zero=1.0, starts=5)
    found = without_doublet((beside_a_doublet, beside_a_doublet.solution), (without, without.solution), FRIEND)
    assert found is not None
    assert found.entries.keys() == {unknown.name for unknown in without.unknowns}
