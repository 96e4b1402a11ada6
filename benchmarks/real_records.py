"""The four real step records of one strip, as several results use them: ``IPMCLAB_REAL_RUNS`` names their folder."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

import ipmclab
from ipmclab import Actuator, Run
from ipmclab.quality import usable

Array = npt.NDArray[np.float64]

MAPS = Path(__file__).resolve().parents[1] / "docs" / "import_maps"
NAMES = ("step_1V", "step_2V", "step_2V_poor", "step_3V")
CONTACT = {"step_1V": 133, "step_2V": 516, "step_2V_poor": 420, "step_3V": 690}
"""Row at which the strip first sees the voltage: the voltage's step, in step_3V the contact 130 rows later."""


@dataclass(frozen=True, eq=False)
class StepRecord:
    """One record, with its times counted from the contact.

    Parameters
    ----------
    name : str
    run : Run
    contact : int
        Row.
    """

    name: str
    run: Run
    contact: int

    @property
    def since(self) -> Array:
        """Time from the contact [s]."""
        return self.run.time - self.run.time[self.contact]

    def rows(self, first: float, last: float) -> slice:
        """Rows from one time after the contact to another [s]."""
        return slice(*np.searchsorted(self.since, [first - 1e-6, last + 1e-6]).tolist())

    def usable(self, channel: str) -> npt.NDArray[np.bool_]:
        """Rows that no finding leaves out."""
        return usable(self.run, ipmclab.check(self.run))[channel]


def records() -> dict[str, StepRecord]:
    """The records by name, or an exit that says how to provide them."""
    folder = os.environ.get("IPMCLAB_REAL_RUNS")
    if not folder:
        sys.exit("IPMCLAB_REAL_RUNS is unset: it names the folder of the real records")
    found = {}
    for name in NAMES:
        run = ipmclab.import_run(Path(folder) / f"{name}.csv.gz", MAPS / f"{name}.toml")
        found[name] = StepRecord(name, run, CONTACT[name])
    return found


def strip(series: float = 56.9) -> Actuator:
    """The strip as its source describes it, 25 x 5 x 0.5 mm, laser at 15 mm; everything else is friend-2's.

    Parameters
    ----------
    series : float [ohm]
        Resistance of both electrodes together.
    """
    return ipmclab.load_actuator("friend-2").replace(
        **{
            "geometry.free_length": 25e-3,
            "geometry.clamped_length": 5e-3,
            "geometry.width": 5e-3,
            "geometry.thickness": 0.5e-3,
            "geometry.sensing_length": 15e-3,
            "circuit.sheet_resistance": series / 12.0,
        }
    )


def cut(record: StepRecord, first: float, last: float, *, channels: tuple[str, ...] = ("current",)) -> Run:
    """Rows from one time after the contact to another [s], as a run of its own; from rest where it begins before it."""
    rows, run = record.rows(first, last), record.run
    voltage = np.where(record.since >= 0.0, run.voltage, 0.0)[rows]
    arrays = {name: getattr(run, name)[rows] for name in channels}
    return Run.from_arrays(time=run.time[rows] - run.time[rows][0], voltage=voltage, hold="unknown", **arrays)
