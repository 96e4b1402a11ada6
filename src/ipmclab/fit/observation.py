"""What a fit took or found for one run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ipmclab.fit.row_marks import RowMarks
from ipmclab.statespace.noise_model import NoiseModel
from ipmclab.strip_state.run_state import RunState

Start = Literal["stated rest", "shown rest", "assumed rest", "rest, which the readings do not contradict", "free"]


@dataclass(frozen=True)
class Observation:
    """What a fit took or found for one run.

    Parameters
    ----------
    label : str
        Its file, its signal, or its place in the call.
    content_sha256 : str
    hold : str
    delay : float [s]
        By how much the edges lie after the rows of the voltage channel; estimated where the hold is unknown.
    start : str
        Whether the strip was at rest before row 0, and how that is known.
    initial_state : mapping of name to float [SI]
        Found where the start is free.
    offset, drift : mapping of output to float [SI unit, SI unit/s]
    noise : mapping of output to float [SI]
        Standard deviation of the residuals.
    span : mapping of output to float [SI]
        Largest less smallest of the readings that entered; of a file of an earlier version empty.
    samples : mapping of output to int
        Readings that entered the fit.
    series_resistance : float [ohm]
        A shunt that lay between the voltage sense and the strip.
    noise_model : mapping of output to NoiseModel
        Of outputs whose residuals are autocorrelated, or whose zero moves.
    mounting : str
        The clamping of the strip; empty where the run does not say.
    state : RunState, optional
        Its water, its temperature and its dose, where the actuator has laws that follow them.
    marks : RowMarks, optional
        By what its rows are known again in another cut of the record; of a file of an earlier version None.
    """

    label: str
    content_sha256: str
    hold: str
    delay: float
    start: Start
    initial_state: Mapping[str, float] = field(default_factory=dict)
    offset: Mapping[str, float] = field(default_factory=dict)
    drift: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    samples: Mapping[str, int] = field(default_factory=dict)
    span: Mapping[str, float] = field(default_factory=dict)
    series_resistance: float = 0.0
    noise_model: Mapping[str, NoiseModel] = field(default_factory=dict)
    mounting: str = ""
    state: RunState | None = None
    marks: RowMarks | None = None
