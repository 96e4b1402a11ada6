"""A run: one record, measured or simulated, with everything needed to understand it later."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal, TypedDict, Unpack, get_args

import numpy as np
import numpy.typing as npt

from ipmclab.checksum import ArrayChecksum, content_checksum
from ipmclab.errors import InputError, suggest
from ipmclab.sample import Sample
from ipmclab.shown import Shown
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    import xarray

FloatArray = npt.NDArray[np.float64]

Hold = Literal["zero", "zero-before", "first", "unknown"]
"""What the voltage did between rows.

``zero``: row k is read just as the output takes ``voltage[k]``, which holds until row k+1.
``zero-before``: row k is read just before the output changes, so ``voltage[k]`` held since row k-1.
``first``: straight lines between rows. ``unknown``: a foreign record; the edge delay is estimated.
"""

Severity = Literal["info", "warning", "error"]
Effect = Literal["none", "mask", "lower_bound", "upper_bound"]

QUALITY_FLAGS: Final[dict[str, int]] = {
    "missing": 1,
    "sentinel": 2,
    "clipped": 4,
    "contact_lost": 8,
    "masked_by_operator": 16,
}
"""Bits of a ``<channel>_quality`` array: what was known at recording or import."""

SLOW_CHANNELS: Final = ("temperature", "relative_humidity", "chamber_temperature", "chamber_relative_humidity")
"""Channels that have a time base of their own, ``time_environment``."""


def raw_name(name: str) -> str:
    """What the raw array of a channel, or of the output, is called in words."""
    return "commanded output" if name == "output" else f"raw reading of {CHANNELS[name].name}"


@dataclass(frozen=True)
class Finding:
    """Something about a record or a fit that its user must know.

    Parameters
    ----------
    code : str
        Stable name for programs, for example ``"laser-lost"``.
    severity : "info", "warning" or "error"
    message : str
        What was seen, with its numbers and units.
    repair : str
        What to do about it.
    channel : str, optional
        The channel it is about; None for the whole record.
    samples : tuple of (start, stop)
        Half-open ranges of rows.
    effect : "none", "mask", "lower_bound" or "upper_bound"
        What identification does with the samples: uses them, leaves them out, or takes
        each reading as a lower or an upper bound of the true value (a clipped reading).
    values : mapping
        The measured numbers behind the message, in SI units (counts as integers).
    """

    code: str
    severity: Severity
    message: str
    repair: str = ""
    channel: str | None = None
    samples: tuple[tuple[int, int], ...] = ()
    effect: Effect = "none"
    values: Mapping[str, float | int | str | None] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of rows that the finding names."""
        return sum(stop - start for start, stop in self.samples)


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
    """What a channel told at rest: a recorded step, never an edit of the data.

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
    """What belongs to a run beside its arrays.

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


class Readings(TypedDict, total=False):
    """The arrays that ``Run.from_arrays`` takes for what was read, by channel; a channel without any may be None."""

    current: npt.ArrayLike | None
    displacement: npt.ArrayLike | None
    force: npt.ArrayLike | None
    applied_voltage: npt.ArrayLike | None
    temperature: npt.ArrayLike | None
    relative_humidity: npt.ArrayLike | None
    chamber_temperature: npt.ArrayLike | None
    chamber_relative_humidity: npt.ArrayLike | None


