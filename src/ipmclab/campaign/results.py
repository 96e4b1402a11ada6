"""What the runs of a campaign say: the metrics of each, and of each kind of run over its repeats."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.special import stdtrit

from ipmclab.campaign.blocks import BASELINE, Block, CampaignRun
from ipmclab.destination import replacing
from ipmclab.errors import InputError
from ipmclab.platform import as_typed
from ipmclab.quality.check import check
from ipmclab.quality.metrics import Metric, measure
from ipmclab.run import FloatArray, Run
from ipmclab.store.run_file import read_run

if TYPE_CHECKING:
    from ipmclab.comparison.compare import Comparison

_OF_EITHER_SIDE: Final = ("largest", "strain")
"""Metrics with the sign of the side that is larger: of a periodic signal that may be either."""


@dataclass(frozen=True)
class RunResult:
    """One run that was kept, or flagged.

    Parameters
    ----------
    run : CampaignRun
    record : Run
    path : str
        In the folder of the campaign.
    verdict : "kept" or "flagged"
    findings : tuple of str
        Codes of what was found, the worse ones.
    metrics : tuple of Metric
    said : mapping of str to str, optional
        What each finding says of the run, by its code.
    baseline : str, optional
        Id of the run without voltage whose drift was taken from the displacement.
    """

    run: CampaignRun
    record: Run
    path: str
    verdict: str
    findings: tuple[str, ...]
    metrics: tuple[Metric, ...]
    said: Mapping[str, str] = field(default_factory=dict)
    baseline: str = ""

    def metric(self, channel: str, name: str) -> Metric | None:
        """A metric, or None where the run does not allow it."""
        return next((one for one in self.metrics if (one.channel, one.name) == (channel, name)), None)


@dataclass(frozen=True)
class Repeated:
    """Runs that differ in nothing but their repeat.

    Parameters
    ----------
    sample, part, condition, label, measured : str
    results : tuple of RunResult
        Without those that are flagged.
    """

    sample: str
    part: str
    condition: str
    label: str
    measured: str
    results: tuple[RunResult, ...]

    def metrics(self, channel: str, name: str) -> tuple[Metric, ...]:
        """A metric of each repeat that allows it."""
        return tuple(metric for one in self.results if (metric := one.metric(channel, name)) is not None)

    def mean(self, channel: str, name: str) -> tuple[float, float, int] | None:
        """Mean of a metric over its repeats, their standard deviation (NaN for one), and how many there are."""
        values = self._values(channel, name)
        if not len(values):
            return None
        return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else math.nan, len(values)

    def _values(self, channel: str, name: str) -> FloatArray:
        """A metric of each repeat, on one side: noise alone turns a sign, or a phase of half a turn."""
        values = np.array([one.value for one in self.metrics(channel, name)])
        if name == "phase":
            values = values[:1] + np.angle(np.exp(1j * (values - values[:1])))
        if name in _OF_EITHER_SIDE and self.metrics(channel, "amplitude"):
            values = np.copysign(values, values.sum())
        return values

    def interval(self, channel: str, name: str) -> tuple[float, float] | None:
        """The 95 % interval of the mean of a metric: by the scatter of the repeats, of one run by its own noise.

        A drift that was taken from all repeats is wrong by the same amount in each: it does not scatter, and is added.
        """
        found = self.mean(channel, name)
        if found is None:
            return None
        mean, deviation, count = found
        metrics = self.metrics(channel, name)
        if count == 1:
            return metrics[0].interval
        reach = float(stdtrit(count - 1, 0.975)) * deviation / math.sqrt(count)
        reach = math.hypot(reach, max(one.of_drift for one in metrics))
        return mean - reach, mean + reach


def read_results(
    folder: Path, blocks: Sequence[Block], recorded: Mapping[str, Mapping[str, Any]]
) -> tuple[RunResult, ...]:
    """Read and measure every run of a campaign that is done, in the order of the campaign.

    One that is flagged and cannot be read is left out.

    Parameters
    ----------
    folder : Path
        Of the campaign.
    blocks : sequence of Block
    recorded : mapping of run id to event
        The last word on each run, as ``State.recorded`` has it.
    """
    found = []
    for run in (run for block in blocks for run in block.runs):
        event = recorded.get(run.id)
        if event is None or event["verdict"] not in ("kept", "flagged"):
            continue
        try:
            record = read_run(folder / event["path"])
        except InputError as error:
            if event["verdict"] == "flagged":  # perhaps for this very reason
                continue
            raise InputError(
                f"{run.id} was recorded and kept, and now: {error.message}",
                code=error.code,
                where=error.where,
                repair="put the file back from a copy; or, as long as its journal is kept, move journal-archive/"
                f"{event['uuid']}.runj into recording, both in {folder}, then: ipmclab recover {as_typed(folder)}",
            ) from error
        codes = tuple(dict.fromkeys(one["code"] for one in event["findings"] if one["severity"] != "info"))
        findings = check(record)
        said = {one.code: one.message for one in findings}
        metrics = measure(record, findings)
        found.append(RunResult(run, record, event["path"], event["verdict"], codes, metrics, said))
    return tuple(found)


def comparable(results: Sequence[RunResult]) -> list[Run]:
    """The records that may be held side by side: those that were kept. A baseline has no signal, not a step of 0 V."""
    kept = [one for one in results if one.verdict == "kept"]
    return [
        replace(one.record, metadata=replace(one.record.metadata, signal=None))
        if one.run.label == BASELINE
        else one.record
        for one in kept
    ]


def less_drift(results: Sequence[RunResult], comparison: Comparison) -> tuple[RunResult, ...]:
    """The runs that were kept, with the metrics that a comparison has of them: without the curl of their strip.

    Parameters
    ----------
    results : sequence of RunResult
    comparison : Comparison
        Of the same runs, as ``comparable`` gives them.
    """
    kept = [one for one in results if one.verdict == "kept"]
    ids = {row.run: one.run.id for one, row in zip(kept, comparison.rows, strict=True)}
    return tuple(
        replace(one, metrics=tuple(row.metrics.values()), baseline=ids.get(row.baseline, ""))
        for one, row in zip(kept, comparison.rows, strict=True)
    )


def by_repeat(results: Sequence[RunResult]) -> tuple[Repeated, ...]:
    """Runs put together that differ in nothing but their repeat, in the order of the first of each."""
    groups: dict[tuple[str, str, str, str, str], list[RunResult]] = {}
    for one in results:
        run = one.run
        group = groups.setdefault((run.sample, run.part, run.condition, run.label, run.measured), [])
        if one.verdict == "kept":
            group.append(one)
    return tuple(Repeated(*key, results=tuple(group)) for key, group in groups.items())


def write_repeats(repeated: Sequence[Repeated], path: Path) -> Path:
    """Write every metric of each kind of run over its repeats as one table (CSV, SI units).

    Of a displacement without its curl it names the baselines, by the ids of their runs.
    """
    head = ["sample", "experiment", "condition", "signal", "measured", "channel", "metric"]
    head += ["mean", "standard_deviation", "repeats", "low", "high", "unit", "baseline"]
    with replacing(path, overwrite=True) as part, part.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(head)
        for kind in repeated:
            units = {(one.channel, one.name): one.unit for result in kind.results for one in result.metrics}
            for (channel, name), unit in units.items():
                mean, deviation, count = kind.mean(channel, name) or (math.nan, math.nan, 0)
                low, high = kind.interval(channel, name) or ("", "")
                about = [kind.sample, kind.part, kind.condition, kind.label, kind.measured, channel, name]
                baselines = dict.fromkeys(one.baseline for one in kind.results if channel == "displacement")
                text = "; ".join(name for name in baselines if name)
                table.writerow([*about, mean, "" if count < 2 else deviation, count, low, high, unit, text])
    return path


def write_metrics(results: Sequence[RunResult], path: Path) -> Path:
    """Write every metric of every run as one table (CSV, SI units)."""
    head = ["run", "sample", "experiment", "condition", "signal", "repeat", "measured", "file", "verdict"]
    head += ["channel", "metric", "value", "low", "high", "unit"]
    with replacing(path, overwrite=True) as part, part.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(head)
        for one in results:
            run = one.run
            about = [run.number, run.sample, run.part, run.condition, run.label, run.planned.repeat, run.measured]
            for metric in one.metrics:
                low, high = metric.interval or ("", "")
                values = [metric.channel, metric.name, repr(metric.value), low, high, metric.unit]
                table.writerow([*about, one.path, one.verdict, *values])
    return path
