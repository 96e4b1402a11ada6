"""A bench whose readings are known beforehand, and limits of which each test sets its own."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields, replace

import numpy as np

from ipmclab.rig.channels import THESIS_RIG, Rig
from ipmclab.rig.safety.limits import Limits

NOTHING = Limits(**{field.name: None for field in fields(Limits) if field.name not in ("voltage", "slew")})  # type: ignore[arg-type]
ELECTRODES = replace(THESIS_RIG, voltage_sensed="electrodes")


class Scripted:
    """A bench that reads what stands in a list, row after row, and keeps what it was told to give out."""

    origin = "virtual bench"
    description = "readings from a list"
    sample = None

    def __init__(self, rig: Rig, readings: dict[str, np.ndarray]) -> None:
        # What is read in volts is the quantity itself, so that not a digit is lost on the way.
        channels = [replace(rig[name], gain=1.0, offset=0.0, lost=None) for name in readings]
        self.rig = replace(rig, channels=tuple(channels))
        self.readings = readings
        self.row = 0
        self.output: list[float] = []

    def open(self, measured: Collection[str], rate: float) -> None:
        assert set(measured) == set(self.readings)

    def exchange(self, voltage: float) -> dict[str, float]:
        self.row += 1
        self.output.append(voltage)
        return {name: float(values[self.row - 1]) for name, values in self.readings.items()}

    def zero(self) -> None:
        self.output.append(0.0)
