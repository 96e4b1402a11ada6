"""Slow modes as poles and residues, and as the parameters of modes and of pairs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ipmclab.model.slow_modes import fastest_to_coupling, slow_modes, slow_poles, slow_values
from ipmclab.model.stages.relaxation import mode_name, pair_name
from ipmclab.model.structure import Structure

MODES = ((0.2, 0.5), (-0.3, 7.0), (0.15, 9.0))
S = 2j * np.pi * np.geomspace(1e-3, 10.0, 40)


def test_poles_and_residues_are_modes_from_the_fastest_on() -> None:
    static = 2e-3
    poles = np.array([-1.0 / tau for _, tau in reversed(MODES)])
    residues = np.array([static * ratio / -tau for ratio, tau in reversed(MODES)])
    assert np.array(slow_modes(poles, residues, static)) == pytest.approx(np.array(MODES))


@pytest.mark.parametrize("output", ["force", "displacement"])
def test_a_pair_and_a_mode_answer_as_the_three_modes_do(output: str) -> None:
    counts = {f"{output}_modes": 1, f"{output}_pairs": 1}
    actuator = SimpleNamespace(structure=Structure(branches=1, **counts))
    assert slow_poles(actuator, output) == 3
    values = slow_values(actuator, output, MODES)
    pair, mode = pair_name(output, 0), mode_name(output, 0)
    tau, zeta = values[f"{pair}time_constant"], values[f"{pair}damping_ratio"]
    of_pair = (values[f"{pair}ratio"] + values[f"{pair}lead"] * S) / (1.0 + 2.0 * zeta * tau * S + (tau * S) ** 2)
    of_mode = values[f"{mode}ratio"] / (1.0 + values[f"{mode}time_constant"] * S)
    assert values[f"{mode}time_constant"] == 0.5  # the two that are nearest to each other are the pair
    np.testing.assert_allclose(of_pair + of_mode, sum(ratio / (1.0 + tau * S) for ratio, tau in MODES), rtol=1e-12)
    assert slow_poles(SimpleNamespace(structure=Structure(branches=1)), output) == 0


COUPLING = {"coupling.gain": 8.7e-9, "coupling.zero": 154.0, "coupling.p1": 16.3, "coupling.p2": 24.2}


def _answer(values: dict[str, float]) -> Any:
    gain, zero, p1, p2 = (values[name] for name in COUPLING)
    ratio, tau = values[f"{mode_name('force', 0)}ratio"], values[f"{mode_name('force', 0)}time_constant"]
    return gain * (S + zero) / (S**2 + p1 * S + p2) - ratio * gain * zero / p2 / (1.0 + tau * S)


@pytest.mark.parametrize("zero", [154.0, 3.0])
def test_the_same_answer_has_its_fastest_poles_in_the_coupling(zero: float) -> None:
    slow = 20.0
    fast = -float(np.roots([1.0, COUPLING["coupling.p1"], COUPLING["coupling.p2"]]).min())
    values = {**COUPLING, "coupling.zero": zero}
    values |= {f"{mode_name('force', 0)}ratio": 0.4, f"{mode_name('force', 0)}time_constant": slow}
    assert fastest_to_coupling(values, "force", 1e4) == {}
    # The slow pole and that of 1.65 1/s as d(s), the fast one as the slow mode.
    poles = np.array([-fast, 1.0, -1.0 / slow])
    poles[1] = -COUPLING["coupling.p2"] / fast
    gain, static = values["coupling.gain"], values["coupling.gain"] * zero / values["coupling.p2"]
    parts = gain * (zero + poles[:2]) / (poles[:2] - poles[1::-1])
    residues = np.array([*parts, -0.4 * static / slow])
    level, total = -float(residues[1:] @ poles[:0:-1]), float(np.sum(residues[1:]))
    product = float(poles[1] * poles[2])
    other = {
        "coupling.gain": total,
        "coupling.zero": level / total,
        "coupling.p1": -float(poles[1] + poles[2]),
        "coupling.p2": product,
        f"{mode_name('force', 0)}ratio": float(residues[0] / poles[0]) / (level / product),
        f"{mode_name('force', 0)}time_constant": 1.0 / fast,
    }
    np.testing.assert_allclose(_answer(other), _answer(values), rtol=1e-9)
    assert fastest_to_coupling(other, "force", 1e4) == pytest.approx(values, rel=1e-8)


def test_complex_poles_are_those_of_the_coupling() -> None:
    values = {**COUPLING, "coupling.p1": 1.0}
    values |= {f"{mode_name('force', 0)}ratio": 0.4, f"{mode_name('force', 0)}time_constant": 0.01}
    assert fastest_to_coupling(values, "force", 1e4) == {}
