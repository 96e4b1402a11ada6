"""What continues where parameters change: the charge of each capacitor, not its voltage."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_BRANCH: Final = re.compile(r"(?:^|\.)branches\.(\d+)\.voltage$")


def charges(states: Sequence[str], values: Mapping[str, float]) -> FloatArray:
    """What a state is multiplied by to be a charge of its capacitor, up to an area; 1 for other states.

    Examples
    --------
    >>> names = ("circuit.branches.0.voltage", "beam.displacement")
    >>> charges(names, {"circuit.branches.0.permittivity": 0.3, "geometry.thickness": 0.001}).tolist()
    [300.0, 1.0]
    """
    found = np.ones(len(states))
    for place, name in enumerate(states):
        match = _BRANCH.search(name)
        if match:
            permittivity = values[f"circuit.branches.{match[1]}.permittivity"]
            found[place] = permittivity / values["geometry.thickness"]
    return found


def charged(states: Sequence[str], values: Mapping[str, float], stated: Mapping[str, float]) -> FloatArray:
    """How many times each state is the charge that it was in the state of reference, whose values are ``stated``."""
    return charges(states, values) / charges(states, stated)
