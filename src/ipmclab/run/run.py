"""A run: one record, measured or simulated, with everything needed to understand it later."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, TypedDict, Unpack, get_args

import numpy as np
import numpy.typing as npt

from ipmclab.checksum import ArrayChecksum, content_checksum
from ipmclab.errors import InputError
from ipmclab.run.arrays import FloatArray, as_column, as_flags, as_readings, check_names, check_time, read_only
from ipmclab.run.channels import QUALITY_FLAGS, SLOW_CHANNELS, Hold, raw_name
from ipmclab.run.metadata import RunMetadata
from ipmclab.shown import Shown
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    import xarray


_ARRAYS: Final = ("time", "time_environment", *CHANNELS)


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
        What the converters read, before scaling and zeroing; what the output was commanded to give.
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
        held = self.__dict__  # as a frozen class is written to when it is made
        for name in _ARRAYS:
            if held[name] is not None:
                held[name] = read_only(held[name])
        for name in ("quality", "raw"):
            given = held[name]
            held[name] = {channel: read_only(values) for channel, values in given.items()} if given else {}

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
        check_names("readings", given, CHANNELS)
        check_names("raw", raw or {}, (*CHANNELS, "output"))
        if hold not in get_args(Hold):
            raise InputError(
                f"unknown hold {hold!r}",
                code="unknown-hold",
                where="hold",
                repair=f"use one of {', '.join(get_args(Hold))}",
            )
        times = as_column("time", time)
        check_time("time", times)
        slow_times = None if time_environment is None else as_column("time_environment", time_environment)
        if slow_times is not None:
            check_time("time_environment", slow_times, least=1)
        columns: dict[str, FloatArray] = {}
        for name in CHANNELS:
            values: Any = given.get(name)
            if values is None and name != "voltage":
                continue
            expected = slow_times if name in SLOW_CHANNELS and slow_times is not None else times
            columns[name] = as_readings(name, values, len(expected))
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
            quality={name: as_flags(name, bits, columns) for name, bits in (quality or {}).items()},
            raw={name: as_readings(f"{name}_raw", values, len(times)) for name, values in (raw or {}).items()},
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
        """The run as a labelled dataset, as it is in a file: built on first use."""
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
