"""The table of a comparison: one row a run."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ipmclab.comparison.baseline import Drift, air_of, is_baseline
from ipmclab.comparison.factors import FACTORS
from ipmclab.comparison.run_metrics import metrics_of_run
from ipmclab.destination import write_text
from ipmclab.model.actuator import Actuator
from ipmclab.quality.metrics import Metric
from ipmclab.quality.period import period_of
from ipmclab.quality.record import Record
from ipmclab.run import Run
from ipmclab.store.catalogue.facts import signal_facts


@dataclass(frozen=True)
class RunRow:
    """One run of a comparison.

    Parameters
    ----------
    run : str
        Its name.
    sample, mounting, date, signal : str
        Empty where they are not known.
    waveform : str
        For example ``"step"``; ``"periodic"`` for a foreign record whose voltage repeats, empty where nobody knows and
        of a baseline.
    values : mapping of factor to float [SI]
        Of each factor that is known of the run.
    metrics : mapping of ``channel.name`` to Metric
    baseline : str
        The run whose drift was taken from it.
    """

    run: str
    sample: str
    mounting: str
    date: str
    signal: str
    waveform: str
    values: Mapping[str, float]
    metrics: Mapping[str, Metric]
    baseline: str = ""

    @property
    def strip(self) -> str:
        """What distinguishes its strip from others: the sample; where none is named, the run, whose strip may be
        any."""
        return self.sample or f"\0{self.run}"


def row_of(run: Run, *, strip: Actuator | None = None, drift: Drift | None = None) -> RunRow:
    """The row of a run.

    Parameters
    ----------
    run : Run
    strip, drift : as for ``metrics_of_run``

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> row = row_of(simulate(load_actuator("friend-2"), "sine 1 V 0.1 Hz", duration=40.0, rate=50.0))
    >>> row.waveform, row.values["frequency"], f"{1e3 * row.metrics['displacement.amplitude'].value:.4f} mm"
    ('sine', 0.1, '0.4126 mm')
    """
    metadata, sample, air = run.metadata, run.metadata.sample, air_of(run)
    waveform, voltage, frequency = _drive(run)
    known = {
        "thickness": None if sample is None else sample.nominal_membrane_thickness,
        "loading": None if sample is None else sample.plating_loading,
        "voltage": voltage,
        "frequency": frequency,
        "humidity": air.relative_humidity,
        "temperature": air.temperature,
        "clamp_pressure": metadata.clamp_pressure,
    }
    metrics = metrics_of_run(run, strip=strip, drift=drift)
    return RunRow(
        run=run.name,
        sample="" if sample is None else sample.id,
        mounting=metadata.mounting_id or "",
        date=metadata.recorded_at or "",
        signal=metadata.signal or "",
        waveform=waveform,
        values={name: value for name, value in known.items() if value is not None},
        metrics={f"{one.channel}.{one.name}": one for one in metrics},
        baseline=drift.name if drift is not None and run.displacement is not None else "",
    )


def _drive(run: Run) -> tuple[str, float | None, float | None]:
    """Waveform, amplitude [V] and frequency [Hz]: as the signal is named, else as the voltage shows them."""
    if is_baseline(run):  # a step of 0 V is no step
        return "", None, None
    named = signal_facts(run.metadata.signal)
    if named.words and named.amplitude is not None:
        return " ".join(named.words), abs(named.amplitude), named.frequency
    period = period_of(run)
    size = float(np.abs(run.voltage).max())
    if period is not None:
        return "periodic", 0.5 * float(np.ptp(run.voltage)), 1.0 / period
    record = Record.of(run)
    is_step = bool(len(record.edges)) and record.steps_from_rest and bool(record.constant_after[0])
    return ("step", abs(float(record.heights[0])), None) if is_step else ("", size, None)


def table_csv(rows: Sequence[RunRow]) -> str:
    """The table as CSV text: SI units, an empty cell where nothing is known.

    Examples
    --------
    >>> print(table_csv([RunRow("a.nc", "s1", "", "", "step 1 V", "step", {"voltage": 1.0}, {})]), end="")
    run,sample,mounting,date,signal,waveform,baseline,voltage [V]
    a.nc,s1,,,step 1 V,step,,1.0
    """
    factors = [factor for factor in FACTORS.values() if any(factor.name in row.values for row in rows)]
    units = {key: metric.unit for row in rows for key, metric in row.metrics.items()}
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    words = ("run", "sample", "mounting", "date", "signal", "waveform", "baseline")
    headed = [*((one.name, one.quantity.unit) for one in factors), *units.items()]
    writer.writerow([*words, *(f"{name} [{unit}]" if unit else name for name, unit in headed)])
    for row in rows:
        values = [row.values.get(factor.name, "") for factor in factors]
        metrics = [row.metrics[key].value if key in row.metrics else "" for key in units]
        writer.writerow([*(getattr(row, word) for word in words), *values, *metrics])
    return stream.getvalue()


def write_csv(text: str, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write CSV text to a file.

    Raises
    ------
    InputError
        A folder that does not exist, or a file that does.
    """
    target = Path(path)
    write_text(text, target, overwrite=overwrite)
    return target
