"""The slow modes of a relaxation as poles, and as the parameters of an actuator."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ipmclab.model.actuator import Actuator
from ipmclab.model.stages.relaxation import mode_name, mode_ratios, pair_name, slow_times
from ipmclab.run import FloatArray

Modes = tuple[tuple[float, float], ...]
"""Slow modes as (ratio, time constant [s]), fastest first."""


class Quadratic(NamedTuple):
    """Two poles as (level + gain s)/(s^2 + p1 s + p2)."""

    level: float
    gain: float
    p1: float
    p2: float


def of_two(poles: FloatArray, residues: FloatArray) -> Quadratic:
    """Two real poles with their residues, as one fraction."""
    level = -float(residues @ poles[::-1])
    return Quadratic(level, float(np.sum(residues)), float(-np.sum(poles)), float(np.prod(poles)))


def fastest_two(poles: FloatArray, residues: FloatArray) -> list[int]:
    """The places of the fastest two poles that a d(s) with a positive d(0) can have; the fastest where none can.

    Any two would do for d(s), for which is called slow is a name.
    """
    pairs = [list(pair) for pair in combinations(np.argsort(poles).tolist(), 2)]
    positive = (pair for pair in pairs if of_two(poles[pair], residues[pair]).level > 0.0)
    return next(positive, pairs[0])


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
    return values | _of_modes(output, left)


def _of_modes(output: str, modes: Iterable[tuple[float, float]]) -> dict[str, float]:
    values = {}
    for number, (ratio, tau) in enumerate(modes):
        values[f"{mode_name(output, number)}ratio"] = ratio
        values[f"{mode_name(output, number)}time_constant"] = tau
    return values


def fastest_to_coupling(values: Mapping[str, float], output: str, farthest_zero: float) -> dict[str, float]:
    """The same answer of one output with the fastest real poles called those of d(s), and the others slow modes.

    An output is a sum of poles, of which any two with a positive static part make a d(s), the rest the slow modes
    beside it. Complex poles are always those of d(s); beside a pair of slow modes nothing gets another name.

    Parameters
    ----------
    values : mapping of name to float [SI]
        Every parameter of the actuator.
    output : "displacement" or "force"
    farthest_zero : float [1/s]
        Of d(s): one beyond it, which hardly shows, is put there, and the answer is nearly the same.

    Returns
    -------
    dict of str to float
        The parameters of the coupling and of the slow modes; empty where they have these names already.

    Examples
    --------
    >>> slow = {"relaxation.force.0.ratio": -0.1, "relaxation.force.0.time_constant": 0.05}
    >>> coupling = {"coupling.gain": 1e-8, "coupling.zero": 0.5, "coupling.p1": 1.1, "coupling.p2": 0.1}
    >>> named = fastest_to_coupling({**coupling, **slow}, "force", 1000.0)
    >>> round(named["relaxation.force.0.time_constant"], 3), round(named["coupling.p1"], 3)
    (10.0, 21.0)
    """
    ratios, times = mode_ratios(values, output), slow_times(values, output)
    gain, zero, p1, p2 = (values[f"coupling.{name}"] for name in ("gain", "zero", "p1", "p2"))
    under = 0.25 * p1**2 - p2
    if under <= 0.0 or not ratios or len(ratios) != len(times):
        return {}
    fast = 0.5 * p1 + math.sqrt(under)
    own, slow = np.array([-fast, -p2 / fast]), -1.0 / np.array([values[name] for name in times])
    parts = gain * (zero + own) / (own - own[::-1])
    poles = np.concatenate([own, slow])
    residues = np.concatenate([parts, gain * zero / p2 * slow * [values[name] for name in ratios]])
    pair = fastest_two(poles, residues)
    if set(pair) == {0, 1}:
        return {}
    level, gain, p1, p2 = of_two(poles[pair], residues[pair])
    gain = max(gain, level / farthest_zero)
    modes = slow_modes(np.delete(poles, pair), np.delete(residues, pair), level / p2)
    named = {"gain": gain, "zero": level / gain, "p1": p1, "p2": p2}
    return {f"coupling.{name}": value for name, value in named.items()} | _of_modes(output, modes)
