"""Many parameter sets of one strip, for tests."""

from __future__ import annotations

import numpy as np

from ipmclab.model import OUTPUTS, Actuator
from ipmclab.model.reductions import REDUCTIONS

RATE, ROWS = 50.0, 300
METRICS = [f"{output}.{name}" for output in OUTPUTS for name in REDUCTIONS]
MANY = {"duration": ROWS / RATE, "rate": RATE}

LANES = (
    "friend-2",
    "friend-2+relaxation.displacement+relaxation.force",
    "friend-2+viscoelastic",
    "friend-2+clamp",
    "friend-2+load",
)
ALONE = ("friend-2+leak.exponential", "friend-2+laser", "friend-2+line.modes=12")


def rough(rows: int = ROWS) -> np.ndarray:
    time = np.arange(rows) / RATE
    return 0.5 + np.sin(2.0 * np.pi * 0.43 * time) + np.sign(np.sin(1.7 * time))


def scattered(actuator: Actuator, sets: int, by: float = 0.2) -> dict[str, np.ndarray]:
    """Every parameter of the stages, off by about this part."""
    random = np.random.default_rng(20261121)
    return {
        name: value * np.exp(by * random.normal(size=sets))
        for name, value in actuator.parameter_values.items()
        if value > 0.0 and not name.startswith(("geometry.sensing", "line.", "clamp."))
    } | {"geometry.free_length": np.linspace(0.022, 0.04, sets)}
