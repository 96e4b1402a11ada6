"""What a sweep is."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.batch import Batch, Record
from ipmclab.model.reductions import Reduced
from ipmclab.signals import Signal
from ipmclab.sweep.design import Design, checksum, described, drawn_by
from ipmclab.version import __version__

FloatArray = npt.NDArray[np.float64]

_FEWEST, _MOST = 4096, 262_144
_FILES: Final = 256


@dataclass(frozen=True, eq=False)
class Sweep:
    """An actuator under one voltage, with many parameter sets, each reduced to a few metrics.

    Parameters
    ----------
    actuator : Actuator
    signal : Signal
    record : Record
    design : Design
    metrics : Reduced
    sets_per_file : int
        What is written at once, and at most lost when the program is killed; 0 for a size that goes with the count.
    """

    actuator: Actuator
    signal: Signal
    record: Record
    design: Design
    metrics: Reduced
    sets_per_file: int = 0

    @property
    def part_size(self) -> int:
        """Sets in one file: some hundred files, each of a size that fits the memory.

        Examples
        --------
        >>> from ipmclab.sweep.template import TEMPLATE
        >>> from ipmclab.sweep.sweep_file import sweep_from_text
        >>> sweep_from_text(TEMPLATE).part_size
        4096
        """
        if self.sets_per_file:
            return self.sets_per_file
        return int(min(max(1 << (self.design.count // _FILES).bit_length(), _FEWEST), _MOST))

    def batch(self, sets: Mapping[str, FloatArray]) -> Batch:
        """Some of the sets, ready to be simulated.

        Raises
        ------
        InputError
            A value outside its allowed range.
        """
        return Batch.of(self.actuator, self.signal, sets, self.record, self.metrics.outputs)

    def digest(self) -> str:
        """The same for the same sweep, another where anything differs that its numbers depend on."""
        import scipy

        voltage = Batch.of(self.actuator, self.signal, None, self.record, self.metrics.outputs).voltage
        asked = {
            "actuator": dict(self.actuator.parameter_values),
            "voltage": checksum(voltage),
            "record": [len(self.record.time), self.record.rate, self.record.hold],
            "design": described(self.design),
            "metrics": self.metrics.names,
            "sets_per_file": self.part_size,
            "versions": [__version__, scipy.__version__, *drawn_by(self.design)],
        }
        return hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()
