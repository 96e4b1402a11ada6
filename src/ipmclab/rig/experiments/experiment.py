"""An experiment: what is to be recorded on which sample, checked and in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from ipmclab.rig.experiments.environments import (
    Order,
    Reference,
    TargetEnvironment,
)
from ipmclab.sample import Sample
from ipmclab.signals import Signal

VIRTUAL: Final = "virtual"
"""The rig that needs no file: the thesis's rig with a simulated strip in it."""

MEASURABLE: Final = ("current", "displacement", "force")

STEPS: Final = ("hydrate", "weigh", "clamp", "chamber-on", "equilibrium", "chamber-off", "zero", "preload", "apply")
"""Steps of Friend's section 3.5 in their order, with the weighing; ``hydrate`` also comes last."""

MOST_REPEATS: Final = 1000
"""Of each signal: a plan of more takes longer to make than anybody waits for it."""


@dataclass(frozen=True)
class ListedRun:
    """One run that somebody has planned already, as a campaign does.

    Parameters
    ----------
    signal : Signal
    purpose : "signal", "baseline" or "reference"
    repeat : int
        Counts from 1.
    pair_id : str, optional
        Shared by the two polarities of one signal.
    uuid : str, optional
        Of the run to be: by it the run is found again, whatever ended the program.
    """

    signal: Signal
    purpose: Literal["signal", "baseline", "reference"] = "signal"
    repeat: int = 1
    pair_id: str | None = None
    uuid: str | None = None


@dataclass(frozen=True)
class Experiment:
    """What is to be recorded, checked and in SI units.

    Parameters
    ----------
    title : str
    sample : Sample
    rig : Path or "virtual"
    folder : Path
        The laboratory folder.
    signals : tuple of Signal
        Each is applied for ``duration``.
    rate : float [Hz]
    duration : float [s]
    measured : tuple of str
        In addition to the voltage.
    rest_before, rest_after : float [s]
        At 0 V, recorded with every signal.
    pause : float [s]
        At 0 V between two signals and after a fingerprint, not recorded: the strip discharges.
    zero_time : float [s]
        How long the channels are read at rest, before and after every signal.
    repeats : int
    pair : bool
        Each signal with both polarities.
    baseline : bool
        A run without voltage first.
    fingerprint : bool
        A short run at 0.1 V before every signal.
    actuator : str, optional
        Name or file of a model of the strip.
    operator, notes, mounting_id : str, optional
    clamp_pressure : float [Pa], optional
    steps : tuple of str, optional
        Those that are taken; what is needed follows from the rest where it is left out.
    weigh : bool
        The strip is weighed before it is clamped.
    environments : tuple of TargetEnvironment
        The conditions under which everything is recorded; empty at those of the room.
    order : "palindromic" or "listed"
        Of the conditions, where there are several.
    reference : Reference, optional
    limits : mapping
        The table as it is.
    where : str
        The file, for messages.
    listed : tuple of ListedRun
        The runs of each condition, in the place of what signals, repeats, pair and baseline say; no file states them.

    Use ``load_experiment`` to make one.
    """

    title: str
    sample: Sample
    rig: Path | str
    folder: Path
    signals: tuple[Signal, ...]
    rate: float
    duration: float
    measured: tuple[str, ...] = ("current", "force")
    rest_before: float = 5.0
    rest_after: float = 5.0
    pause: float = 120.0
    zero_time: float = 10.0
    repeats: int = 1
    pair: bool = False
    baseline: bool = False
    fingerprint: bool = True
    actuator: str | None = None
    operator: str | None = None
    notes: str | None = None
    mounting_id: str | None = None
    clamp_pressure: float | None = None
    steps: tuple[str, ...] | None = None
    weigh: bool = False
    environments: tuple[TargetEnvironment, ...] = ()
    order: Order = "palindromic"
    reference: Reference | None = None
    limits: Mapping[str, Any] = field(default_factory=dict)
    where: str = "experiment"
    listed: tuple[ListedRun, ...] = ()
