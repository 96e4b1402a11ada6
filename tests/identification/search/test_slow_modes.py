"""Slow modes as poles and residues, and as the parameters of modes and of pairs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ipmclab.identification.search.starts.slow_modes import slow_modes, slow_poles, slow_values
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
