"""What belongs to a run in addition to its arrays: the strip, the conditions, the operator's notes, the zeros."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ipmclab.run.finding import Finding
from ipmclab.sample import Sample


@dataclass(frozen=True)
class Mark:
    """Something that happened at a time [s] of the record.

    ``kind`` is ``note`` for what an operator noted, else what the recorder saw: ``limit``, ``gap``, ``bench``,
    ``stop``.
    """

    time: float
    text: str
    kind: str = "note"

    def __post_init__(self) -> None:
        # Half a character (a lone surrogate) can be typed into no terminal, but sent by a program; no file can hold it.
        object.__setattr__(self, "text", self.text.encode("utf-8", "replace").decode())


@dataclass(frozen=True)
class ZeroReading:
    """What a channel read at rest: a recorded step, never an edit of the data.

    Parameters
    ----------
    channel : str
    kind : "zero", "tare" or "preload"
        At 0 V; with the tip clear of the load cell; with the tip on it.
    when : "before" or "after"
        The signal.
    value : float [SI unit of the channel]
        Mean reading.
    standard_uncertainty : float [SI unit of the channel]
    drift : float [SI unit of the channel per s], optional
    """

    channel: str
    kind: Literal["zero", "tare", "preload"]
    when: Literal["before", "after"]
    value: float
    standard_uncertainty: float
    drift: float | None = None


@dataclass(frozen=True)
class RunMetadata:
    """What belongs to a run in addition to its arrays.

    Parameters
    ----------
    origin : "measured", "simulated" or "virtual bench"
    sample : Sample, optional
    mounting_id : str, optional
        New at every clamping.
    run_number : int, optional
        Number of this run on the sample.
    signal : str, optional
        The commanded signal, as text.
    voltage_sensed : "electrodes" or "upstream of shunt", optional
        Where ``voltage`` was measured.
    shunt_resistance : float [ohm], optional
        The shunt in series with the strip.
    polarity : "normal" or "reversed", optional
        ``reversed`` when the strip was driven the other way round.
    minutes_out_of_water, minutes_in_environment : float [min], optional
    mass : float [kg], optional
        Of the strip as it was weighed before this run, with its water.
    clamp_pressure : float [Pa], optional
    chamber : "on", "still" or "off", optional
        Whether it regulated while the strip was recorded: ``still`` is on, with fan and compressor off meanwhile.
    temperature : float [degC], relative_humidity : float [percent], optional
        The environment of the run: the mean of what was read, or as set or noted.
    water_content : float, optional
        Of the membrane as the run begins: molecules of water for each sulfonate group.
    water_content_origin : "assumed", "computed" or "measured", optional
        How that is known: assumed in equilibrium, computed from a history of the air, measured by mass.
    operator, notes : str, optional
    marks : tuple of Mark
    starts_from_rest : bool, optional
        True when the strip is known to have been discharged and at rest before row 0.
    sampling_period_known : bool
        False when the record did not carry its sampling period.
    ranges : mapping of channel to (low, high) [SI]
        What the instrument can read.
    calibrations : mapping of channel to text
        The raw channel scaling.
    bench : str, optional
    source_file : str, optional
    recorded_at : str, optional
        ISO 8601 time of row 0.
    software_version : str, optional
    parameters : mapping of name to float [SI]
        For a simulated run, the parameters of the actuator.
    uuid : str, optional
        Of this run, given when it is recorded.
    state : "complete", "aborted" or "recovered", optional
        How the recording ended; None for a run that no recorder made.
    state_reason : str, optional
        Why it was aborted, or what was recovered.
    purpose : "signal", "baseline", "fingerprint" or "reference", optional
        Why it was recorded.
    pair_id : str, optional
        Shared by the two polarities of one signal.
    repeat : int, optional
        Counts the repeats of one signal from 1.
    experiment, rig : str, optional
        What they are called.
    rig_proof : str, optional
        The report of the hardware check list on this rig, or that there is none.
    source_resistance : float [ohm], optional
        Of what drives the strip, in series with it.
    zeros : tuple of ZeroReading
    uncertainties : mapping of channel to float [SI]
        Standard uncertainty of the calibration, with the change of its zero.
    limits : mapping of name to text
        What the guard watched.
    findings : tuple of Finding
        Of a simulated run: where its model was asked beyond what it holds for. Of any run: what was done to it.
    """

    origin: Literal["measured", "simulated", "virtual bench"] = "measured"
    sample: Sample | None = None
    mounting_id: str | None = None
    run_number: int | None = None
    signal: str | None = None
    voltage_sensed: Literal["electrodes", "upstream of shunt"] | None = None
    shunt_resistance: float | None = None
    polarity: Literal["normal", "reversed"] | None = None
    minutes_out_of_water: float | None = None
    minutes_in_environment: float | None = None
    mass: float | None = None
    clamp_pressure: float | None = None
    chamber: Literal["on", "still", "off"] | None = None
    temperature: float | None = None
    relative_humidity: float | None = None
    water_content: float | None = None
    water_content_origin: Literal["assumed", "computed", "measured"] | None = None
    operator: str | None = None
    notes: str | None = None
    marks: tuple[Mark, ...] = ()
    starts_from_rest: bool | None = None
    sampling_period_known: bool = True
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    calibrations: Mapping[str, str] = field(default_factory=dict)
    bench: str | None = None
    source_file: str | None = None
    recorded_at: str | None = None
    software_version: str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    uuid: str | None = None
    state: Literal["complete", "aborted", "recovered"] | None = None
    state_reason: str | None = None
    purpose: Literal["signal", "baseline", "fingerprint", "reference"] | None = None
    pair_id: str | None = None
    repeat: int | None = None
    experiment: str | None = None
    rig: str | None = None
    rig_proof: str | None = None
    source_resistance: float | None = None
    zeros: tuple[ZeroReading, ...] = ()
    uncertainties: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, str] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
