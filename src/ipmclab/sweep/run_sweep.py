"""Runs a sweep: part by part onto the disk, from where it was left."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ipmclab.engine import Engine, Here
from ipmclab.errors import InputError, suggest
from ipmclab.kinds import tell_kinds
from ipmclab.model.device import Device, on_gpu, worth
from ipmclab.progress import OnProgress
from ipmclab.sweep.chunks import Filling, chunks, measure, pace_of, without_values
from ipmclab.sweep.design import Sampled
from ipmclab.sweep.effects import Effect, morris_effects
from ipmclab.sweep.indices import Index, sobol_indices
from ipmclab.sweep.packages import parquet
from ipmclab.sweep.parts import SET, Parts
from ipmclab.sweep.sweep import Sweep

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Distribution:
    """How a metric is distributed over the sets; sets without a reading (NaN) are left out.

    Parameters
    ----------
    smallest, mean, largest, standard_deviation : float [SI]
    missing : int
        Sets without a reading.
    """

    smallest: float
    mean: float
    largest: float
    standard_deviation: float
    missing: int


@dataclass(frozen=True, eq=False)
class Swept:
    """A sweep on the disk.

    Parameters
    ----------
    sweep : Sweep
    parts : Parts
    found : int
        Parts that were there already.
    """

    sweep: Sweep
    parts: Parts
    found: int

    def columns(self, *names: str) -> dict[str, FloatArray]:
        """Some columns as a whole: metrics, parameters, or the number of each ``set``.

        Raises
        ------
        InputError
            An unknown name.
        """
        known = (SET, *self.sweep.design.names, *self.sweep.metrics.names)
        for name in names:
            if name not in known:
                raise InputError(
                    f"no column is called {name!r}", code="unknown-column", where="sweep", repair=suggest(name, known)
                )
        parts = list(self.parts.read(names))
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

    def thinned(self, most: int) -> dict[str, FloatArray]:
        """Parameters and metrics of every so manieth set, at most so many, read part by part."""
        step = max(1, -(-self.parts.count // most))
        names = (*self.sweep.design.names, *self.sweep.metrics.names)
        found: dict[str, list[FloatArray]] = {name: [] for name in names}
        for part, columns in enumerate(self.parts.read(names)):
            first = -self.parts.ends(part)[0] % step
            for name, values in columns.items():
                found[name].append(values[first::step])
        return {name: np.concatenate(values) for name, values in found.items()}

    def distributions(self) -> dict[str, Distribution]:
        """How each metric is distributed, read part by part."""
        names = self.sweep.metrics.names
        return {name: _spread(part[name] for part in self.parts.read([name])) for name in names}

    def indices(self) -> dict[str, dict[str, Index]]:
        """Sobol indices: by metric, then by parameter; empty for a design that does not give them."""
        design = self.sweep.design
        if not isinstance(design, Sampled) or design.kind != "saltelli":
            return {}
        found = {}
        for metric in self.sweep.metrics.names:
            values = self.columns(metric)[metric]
            found[metric] = dict(zip(design.names, sobol_indices(values, len(design.names)), strict=True))
        return found

    def effects(self) -> dict[str, dict[str, Effect]]:
        """Morris's effects: by metric, then by parameter; empty for a design that does not give them."""
        design = self.sweep.design
        if not isinstance(design, Sampled) or design.kind != "morris":
            return {}
        ways, names = design.ways(0, design.count), design.names
        return {
            metric: dict(zip(names, morris_effects(ways, self.columns(metric)[metric], names), strict=True))
            for metric in self.sweep.metrics.names
        }


@tell_kinds
def run_sweep(
    sweep: Sweep,
    folder: str | Path,
    *,
    engine: Engine | None = None,
    progress: OnProgress | None = None,
    device: Device = "auto",
) -> Swept:
    """Simulate what lacks of a sweep, and write it.

    Whatever ends it, a kill of the process or of the machine among it, each file that is there is complete, and the
    next call continues after the last one.

    Parameters
    ----------
    sweep : Sweep
    folder : str or Path
        Made where it is not there; a folder that holds a part of the same sweep is continued.
    engine : Engine, optional
        Who simulates: this process where it is left out. The files are the same, to the last bit.
    progress : function of (str, float), optional
        Called with what is done after each file or chunk; whatever it raises ends the work.
    device : "auto", "cpu" or "gpu"
        As in ``simulate_many``; each worker asks for a GPU of its own machine. The numbers are the same to 1e-12.

    Returns
    -------
    swept : Swept

    Raises
    ------
    InputError
        The folder holds something else, or another program works on it; pyarrow is not installed; a GPU that was
        asked for is not there.
    IpmclabError
        The disk is full; a simulation is not finite.

    Examples
    --------
    >>> import tempfile
    >>> from ipmclab.sweep.sweep_file import sweep_from_text
    >>> from ipmclab.sweep.template import TEMPLATE
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     swept = run_sweep(sweep_from_text(TEMPLATE), Path(folder) / "stiffness")
    ...     again = run_sweep(swept.sweep, swept.parts.folder)
    ...     first = swept.indices()["displacement.peak"]["coupling.gain"].first
    >>> swept.parts.files, swept.found, again.found, round(first, 1)
    (1, 0, 1, 1.0)
    """
    parquet()  # before the long work
    engine = engine or Here()
    device = worth(device, sweep.design.count, len(sweep.record.time))
    if isinstance(engine, Here):
        on_gpu(device)
    parts = Parts(Path(folder), sweep.design.count, sweep.part_size)
    about = {
        "signal": str(sweep.signal),
        "sets": parts.count,
        "sets_per_file": parts.size,
        "metrics": sweep.metrics.names,
    }
    with parts.held(sweep.digest(), about):
        found = parts.done()
        _run(sweep, parts, engine, device, found * parts.size, progress or (lambda *_: None))
    return Swept(sweep, parts, found)


def _run(sweep: Sweep, parts: Parts, engine: Engine, device: Device, done: int, on_progress: OnProgress) -> None:
    """Simulate what lacks; so many sets are done."""
    pace = pace_of(sweep)
    filling = Filling(parts)
    said = partial(_say, on_progress, parts)
    said(done)
    work = partial(measure, device=device)
    for _, measured in engine.map(work, without_values(sweep), chunks(sweep, parts, pace, engine)):
        begin, end = measured.chunk
        for part, metrics in filling.take(measured):
            parts.write(part, {**sweep.design.sets(*parts.ends(part)), **metrics})
        pace.learn(end - begin, measured.seconds)
        done += end - begin
        said(done)


def _say(on_progress: OnProgress, parts: Parts, done: int) -> None:
    on_progress(f"{min(done, parts.count)} of {parts.count} sets", min(done / (parts.size * parts.files), 1.0))


def _spread(parts: Iterator[FloatArray]) -> Distribution:
    """Joined part by part, so that no digit is lost where the mean is far from 0 (Chan, Golub and LeVeque 1983)."""
    count, mean, squares, smallest, largest, missing = 0, 0.0, 0.0, np.inf, -np.inf, 0
    for part in parts:
        values = part[~np.isnan(part)]
        missing += len(part) - len(values)
        if not len(values):
            continue
        own = float(values.mean())
        shift, both = own - mean, count + len(values)
        squares += float(((values - own) ** 2).sum()) + shift**2 * count * len(values) / both
        mean += shift * len(values) / both
        count, smallest, largest = both, min(smallest, float(values.min())), max(largest, float(values.max()))
    if not count:
        return Distribution(np.nan, np.nan, np.nan, np.nan, missing)
    return Distribution(smallest, mean, largest, float(np.sqrt(squares / count)), missing)
