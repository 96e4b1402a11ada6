"""The slow modes of a relaxation as poles, and as the parameters of an actuator."""

from __future__ import annotations

import numpy as np

from ipmclab.model import Actuator
from ipmclab.model.stages.relaxation import mode_name, pair_name
from ipmclab.run import FloatArray

Modes = tuple[tuple[float, float], ...]
"""Slow modes as (ratio, time constant [s]), fastest first."""


def slow_poles(actuator: Actuator, output: str) -> int:
    """How many slow poles an output has; a pair has two."""
    structure = actuator.structure
    if output == "force":
        return structure.force_modes + 2 * structure.force_pairs
    return structure.displacement_modes + 2 * structure.displacement_pairs


def slow_modes(poles: FloatArray, residues: FloatArray, static: float) -> Modes:
    """Ratio and time constant of each pole, for a d(s) of this value at s = 0 [m/V]."""
    found = [
        (float(residue / pole / static), float(-1.0 / pole)) for pole, residue in zip(poles, residues, strict=True)
    ]
    return tuple(sorted(found, key=lambda mode: mode[1]))


def slow_values(actuator: Actuator, output: str, modes: Modes) -> dict[str, float]:
    """Slow modes as parameters: the pairs take those that are nearest to each other.

    A pair (r + lead s)/(1 + 2 zeta tau s + tau^2 s^2) of modes r1, tau1 and r2, tau2 has r = r1 + r2,
    lead = r1 tau2 + r2 tau1, tau^2 = tau1 tau2 and 2 zeta tau = tau1 + tau2.
    """
    structure = actuator.structure
    pairs = structure.force_pairs if output == "force" else structure.displacement_pairs
    left, values = list(modes), {}
    for number in range(pairs):
        nearest = min(range(len(left) - 1), key=lambda k: left[k + 1][1] / left[k][1])
        (ratio_1, tau_1), (ratio_2, tau_2) = left.pop(nearest), left.pop(nearest)
        name, tau = pair_name(output, number), float(np.sqrt(tau_1 * tau_2))
        values[f"{name}ratio"] = ratio_1 + ratio_2
        values[f"{name}lead"] = ratio_1 * tau_2 + ratio_2 * tau_1
        values[f"{name}time_constant"] = tau
        values[f"{name}damping_ratio"] = (tau_1 + tau_2) / (2.0 * tau)
    for number, (ratio, tau) in enumerate(left):
        values[f"{mode_name(output, number)}ratio"] = ratio
        values[f"{mode_name(output, number)}time_constant"] = tau
    return values