@dataclass(frozen=True, eq=False)
class Run(Shown):
    """One record: time, voltage and what was measured, all in SI units.

    Displacement is positive towards the anode at positive voltage. Values stay as they
    were read, and no array can be written to; NaN stands for a sentinel or a missing reading.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    voltage : float array, shape (n_time,) [V]
    current : float array, shape (n_time,) [A], optional
    displacement : float array, shape (n_time,) [m], optional
    force : float array, shape (n_time,) [N], optional
    applied_voltage : float array, shape (n_time,) [V], optional
        The voltage of the node behind the electrodes; in simulated runs.
    temperature, relative_humidity : float array, shape (n_environment,) [degC], [percent], optional
        By the sensors at the strip.
    chamber_temperature, chamber_relative_humidity : float array, shape (n_environment,) [degC], [percent], optional
        By the chamber's own sensors.
    time_environment : float array, shape (n_environment,) [s], optional
    hold : "zero", "zero-before", "first" or "unknown"
    quality : mapping of channel to uint8 array, shape (n_time,)
        Bits of ``QUALITY_FLAGS``, as known at recording or import.
    raw : mapping of channel, or ``"output"``, to float array, shape (n_time,) [V]
        What the converters read, before scaling and zeroing; what the output was told to give.
    metadata : RunMetadata
    file : str
        Name of the file that it was read from; empty for a run that was in none. It is no part of the content.

    Use ``Run.from_arrays`` for arrays of your own: it checks them.
    """

    time: FloatArray
    voltage: FloatArray
    current: FloatArray | None = None
    displacement: FloatArray | None = None
    force: FloatArray | None = None
    applied_voltage: FloatArray | None = None
    temperature: FloatArray | None = None
    relative_humidity: FloatArray | None = None
    chamber_temperature: FloatArray | None = None
    chamber_relative_humidity: FloatArray | None = None
    time_environment: FloatArray | None = None
    hold: Hold = "zero"
    quality: Mapping[str, npt.NDArray[np.uint8]] = field(default_factory=dict)
    raw: Mapping[str, FloatArray] = field(default_factory=dict)
    metadata: RunMetadata = field(default_factory=RunMetadata)
    file: str = ""

    def __post_init__(self) -> None:
        # A record is what was read: whoever wants other numbers makes another run of them.
        for name in ("time", "time_environment", *CHANNELS):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, _closed(values))
        object.__setattr__(self, "quality", {name: _closed(bits) for name, bits in self.quality.items()})
        object.__setattr__(self, "raw", {name: _closed(values) for name, values in self.raw.items()})

    @classmethod
    def from_arrays(
        cls,
        *,
        time: npt.ArrayLike,
        voltage: npt.ArrayLike,
        time_environment: npt.ArrayLike | None = None,
        hold: Hold = "zero",
        quality: Mapping[str, npt.ArrayLike] | None = None,
        raw: Mapping[str, npt.ArrayLike] | None = None,
        metadata: RunMetadata | None = None,
        **readings: Unpack[Readings],
    ) -> Run:
        """Make a run from arrays, after checking them.

        The other channels that were read are given by their names, such as ``current=``: see ``Readings``.
        ``raw`` always has a value for each row of ``time``, also for a channel that is kept at the times of the
        environment.

        Raises
        ------
        InputError
            Not a column of real numbers, unequal lengths, fewer than two rows, time that does not
            increase or is not finite, an infinite reading, a gap (NaN) in the voltage, an unknown
            hold, flags that are no quality bits, raw readings of no channel.

        Examples
        --------
        >>> run = Run.from_arrays(time=[0.0, 0.02, 0.04], voltage=[0.0, 1.0, 1.0], current=[0.0, 0.06, 0.05])
        >>> run.rate
        50.0
        """
        given: dict[str, Any] = {"voltage": voltage, **readings}
        _check_names("readings", given, CHANNELS)
        _check_names("raw", raw or {}, (*CHANNELS, "output"))
        if hold not in get_args(Hold):
            raise InputError(
                f"unknown hold {hold!r}",
                code="unknown-hold",
                where="hold",
                repair=f"use one of {', '.join(get_args(Hold))}",
            )
        times = _column("time", time)
        check_time("time", times)
        slow_times = None if time_environment is None else _column("time_environment", time_environment)
        if slow_times is not None:
            check_time("time_environment", slow_times, least=1)
        columns: dict[str, FloatArray] = {}
        for name in CHANNELS:
            values = given.get(name)
            if values is None:
                continue
            expected = slow_times if name in SLOW_CHANNELS and slow_times is not None else times
            columns[name] = _readings(name, values, len(expected))
        gaps = np.flatnonzero(np.isnan(columns["voltage"]))
        if len(gaps):
            raise InputError(
                f"sample {gaps[0]} (and {len(gaps) - 1} more) is NaN: without the voltage nothing can be computed",
                code="voltage-gap",
                where="voltage",
                repair="cut the record there, or give the voltage that was commanded",
            )
        return cls(
            time=times,
            time_environment=slow_times,
            hold=hold,
            quality={name: _flags(name, bits, columns) for name, bits in (quality or {}).items()},
            raw={name: _readings(f"{name}_raw", values, len(times)) for name, values in (raw or {}).items()},
            metadata=metadata or RunMetadata(),
            file="",
            **columns,
        )

    @property
    def channels(self) -> dict[str, FloatArray]:
        """The channels that this run has, by name, in the order of ``units.CHANNELS``."""
        present = {name: getattr(self, name) for name in CHANNELS}
        return {name: values for name, values in present.items() if values is not None}

    @property
    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Every array under the name that it has in files, ``time`` first."""
        arrays: dict[str, npt.NDArray[Any]] = {"time": self.time, **self.channels}
        if self.time_environment is not None:
            arrays["time_environment"] = self.time_environment
        arrays |= {f"{name}_quality": np.asarray(bits, dtype=np.uint8) for name, bits in self.quality.items()}
        return arrays | {f"{name}_raw": values for name, values in self.raw.items()}

    @property
    def name(self) -> str:
        """What people know it by: its file, else the file that it was imported from, else its signal, else nothing."""
        return self.file or self.metadata.source_file or self.metadata.signal or ""

    @cached_property
    def rate(self) -> float:
        """Mean sampling rate [Hz], rounded to 12 digits (so that 50 Hz reads 50.0)."""
        return float(f"{(len(self.time) - 1) / (self.time[-1] - self.time[0]):.12g}")

    @cached_property
    def is_uniform(self) -> bool:
        """Whether the rows are equally spaced to within a millionth of the period."""
        steps = np.diff(self.time)
        return bool(np.ptp(steps) <= 1e-6 * steps.mean())

    @property
    def content_sha256(self) -> str:
        """SHA-256 of the arrays that are there, their names and the hold: the same for a copy, another for any edit."""
        digests = {}
        for name, values in self.arrays.items():
            checksum = ArrayChecksum()
            checksum.update(values)
            digests[name] = checksum.digest()
        return content_checksum(self.hold, digests)

    def __len__(self) -> int:
        return len(self.time)

    def __str__(self) -> str:
        """One line: what was applied, how long it is, and its channels."""
        signal = f" of {self.metadata.signal}" if self.metadata.signal else ""
        length = self.time[-1] - self.time[0]
        return (
            f"{self.metadata.origin} run{signal}: {len(self)} rows, {length:g} s at {self.rate:g} Hz, "
            f"hold {self.hold}; {', '.join(self.channels)}"
        )

    __repr__ = __str__

    @cached_property
    def data(self) -> xarray.Dataset:
        """The run as a labelled dataset, as it stands in a file: built on first use."""
        import xarray

        slow = "time" if self.time_environment is None else "time_environment"
        variables: dict[str, Any] = {}
        for name, values in self.channels.items():
            dimension = slow if name in SLOW_CHANNELS else "time"
            attributes = {"units": CHANNELS[name].unit, "long_name": CHANNELS[name].name}
            variables[name] = (dimension, values, attributes)
        for name, bits in self.quality.items():
            dimension = slow if name in SLOW_CHANNELS else "time"
            meanings = {
                "flag_masks": np.array(list(QUALITY_FLAGS.values()), dtype=np.uint8),
                "flag_meanings": " ".join(QUALITY_FLAGS),
            }
            variables[f"{name}_quality"] = (dimension, bits, meanings)
        for name, values in self.raw.items():
            variables[f"{name}_raw"] = ("time", values, {"units": "V", "long_name": raw_name(name)})
        coordinates: dict[str, Any] = {"time": ("time", self.time, {"units": "s", "long_name": "time"})}
        if self.time_environment is not None:
            coordinates["time_environment"] = ("time_environment", self.time_environment, {"units": "s"})
        return xarray.Dataset(variables, coords=coordinates, attrs={"hold": self.hold})


def _closed(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """The array, which cannot be written to through this."""
    view = values.view()
    view.flags.writeable = False
    return view


def _column(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        given: Any = np.ma.asarray(values)  # NumPy would show what a mask hides, such as the fill value of a file
        if given.dtype.kind in "cmM":
            raise TypeError(f"{given.dtype} is not a real number")  # NumPy would drop the imaginary part or the unit
        column = np.array(given.astype(np.float64).filled(np.nan))
    except (TypeError, ValueError) as error:
        raise InputError(
            "not an array of numbers", code="bad-array", where=name, repair="give a one-dimensional array of floats"
        ) from error
    if column.ndim != 1:
        raise InputError(
            f"the array has shape {column.shape}, it must have one dimension",
            code="bad-array",
            where=name,
            repair="give one column",
        )
    return column


def _readings(name: str, values: npt.ArrayLike, length: int) -> FloatArray:
    column = _column(name, values)
    if len(column) != length:
        raise InputError(
            f"{len(column)} values for {length} times",
            code="unequal-lengths",
            where=name,
            repair="give one value for each time",
        )
    infinite = np.flatnonzero(np.isinf(column))
    if len(infinite):
        raise InputError(
            f"sample {infinite[0]} is infinite",
            code="infinite-reading",
            where=name,
            repair="use NaN for a missing reading",
        )
    return column


def _check_names(what: str, given: Collection[str], known: Collection[str]) -> None:
    """Refuse what belongs to no channel."""
    for name in given:
        if name not in known:
            words = "raw readings" if what == "raw" else what
            raise InputError(
                f"{words} of no channel: {name!r}", code="unknown-channel", where=what, repair=suggest(name, known)
            )


def _flags(name: str, values: npt.ArrayLike, columns: Mapping[str, FloatArray]) -> npt.NDArray[np.uint8]:
    """The quality of a channel: bits for each of its values."""
    if name not in columns:
        raise InputError(
            f"quality for a channel that is not there: {name!r}",
            code="unknown-channel",
            where="quality",
            repair="leave it out",
        )
    flags = _bits(name, values)
    if flags.shape != columns[name].shape:
        raise InputError(
            f"{flags.size} flags for {columns[name].size} values",
            code="unequal-lengths",
            where=f"{name}_quality",
            repair="give one flag for each value",
        )
    return flags


def _bits(name: str, values: npt.ArrayLike) -> npt.NDArray[np.uint8]:
    given = np.asarray(values)
    whole = given.dtype.kind in "biuf" and bool(np.all((given >= 0) & (given <= 255) & (given % 1 == 0)))
    if not whole:
        raise InputError(
            "not an array of quality bits",
            code="bad-quality",
            where=f"{name}_quality",
            repair="give whole numbers from 0 to 255, sums of QUALITY_FLAGS",
        )
    return np.ascontiguousarray(given, dtype=np.uint8)


def check_time(name: str, times: FloatArray, *, least: int = 2) -> None:
    """Refuse times that do not increase.

    Parameters
    ----------
    name : str
        What the messages name.
    times : float array, shape (n_time,) [s]
    least : int
        Rows that there must be.

    Raises
    ------
    InputError
        Too few rows, a time that is not finite or not after the one before.
    """
    if len(times) < least:
        raise InputError(
            f"{len(times)} rows, at least {least} are needed",
            code="too-short",
            where=name,
            repair="give a longer record",
        )
    if not np.all(np.isfinite(times)):
        row = int(np.flatnonzero(~np.isfinite(times))[0])
        raise InputError(f"row {row} is {times[row]}", code="bad-time", where=name, repair="every row needs its time")
    backwards = np.flatnonzero(np.diff(times) <= 0)
    if len(backwards):
        row = int(backwards[0]) + 1
        raise InputError(
            f"row {row} is at {times[row]:.9g} s, not after {times[row - 1]:.9g} s",
            code="bad-time",
            where=name,
            repair="sort the rows, or repair the clock",
        )
