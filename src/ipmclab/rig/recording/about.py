"""What is known of a run: before its first row, and once its rows were read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Final
from uuid import uuid4

import numpy as np
import numpy.typing as npt

from ipmclab.rig.bench import Bench
from ipmclab.rig.recording.run_request import RunRequest
from ipmclab.rig.recording.slow import Air
from ipmclab.rig.recording.zeroing import Rest, contact_levels, is_discharged, subtracted, uncertainties
from ipmclab.rig.scaling import Scaling
from ipmclab.run import SLOW_CHANNELS, RunMetadata, ZeroReading
from ipmclab.version import __version__

FloatArray = npt.NDArray[np.float64]

NO_CHARGE: Final = 0.01
"""A current at rest below this share of the run's largest is no reason to doubt that the strip was at rest."""


class About:
    """Gathers what is kept with a run in addition to its rows.

    Parameters
    ----------
    bench : Bench
        Open by the time ``before`` is called.
    request : RunRequest
    names : sequence of str
        The channels that are read.
    """

    def __init__(self, bench: Bench, request: RunRequest, names: tuple[str, ...]) -> None:
        self._bench = bench
        self._request = request
        self._names = names
        self._channels = [bench.rig[name] for name in names]
        self._fast = [channel for channel in self._channels if channel.name not in SLOW_CHANNELS]
        self._prepared = datetime.now().astimezone()
        self._began: datetime | None = None
        self._left = 0.0
        self._peak = 0.0
        self._air: dict[str, list[float]] = {}

    def scaling(self, rest: Rest) -> Scaling:
        """How readings become quantities, with what the channels read at rest."""
        rig = self._bench.rig
        return Scaling(self._channels, subtracted(rig, rest), contact_levels(rig, rest, self._request.tares))

    def before(self, rest: Rest, scaling: Scaling, signal: str) -> RunMetadata:
        """What is known before the first row."""
        rig, about, limits = self._bench.rig, self._request.metadata, self._request.limits
        self._left = rest.ends["current"][1] if "current" in rest.ends else 0.0
        texts = limits.as_text()
        for name, reason in limits.unwatched(rig, self._names).items():
            texts[name] += f" ({reason})"
        zeros = (*about.zeros, *self._request.tares, *rest.zeros)
        fast = [channel.name for channel in self._fast]
        return replace(
            about,
            origin=self._bench.origin,
            sample=about.sample or self._bench.sample,
            signal=signal,
            voltage_sensed=rig.voltage_sensed,
            shunt_resistance=rig.shunt_resistance,
            source_resistance=rig.source_resistance,
            starts_from_rest=is_discharged(rig, rest),
            ranges={name: ends for name, ends in scaling.ranges.items() if name in fast},
            calibrations=scaling.calibrations,
            bench=self._bench.description,
            rig=rig.name,
            software_version=__version__,
            uuid=about.uuid or str(uuid4()),
            recorded_at=datetime.now().astimezone().isoformat("T", "milliseconds"),
            zeros=zeros,
            uncertainties=uncertainties(self._fast, zeros),
            limits=texts,
        )

    def applied(self) -> None:
        """The first row is waited for from now on."""
        self._prepared = datetime.now().astimezone()

    def saw(self, rows: int, values: Mapping[str, FloatArray]) -> None:
        """Note what was read.

        Parameters
        ----------
        rows : int
            That have been read so far.
        values : mapping of channel to float array [SI]
            The last of them.
        """
        if self._began is None:
            # The rows have only just been read; a simulated bench does not take the time for them.
            read_for = timedelta(seconds=rows / self._request.rate)
            self._began = max(self._prepared, datetime.now().astimezone() - read_for)
        if "current" in values:
            self._peak = float(np.fmax.reduce(np.abs(values["current"]), initial=self._peak))

    def breathed(self, air: Air) -> None:
        """Note what the air was like."""
        for name, value in air.values.items():
            if np.isfinite(value):
                self._air.setdefault(name, []).append(value)

    def after(self, about: RunMetadata) -> RunMetadata:
        """What was known beforehand, with the time of row 0 and the air of this run."""
        air = {name: round(float(np.mean(values)), 3) for name, values in self._air.items()}
        rest = about.starts_from_rest
        if rest is False and abs(self._left) <= NO_CHARGE * self._peak:
            rest = None  # too little to matter, too much to call it rest
        return replace(
            about,
            recorded_at=about.recorded_at if self._began is None else self._began.isoformat("T", "milliseconds"),
            starts_from_rest=rest,
            temperature=air.get("temperature", air.get("chamber_temperature", about.temperature)),
            relative_humidity=air.get(
                "relative_humidity", air.get("chamber_relative_humidity", about.relative_humidity)
            ),
        )

    def with_zeros(self, about: RunMetadata, found: Iterable[ZeroReading]) -> RunMetadata:
        """The same with further readings at rest."""
        zeros = (*about.zeros, *found)
        return replace(about, zeros=zeros, uncertainties=uncertainties(self._fast, zeros))
