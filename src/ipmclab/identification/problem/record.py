"""How one run reads an actuator: hold, delay, start, noise, and which readings count.

What stands here belongs to one run, never to the sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from ipmclab.fit.observation import Start
from ipmclab.identification.problem.edge_delay import EdgeDelay
from ipmclab.model.numerics.drive import Drive, shifted
from ipmclab.model.numerics.timeline import timeline
from ipmclab.model.simulate import series_shunt
from ipmclab.quality import censored, usable
from ipmclab.quality.noise import noise_of_readings, quantum_of
from ipmclab.quality.record import Channel
from ipmclab.quality.rows_at_rest import rest_rows
from ipmclab.quality.shown_at_rest import BEFORE_STEP, AtRest
from ipmclab.run import Finding, FloatArray, Hold, Run
from ipmclab.strip_state.run_state import RunState

Mask = npt.NDArray[np.bool_]
_Kept = TypeVar("_Kept")

READ_OUTPUTS: Final = ("current", "displacement", "force")
"""Channels that are data. The node voltage of a simulated run is not: no bench measures it."""

LONGEST_DELAY: Final = 3
"""Rows by which the edges of a foreign record are searched to lie early or late."""

_EDGE: Final = 0.05  # of the largest voltage
_SHOWS_ZERO: Final = 20  # rows at 0 V from which the check of a record tells whether the current reads zero there
ZERO: Final = "offset", "current"
OFFSET: Final = "observation.offset.current"
_EXACT: Final = 1e-9  # of the range of the readings
_SCATTERING: Final = 8  # readings, from which their scatter from one to the next says how noisy they are

ASSUMED_REST: Final = "rest, which the readings do not contradict"
UNASKED_REST: Final = "assumed rest"  # of a record that begins at 0 V, where no current says more

LEAST_NOISE: Final = 1e-30
"""Of a channel that reads zero throughout [SI]: readings are weighed by its inverse, whose square must be a number."""


@dataclass(frozen=True, eq=False)
class Reading:
    """One output of one run.

    Parameters
    ----------
    values : float array, shape (n_time,)
        Zero where nothing is used.
    used : bool array, shape (n_time,)
        Equalities and bounds alike.
    side : int array, shape (n_time,)
        +1 where the true value is at least the reading, -1 where it is at most, 0 where it is measured.
    noise : float
        A first estimate from differences of neighbours.
    weights : float array, shape (n_time,), optional
        Of means of several rows: the root of how many.
    """

    values: FloatArray
    used: Mask
    side: npt.NDArray[np.int8]
    noise: float
    weights: FloatArray | None = None

    @cached_property
    def complete(self) -> bool:
        """Whether every reading is used."""
        return bool(self.used.all())

    @cached_property
    def has_bounds(self) -> bool:
        """Whether some reading is only a bound."""
        return bool(self.side.any())

    @cached_property
    def exact(self) -> Mask:
        """Readings that are measured, not bounds."""
        return np.asarray(self.used & (self.side == 0)) if self.has_bounds else self.used

    @cached_property
    def exact_of_used(self) -> Mask:
        """Which of the readings that are used are measured, shape (n_used,)."""
        return np.asarray(self.exact[self.used])

    @cached_property
    def measured(self) -> FloatArray:
        """The values of the readings that are measured."""
        return self.values[self.exact]

    @cached_property
    def quantum(self) -> float:
        """The step of the converter; 0 where none shows."""
        return quantum_of(np.diff(self.measured))


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """A run made ready for the fit."""

    run: Run
    place: int
    label: str
    readings: Mapping[str, Reading]
    start: Start
    series_resistance: float
    unsettled: frozenset[tuple[str, str]] = frozenset()
    """What the sensors may add, such as ("offset", "force"): asked of the readings."""
    shown: Mapping[tuple[str, str], AtRest] = field(default_factory=dict)
    """What of that the rows at 0 V show by themselves."""
    known_delay: float | None = None
    """What an earlier fit of this run found [s], where the circuit that goes with it stays fixed."""
    known_offset: Mapping[str, float] = field(default_factory=dict)
    known_drift: Mapping[str, float] = field(default_factory=dict)
    """What an earlier fit found for the sensors that are not read here."""
    state: RunState | None = None
    """Water, temperature and dose, where the actuator has laws that it follows."""

    def limits(self, what: str, output: str) -> tuple[float, float]:
        """Between which values the offset [SI] or the drift [SI/s] of a sensor lies, where rows at 0 V show it.

        Where the strip is known to be at rest they show the sensor alone: the zero of a current and the slope of a
        force or a motion are held to them. Where the strip may move in them a sensor drifts by no more than is seen.
        """
        rest, anywhere = self.shown.get((what, output)), (-math.inf, math.inf)
        if rest is not None and self.start in ("free", ASSUMED_REST, UNASKED_REST):
            return rest.at_most if what == "drift" else anywhere
        if rest is None or (what == "offset") != (output == "current"):
            return anywhere
        reading, voltage = self.readings[output], np.abs(self.run.voltage)
        rows = np.flatnonzero(reading.exact[: max(self.resting - LONGEST_DELAY, 0)])
        if len(rows) < _SHOWS_ZERO:
            return anywhere
        largest = float(np.ptp(reading.measured))
        driven = largest * float(voltage[rows].max()) / float(voltage.max())
        least, most = rest.about(what, self.run.time[rows], reading.values[rows], reading.quantum, driven)
        duration = 1.0 if what == "offset" else float(self.run.time[-1] - self.run.time[0])
        # What is known to rounding needs no holding.
        return (least, most) if (most - least) * duration > _EXACT * largest else anywhere

    def keep(self, key: Hashable, make: Callable[[], _Kept]) -> _Kept:
        """What a computation works out of this record once, under a key of its own."""
        kept: dict[Hashable, Any] = self.__dict__.setdefault("_kept", {})
        if key not in kept:
            kept[key] = make()
        found: _Kept = kept[key]
        return found

    @cached_property
    def period(self) -> float:
        """The largest step between rows over which the voltage jumps [s]: an edge lies somewhere within it.

        A gap while the voltage is constant says nothing of where the edges lie.
        """
        voltage = self.run.voltage
        jumps = np.abs(np.diff(voltage)) > _EDGE * np.max(np.abs(voltage))
        return float(np.max(np.diff(self.run.time)[jumps])) if jumps.any() else self.step

    @property
    def step(self) -> float:
        """The usual step between rows [s], in which their noise is counted."""
        return 1.0 / self.run.rate if self.run.is_uniform else float(np.median(np.diff(self.run.time)))

    def without(self, outputs: Collection[str]) -> PreparedRun:
        """The same without the readings of some outputs."""
        return replace(self, readings={name: one for name, one in self.readings.items() if name not in outputs})

    def times_of(self, output: str) -> FloatArray:
        """When its measured readings were taken [s]."""
        return self.run.time[self.readings[output].exact]

    @cached_property
    def shows_edges(self) -> bool:
        """Whether the voltage moves between the first row and the last: a slow sine has its small edges too."""
        voltage = self.run.voltage
        return bool(np.ptp(voltage) > _EDGE * np.max(np.abs(voltage)))

    @property
    def at_its_rows(self) -> EdgeDelay:
        """Edges at the rows, give or take half a row; those of a motion anywhere that is searched (rectangular)."""
        reach = 0.5 if "current" in self.readings else LONGEST_DELAY
        return EdgeDelay(0.0, 2.0 * reach * self.period / math.sqrt(12.0), 0.0)

    @cached_property
    def resting(self) -> int:
        """Rows at 0 V before the voltage first moves."""
        return rest_rows(self.run)

    @property
    def zero_is_unseen(self) -> bool:
        """Whether no row at 0 V shows the zero of the current, and it is not asked of the others."""
        if ZERO in self.unsettled:
            return False
        shown = np.count_nonzero(self.readings["current"].exact[: self.resting]) if "current" in self.readings else 0
        return bool(shown < _SHOWS_ZERO)

    @property
    def zero_is_taken(self) -> bool:
        """Whether the current of a run on a bench was taken to read zero at 0 V."""
        is_measured = "current" in self.readings and self.run.metadata.origin != "simulated"
        return is_measured and ZERO not in self.unsettled

    @property
    def voltage_shows_zero(self) -> bool:
        """Whether a constant differs from every multiple of the voltage as much as rows at 0 V must show."""
        voltage = self.run.voltage[self.readings["current"].exact]
        return len(voltage) - float(voltage.sum()) ** 2 / max(float(voltage @ voltage), 1e-300) >= _SHOWS_ZERO

    def with_zero(self, *, asked: bool = True) -> PreparedRun:
        """The same, the zero of its current asked of the readings, or taken for none where no row at 0 V shows it."""
        return replace(
            self, unsettled=self.unsettled | {ZERO} if asked else self.unsettled - {ZERO} | self.shown.keys()
        )

    @property
    def delay_is_free(self) -> bool:
        """Whether the edges have to be located."""
        return self.run.hold == "unknown" and self.known_delay is None


def prepare(
    run: Run,
    place: int,
    outputs: Sequence[str],
    findings: Sequence[Finding],
    channels: Mapping[str, Channel] | None = None,
) -> PreparedRun:
    """Take from a run what a fit needs: usable readings, their noise, and how it starts.

    ``channels`` are the run's as the check saw them, with what it computed of them.
    """
    label = label_of(run, place)
    shunt = series_shunt(run, where=label)
    masks, bounds = usable(run, findings), censored(run, findings)
    readings: dict[str, Reading] = {}
    for output in outputs:
        values = getattr(run, output)
        if values is None:
            continue
        side = bounds[output]
        used = masks[output] | (side != 0)
        exact = used & (side == 0)
        checked = (channels or {}).get(output)
        # Where the check saw the same readings, it has told their noise.
        known = checked.noise if checked is not None and checked.missing is None and exact.all() else None
        readings[output] = Reading(np.where(used, values, 0.0), used, side, _noise(values[exact], known))
    is_simulated = run.metadata.origin == "simulated"
    unsettled = set() if is_simulated else {("offset", output) for output in readings if output != "current"}
    shown = {
        (BEFORE_STEP[finding.code], str(finding.channel)): AtRest.of(finding)
        for finding in findings
        if finding.code in BEFORE_STEP and finding.channel in readings
    }
    return PreparedRun(
        _with_effective_voltage(run, findings),
        place,
        label,
        readings,
        _start(run, masks["current"] | (bounds["current"] != 0) if run.current is not None else None),
        shunt,
        frozenset(unsettled | shown.keys()),
        shown,
    )


def _with_effective_voltage(run: Run, findings: Sequence[Finding]) -> Run:
    """The run with the voltage that reached the strip: none while it had no contact."""
    stretches = [pair for finding in findings if finding.code == "contact-missing" for pair in finding.samples]
    if not stretches:
        return run
    voltage = run.voltage.copy()
    for first, stop in stretches:
        voltage[first:stop] = 0.0
    return replace(run, voltage=voltage)


def label_of(run: Run, place: int) -> str:
    """A short name of a run for messages and tables."""
    return run.name or f"run {place}"


def disambiguated(records: Sequence[PreparedRun]) -> list[PreparedRun]:
    """Records whose labels are equal get their mounting into them."""
    labels = [record.label for record in records]
    return [
        replace(record, label=f"{label} ({mounting})")
        if labels.count(label) > 1 and (mounting := record.run.metadata.mounting_id)
        else record
        for label, record in zip(labels, records, strict=True)
    ]


def _noise(values: FloatArray, known: float | None = None) -> float:
    """How much neighbouring readings scatter; never nothing, for it is what a fit divides by."""
    if not len(values):
        return LEAST_NOISE
    if len(values) < _SCATTERING:
        known = float(np.std(values))
    noise = noise_of_readings(values) if known is None else known
    return max(noise, 1e-9 * float(np.abs(values).max()), LEAST_NOISE)


def at_their_rows(records: Iterable[PreparedRun]) -> dict[int, EdgeDelay]:
    """The edges of foreign records at their rows, by the places of these."""
    return {record.place: record.at_its_rows for record in records if record.delay_is_free}


def fastest_rate(records: Iterable[PreparedRun]) -> float:
    """The highest Nyquist rate [1/s] of the records that show motion; 0 where none does."""
    moving = (record.run.rate for record in records if {"force", "displacement"} & set(record.readings))
    return float(np.pi * max(moving, default=0.0))


def as_read(record: PreparedRun, held: Mask | None = None) -> Run:
    """The run as a fit sees it: a reading that is not used, or ``held`` out, is missing; so is a channel not read."""
    channels: dict[str, Any] = dict.fromkeys(READ_OUTPUTS)
    for output, reading in record.readings.items():
        channels[output] = np.where(reading.used if held is None else reading.used & ~held, reading.values, np.nan)
    return replace(record.run, **channels)


def _start(run: Run, readable: Mask | None) -> Start:
    """Whether a run began at rest, by what it states, else by its current in the rows that can be read."""
    stated = run.metadata.starts_from_rest
    if stated is not None:
        return "stated rest" if stated else "free"
    # Up to a few rows before the edge may belong to it already: a channel can lead another.
    quiet = rest_rows(run) - LONGEST_DELAY
    if run.current is None and quiet >= _SHOWS_ZERO:
        return UNASKED_REST
    if quiet < LONGEST_DELAY or run.current is None or readable is None:
        return ASSUMED_REST
    current, before = run.current[readable], run.current[:quiet][readable[:quiet]]
    if len(before) == 0:
        return ASSUMED_REST
    allowed = 0.01 * float(np.max(np.abs(current))) + 4.0 * _noise(current) / np.sqrt(len(before))
    return "shown rest" if abs(float(np.mean(before))) <= allowed else ASSUMED_REST


def drive(record: PreparedRun, delay: float = 0.0) -> Drive:
    """The input of the circuit between rows, for a hold or a delay [s] of the edges."""
    run = record.run
    voltage = run.voltage
    if run.is_uniform and delay == 0.0 and run.hold != "unknown":
        step, kind = np.array([1.0 / run.rate]), np.zeros(len(voltage) - 1, dtype=np.int64)
        if run.hold == "zero":
            return Drive(step, kind, voltage[:-1], voltage[:-1], voltage)
        if run.hold == "first":
            return Drive(step, kind, voltage[:-1], voltage[1:], voltage)
    if run.is_uniform and run.hold == "unknown":
        return shifted(voltage, 1.0 / run.rate, delay, from_rest=record.start != "free")
    line = timeline(run.time, voltage, model_hold(record), delay=delay, from_rest=record.start != "free")
    rows = np.flatnonzero(line.row >= 0).astype(np.intp)
    return Drive(line.durations, line.interval, line.start, line.end, line.reading, rows)


def model_hold(record: PreparedRun) -> Hold:
    """The hold on which a delay is counted: a foreign record's edges are sought around its rows."""
    return "zero" if record.run.hold == "unknown" else record.run.hold


def places_of_mountings(runs: Iterable[tuple[int, Run]]) -> dict[str, tuple[int, ...]]:
    """Of runs with their places, those of each mounting; a run that does not say of which it is stands nowhere."""
    found: dict[str, list[int]] = {}
    for place, run in runs:
        if run.metadata.mounting_id:
            found.setdefault(run.metadata.mounting_id, []).append(place)
    return {mounting: tuple(places) for mounting, places in found.items()}


def ending_of(mounting: str) -> str:
    """How the names of the parameters end that a mounting has for itself."""
    return f"[mounting {mounting}]"


def own_endings(place: int, mounting: str) -> tuple[str, ...]:
    """How the names of parameters end that belong to a run, or to its mounting, and not to all runs of a fit."""
    return (f"[{place}]", ending_of(mounting)) if mounting else (f"[{place}]",)


def own_values(values: Mapping[str, float], endings: Sequence[str]) -> dict[str, float]:
    """The parameters of the actuator that belong to one run, without their endings."""
    return {
        name.removesuffix(ending): value
        for name, value in values.items()
        for ending in endings
        if name.endswith(ending) and not name.startswith("observation.")
    }
