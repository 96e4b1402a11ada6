"""A run whose voltage is given to an actuator, and whether a command can: ``simulate`` with a signal of its file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from ipmclab.signals.signal import EDGE

if TYPE_CHECKING:
    from ipmclab.run import Hold, Run

ASSUMED_HOLD: Final[Hold] = "zero-before"
"""Of a run that does not say what its voltage did between rows: as the hardware reads."""


@dataclass(frozen=True)
class Replay:
    """What the steps that repeat it have to know of a run.

    Parameters
    ----------
    key : str
        Its file, below the folder.
    duration : float [s]
    rate : float [Hz]
    hold : Hold
        As it is taken.
    is_assumed : bool
        Whether the run does not say it.
    why_no_command : str
        Why no command does what the page shows; empty where one does.
    """

    key: str
    duration: float
    rate: float
    hold: Hold
    is_assumed: bool = False
    why_no_command: str = ""

    @classmethod
    def of(cls, key: str, run: Run) -> Replay:
        """What is to be known of a run.

        Examples
        --------
        >>> from ipmclab import Run
        >>> Replay.of("a.nc", Run.from_arrays(time=[0.0, 0.5, 1.0], voltage=[1.0, 1.0, 0.0], hold="zero"))
        Replay(key='a.nc', duration=1.5, rate=2.0, hold='zero', is_assumed=False, why_no_command='')
        >>> Replay.of("a.nc", Run.from_arrays(time=[1.0, 2.0], voltage=[1.0, 1.0])).why_no_command
        'the first row of this run is at 1 s, that of a command at 0 s'
        """
        is_assumed = run.hold == "unknown"
        hold = ASSUMED_HOLD if is_assumed else run.hold
        rate = next((rate for rate in (run.rate, _exact_rate(run)) if _is_at(run, rate)), None)
        why = _why_no_command(run, rate)
        return cls(key, len(run) / (rate or run.rate), rate or run.rate, hold, is_assumed, why)


def _exact_rate(run: Run) -> float:
    """Not rounded: of a long run its rows would drift from those of the rounded one."""
    return float((len(run) - 1) / (run.time[-1] - run.time[0]))


def _is_at(run: Run, rate: float) -> bool:
    """Whether row k is at k/rate, as near as a signal takes for the same time: a command then gives it its voltage."""
    return bool(np.max(np.abs(run.time - np.arange(len(run)) / rate)) <= EDGE)


def _why_no_command(run: Run, rate: float | None) -> str:
    if run.metadata.voltage_sensed == "upstream of shunt":
        return "the voltage of this run was sensed upstream of a shunt, which a command does not put in series"
    if abs(run.time[0]) > EDGE:
        return f"the first row of this run is at {run.time[0]:g} s, that of a command at 0 s"
    return "" if rate is not None else "the rows of this run are not equally spaced, those of a command are"
