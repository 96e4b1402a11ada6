"""Runs held side by side: read once each, then everything that their numbers say."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final

from ipmclab.comparison.baseline import BASELINE, NO_SIGNAL, Air, Drift, air_of, baseline_for, drift_of, is_baseline
from ipmclab.comparison.factors import FACTORS, Factor, chosen_factors, levels_of
from ipmclab.comparison.frequency_response import FrequencyResponse, frequency_response
from ipmclab.comparison.metric_model import MetricModel, StripDeviation, model_metric
from ipmclab.comparison.performance import Performance, performances
from ipmclab.comparison.sine_response import SineResponse, sine_responses
from ipmclab.comparison.table import RunRow, row_of
from ipmclab.comparison.trends import Trend, trend_of
from ipmclab.errors import InputError, suggest
from ipmclab.kinds import tell_kinds
from ipmclab.model.actuator import Actuator
from ipmclab.one_thread import on_one_thread
from ipmclab.quality.check import check
from ipmclab.quality.usable import noise_only
from ipmclab.run import Run, RunMetadata
from ipmclab.store.run_file import peek, read_run

Progress = Callable[[int, int], None]

STEP_METRICS: Final = (
    "displacement.largest",
    "displacement.back_relaxation",
    "displacement.time_to_peak",
    "displacement.strain",
    "force.largest",
    "force.back_relaxation",
    "current.largest",
    "current.mean_of_last_tenth",
    "current.charge",
    "current.energy",
)
PERIODIC_METRICS: Final = (
    "displacement.amplitude",
    "displacement.phase",
    "displacement.strain_amplitude",
    "force.amplitude",
    "force.phase",
    "current.amplitude",
    "current.phase",
    "current.half_period_end_last",
    "current.charge_of_half_period",
    "current.mean_power",
)
"""What is compared unless something else is asked for: of a voltage that is constant, and of one that repeats."""

HEADLINES: Final = ("displacement.largest", "displacement.amplitude", "force.largest", "force.amplitude")
"""The metrics by which a strip is said to be unlike the others; each needs as many fits as there are strips."""

_PERIODIC: Final = ("sine", "cosine", "square", "triangle", "multisine", "prbs", "periodic")

_RESPONSES: Final = 40
"""Frequency responses from multisines that are worked out; a figure shows no more."""


_NAMED: Final = 5
"""Runs that a sentence names; of more it says how many."""


@dataclass(frozen=True)
class Unread:
    """A file that was left out, and why."""

    run: str
    message: str


@dataclass(frozen=True, eq=False)
class Comparison:
    """What runs say when they are held side by side. Parts are worked out when they are asked for.

    Parameters
    ----------
    rows : tuple of RunRow
        One a run, in the order given.
    by : tuple of Factor
        What they are compared by.
    metrics : tuple of str
        Keys of the metrics that are compared.
    responses : mapping of run to tuple of FrequencyResponse
        From runs with a periodic multisine.
    strips : mapping of sample id to Actuator
    doubtful : mapping of run to tuple of str
        Codes of findings of severity error.
    unread : tuple of Unread
    noise : mapping of run to tuple of str
        Channels in which ``check`` finds nothing but noise; they have no metrics.
    """

    rows: tuple[RunRow, ...]
    by: tuple[Factor, ...]
    metrics: tuple[str, ...]
    responses: Mapping[str, tuple[FrequencyResponse, ...]]
    strips: Mapping[str, Actuator]
    doubtful: Mapping[str, tuple[str, ...]]
    unread: tuple[Unread, ...]
    noise: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def samples(self) -> tuple[str, ...]:
        """The strips, in the order in which they come."""
        return tuple(dict.fromkeys(row.sample for row in self.rows))

    @property
    def nameless(self) -> int:
        """How many runs name no sample: in effects each counts as a strip of its own."""
        return sum(not row.sample for row in self.rows)

    @property
    def waveforms(self) -> tuple[str, ...]:
        """The waveforms that were applied, the most frequent first."""
        words = [row.waveform for row in self.rows if row.waveform]
        return tuple(sorted(dict.fromkeys(words), key=lambda word: -words.count(word)))

    @cached_property
    def models(self) -> tuple[MetricModel, ...]:
        """A model of each metric over the runs of each waveform, where there are enough of them."""
        # A factor that was not asked for still moves the readings: it stays in the model, behind those that were.
        factors = (*self.by, *(factor for factor in FACTORS.values() if factor not in self.by))
        found = (model_metric(key, waveform, self.rows, factors) for waveform, key in self._compared())
        return tuple(model for model in found if model is not None)

    @cached_property
    def trends(self) -> tuple[Trend, ...]:
        """The laws that magnitudes follow along each factor, where three levels or more were measured."""
        headlines = [(waveform, key) for waveform, key in self._compared() if key.rpartition(".")[2] not in _SIGNED]
        found = (trend_of(key, waveform, self.rows, factor) for waveform, key in headlines for factor in self.by)
        return tuple(trend for trend in found if trend is not None)

    @cached_property
    def strip_deviations(self) -> Mapping[str, tuple[StripDeviation, ...]]:
        """How far each strip is from what the others let expect, by waveform and metric."""
        models = (model for model in self.models if model.key in HEADLINES)
        found = {f"{model.waveform}: {model.label}": model.strip_deviations() for model in models}
        return {name: each for name, each in found.items() if each}

    @cached_property
    def why_no_effects(self) -> str:
        """Why no effect of a factor is reported; empty where one is."""
        if any(factor in self.by for model in self.models for factor in model.factors):
            return ""
        differ = [factor.label for factor in self.by if len({*self._levels(factor)}) > 1]
        if not differ:
            names = ", ".join(factor.label for factor in self.by)
            return f"no effect: as far as is known the runs do not differ in {names}"
        return (
            f"no effect: the runs differ in {' and '.join(differ)}, which takes {len(differ) + 3} runs of one waveform "
            "or more that have the metric"
        )

    @property
    def only_noise(self) -> tuple[str, ...]:
        """A sentence for each channel that has no metrics because it is nothing but noise."""
        found = []
        for channel in dict.fromkeys(channel for channels in self.noise.values() for channel in channels):
            runs = [run for run, channels in self.noise.items() if channel in channels]
            more = f" and {len(runs) - _NAMED} more" if len(runs) > _NAMED else ""
            found.append(
                f"the {channel} holds nothing but noise in {', '.join(runs[:_NAMED])}{more}: it has no metrics there"
            )
        return tuple(found)

    def _levels(self, factor: Factor) -> list[float]:
        return levels_of(factor, [row.values[factor.name] for row in self.rows if factor.name in row.values])

    @cached_property
    def sine_responses(self) -> tuple[SineResponse, ...]:
        """Frequency responses from single sines."""
        return sine_responses(self.rows)

    @cached_property
    def performances(self) -> tuple[Performance, ...]:
        """Work, work density and efficiency where a strip was measured free and blocked."""
        return performances(self.rows, self.strips)

    def keys_of(self, waveform: str) -> tuple[str, ...]:
        """Keys of the metrics that are compared of runs with a waveform."""
        usual = PERIODIC_METRICS if waveform in _PERIODIC else STEP_METRICS
        known = {key for row in self.rows if row.waveform == waveform for key in row.metrics}
        return tuple(key for key in self.metrics or usual if key in known)

    def _compared(self) -> Iterator[tuple[str, str]]:
        for waveform in self.waveforms:
            for key in self.keys_of(waveform):
                yield waveform, key


_SIGNED: Final = ("back_relaxation", "phase", "steady_value")


@tell_kinds
@on_one_thread
def compare(
    runs: Sequence[Run | str | os.PathLike[str]],
    *,
    by: Sequence[str] = (),
    metrics: Sequence[str] = (),
    strips: Sequence[Actuator] = (),
    on_progress: Progress | None = None,
) -> Comparison:
    """Hold runs of strips, dates and laboratories side by side.

    Parameters
    ----------
    runs : sequence of Run or path
        Each is read once; its readings are not kept.
    by : sequence of str, optional
        Factors, such as ``("thickness", "voltage")``; every one that differs where none is given.
    metrics : sequence of str, optional
        Keys such as ``"displacement.largest"``; those of ``STEP_METRICS`` and ``PERIODIC_METRICS`` where none is given.
    strips : sequence of Actuator, optional
        With their samples: dimensions for strain and work density.
    on_progress : callable, optional
        Called with how many runs are read, and of how many.

    Returns
    -------
    comparison : Comparison

    Raises
    ------
    InputError
        No runs, an unknown factor, a metric that no run has. A file that cannot be read, or holds the run of
        another one, is noted and left out.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> runs = [simulate(strip, f"step {volt} V", duration=40.0, rate=50.0) for volt in (1, 2, 3)]
    >>> comparison = compare(runs, by=["voltage"])
    >>> [f"{1e3 * row.metrics['force.largest'].value:.2f} mN" for row in comparison.rows]
    ['1.76 mN', '3.52 mN', '5.28 mN']
    """
    factors = chosen_factors(by)
    if not runs:
        raise InputError("no runs are given", code="no-runs", where="compare", repair="give two runs or more")
    reader = _Reader({one.sample.id: one for one in strips if one.sample is not None})
    reader.read(list(runs), on_progress or (lambda *_: None))
    known = dict.fromkeys(key for row in reader.rows for key in row.metrics)
    for key in metrics:
        if key not in known and reader.rows:
            raise InputError(
                f"no run has the metric {key!r}", code="unknown-metric", where="metrics", repair=suggest(key, known)
            )
    return Comparison(
        rows=tuple(reader.rows),
        by=factors,
        metrics=tuple(metrics),
        responses=reader.responses,
        strips=reader.strips,
        doubtful=reader.doubtful,
        unread=tuple(reader.unread),
        noise=reader.noise,
    )


class _Reader:
    """Reads runs one after the other and keeps what a comparison needs of each."""

    def __init__(self, strips: Mapping[str, Actuator]) -> None:
        self.strips = strips
        self.rows: list[RunRow] = []
        self.responses: dict[str, tuple[FrequencyResponse, ...]] = {}
        self.doubtful: dict[str, tuple[str, ...]] = {}
        self.unread: list[Unread] = []
        self.noise: dict[str, tuple[str, ...]] = {}
        self._files: dict[str, list[tuple[str, RunMetadata]]] = {}  # by what they hold
        self._drifts: list[Drift] = []
        self._taken: dict[str, tuple[RunMetadata, Air, Drift | None]] = {}  # from each run that has a voltage

    def read(self, runs: list[Run | str | os.PathLike[str]], on_progress: Progress) -> None:
        names = _labels(runs)
        # Baselines come first: what they take from a run is known then when the run is read.
        order = sorted(range(len(runs)), key=lambda place: not _notes_a_baseline(runs[place]))
        rows: dict[int, RunRow] = {}
        for done, place in enumerate(order, start=1):
            run = self._run(runs[place], names[place])
            if run is not None and (isinstance(runs[place], Run) or not self._is_again(run)):
                rows[place] = self._add(run)
            on_progress(done, len(runs))
        for place in rows:
            again = self._corrected(runs[place], names[place])
            rows[place] = again or rows[place]
        self.rows = [rows[place] for place in sorted(rows)]
        self.responses = {row.run: self.responses[row.run] for row in self.rows if row.run in self.responses}

    def _run(self, one: Run | str | os.PathLike[str], name: str) -> Run | None:
        if isinstance(one, Run):
            return one if one.name == name else replace(one, file=name)
        try:
            return replace(read_run(one), file=name)
        except InputError as error:
            self.unread.append(Unread(name, f"{error.message}; {error.repair}" if error.repair else error.message))
            return None

    def _is_again(self, run: Run) -> bool:
        """Whether another file held the same run: counted twice, it would make the scatter of repeats too small."""
        same = self._files.setdefault(run.content_sha256, [])
        for name, about in same:
            if _is_one_run(about, run.metadata):
                self.unread.append(Unread(run.name, f"{name} holds the same run, and each run counts once"))
                return True
        same.append((run.name, run.metadata))
        return False

    def _add(self, run: Run) -> RunRow:
        if is_baseline(run):
            drift = drift_of(run)
            if drift is not None:
                self._drifts.append(drift)
        row = self._row(run)
        findings = check(run)
        errors = tuple(dict.fromkeys(one.code for one in findings if one.severity == "error"))
        if errors:
            self.doubtful[run.name] = errors
        noise = tuple(sorted(noise_only(findings)))
        if noise:
            self.noise[run.name] = noise
        if row.waveform == "multisine" and len(self.responses) < _RESPONSES:
            found = tuple(_responses(run))
            if found:
                self.responses[run.name] = found
        return row

    def _row(self, run: Run) -> RunRow:
        sample = "" if run.metadata.sample is None else run.metadata.sample.id
        drift = None
        if not is_baseline(run):
            air = air_of(run)
            drift = baseline_for(run.metadata, self._drifts, air)
            self._taken[run.name] = run.metadata, air, drift
        during = None if drift is None else drift.during(run.metadata)
        return row_of(run, strip=self.strips.get(sample), drift=during)

    def _corrected(self, one: Run | str | os.PathLike[str], name: str) -> RunRow | None:
        """The row of a run for which another baseline counts, now that all are known; None where the same one does.

        So it is where a baseline does not note that it is one.
        """
        if name not in self._taken:
            return None
        about, air, drift = self._taken[name]
        if baseline_for(about, self._drifts, air) is drift:
            return None
        run = self._run(one, name)
        return None if run is None else self._row(run)


def _is_one_run(one: RunMetadata, other: RunMetadata) -> bool:
    """Whether two files that hold the same arrays hold one run: the recorder names it; no sensor reads alike again."""
    if one.uuid is not None and other.uuid is not None:
        return one.uuid == other.uuid
    return one == other or one.origin == other.origin == "measured"


def _notes_a_baseline(one: Run | str | os.PathLike[str]) -> bool:
    if isinstance(one, Run):
        return is_baseline(one)
    noted = peek(one, ("purpose", "signal"))
    return noted.get("purpose") == BASELINE or noted.get("signal") == NO_SIGNAL


def _responses(run: Run) -> Iterator[FrequencyResponse]:
    for channel in ("displacement", "force", "current"):
        if channel not in run.channels:
            continue
        try:
            found = frequency_response(run, channel)
        except InputError:  # too short, or with gaps: its other numbers stand in the table
            continue
        if found.output_rms > 0.0:  # a channel that only ever reads zero was not connected
            yield found


def _labels(runs: Sequence[Run | str | os.PathLike[str]]) -> list[str]:
    """A name for each run: that of its file, with its folder where two are called alike, else numbered."""
    names = [one.name if isinstance(one, Run) else Path(one).name for one in runs]
    counts = Counter(names)
    found = []
    for place, (one, name) in enumerate(zip(runs, names, strict=True)):
        if counts[name] > 1 or not name:
            name = f"{name} ({place + 1})".strip() if isinstance(one, Run) else Path(one).as_posix()
        found.append(name)
    return found
