"""Many strips, each fitted to its own runs: fits that know nothing of each other, on whatever engine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ipmclab.engine import Engine, Here
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.fit.interrupted import uninterrupted
from ipmclab.model import Actuator
from ipmclab.prediction.validate import run_labels
from ipmclab.progress import OnProgress
from ipmclab.run import Run
from ipmclab.workflows.fitting import fit_of_runs


@dataclass(frozen=True, eq=False)
class Asked:
    """What every fit is asked for, as ``identify`` takes it.

    Parameters
    ----------
    actuator : Actuator
        From which each fit starts.
    free, per_run, per_mounting, prior : sequence of str
    thorough, anyway : bool
        As ``fit_of_runs`` takes them.
    """

    actuator: Actuator
    free: Sequence[str]
    per_run: Sequence[str] = ()
    per_mounting: Sequence[str] = ()
    prior: Sequence[str] = ()
    thorough: bool = False
    anyway: bool = False


def by_strip(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """Runs by the id of their sample, in the order in which strips first come.

    Raises
    ------
    InputError
        A run that does not say of which strip it is.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ipmclab import Sample, load_actuator, simulate
    >>> run = simulate(load_actuator("friend-2"), "step 1 V", duration=10, rate=20)
    >>> ours = replace(run, metadata=replace(run.metadata, sample=Sample("7")))
    >>> {strip: len(its) for strip, its in by_strip([ours, ours]).items()}
    {'7': 2}
    """
    found: dict[str, list[Run]] = {}
    for label, run in zip(run_labels(runs), runs, strict=True):
        sample = run.metadata.sample
        if sample is None or not sample.id:
            raise InputError(
                "the run does not say which strip it was recorded from",
                code="no-sample",
                where=label,
                repair="give the run a sample with an id, or fit it without --each-strip",
            )
        found.setdefault(sample.id, []).append(run)
    return found


def fit_strips(
    strips: Mapping[str, Sequence[Run]],
    asked: Asked,
    *,
    engine: Engine | None = None,
    progress: OnProgress | None = None,
) -> Iterator[tuple[str, Fit | IpmclabError]]:
    """The fit of each strip as soon as it is there, or the error that it ended in.

    Parameters
    ----------
    strips : mapping of name to sequence of Run
    asked : Asked
    engine : Engine, optional
        Who fits: this process where it is left out. The fits are the same, to the last bit.
    progress : function of (str, float), optional
        Called after each fit.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> runs = {volts: [simulate(strip, f"step {volts} V", duration=10, rate=20)] for volts in ("1", "2")}
    >>> fits = dict(fit_strips(runs, Asked(strip, free=["circuit.dc_resistivity"])))
    >>> [round(fit.parameters["circuit.dc_resistivity"].value, 2) for fit in fits.values()]
    [43.42, 43.42]
    """
    names = list(strips)
    on_progress: OnProgress = progress or (lambda *_: None)
    on_progress(f"0 of {len(names)} strips", 0.0)
    tasks = (strips[name] for name in names)
    for done, (place, found) in enumerate((engine or Here()).map(_fit, asked, tasks), start=1):
        on_progress(f"{done} of {len(names)} strips", done / len(names))
        yield names[place], found


def _fit(asked: Asked, runs: Sequence[Run]) -> Fit | IpmclabError:
    try:
        fit = fit_of_runs(
            asked.actuator,
            runs,
            free=asked.free,
            per_run=asked.per_run,
            per_mounting=asked.per_mounting,
            prior=asked.prior,
            thorough=asked.thorough,
            anyway=asked.anyway,
        )
        return uninterrupted(fit)
    except IpmclabError as error:
        return error
