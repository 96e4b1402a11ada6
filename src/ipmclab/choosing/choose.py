"""Which of several models the runs call for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ipmclab.choosing.blocks import run_blocks, time_blocks
from ipmclab.choosing.choice import UNFINISHED, Candidate, Choice, HoldOut
from ipmclab.choosing.compare import HeldOut
from ipmclab.choosing.held_out import (
    Division,
    Fold,
    held_out_rmse,
    hold_out,
    judged_held_out,
)
from ipmclab.choosing.models import FEWEST, free_of, named_models, refuse_unknown, words_of
from ipmclab.choosing.ranking import none_compared, ranked_choice
from ipmclab.choosing.stages_shown import differing_stages, shown_in_one, stages_held
from ipmclab.engine import Engine, Here
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.fit.interrupted import uninterrupted
from ipmclab.identification.identify import identify
from ipmclab.identification.problem.record import READ_OUTPUTS, prepare
from ipmclab.kinds import tell_kinds
from ipmclab.model import Actuator
from ipmclab.one_thread import on_one_thread
from ipmclab.prediction.validate import run_labels
from ipmclab.quality import check
from ipmclab.run import Run

BLOCKS: Final = 24
"""Blocks whose differences are compared: enough for a standard error, and each still a piece of a response."""

FOLDS: Final = 6
"""Parts in which blocks are held out together."""

OnProgress = Callable[[str, int, int], None]

_FAULTS: Final = (ArithmeticError, ValueError, np.linalg.LinAlgError)
"""What a fit of an unsuitable model may end in, in addition to our own errors."""


@tell_kinds
@on_one_thread
def choose(
    runs: Sequence[Run] | Run,
    models: str | Iterable[str | Actuator],
    *,
    actuator: str | Actuator | None = None,
    free: str | Iterable[str] = (),
    per_run: str | Iterable[str] = (),
    held_out: HoldOut | None = None,
    blocks: int = BLOCKS,
    folds: int = FOLDS,
    labels: Sequence[str] | None = None,
    engine: Engine | None = None,
    progress: OnProgress | None = None,
) -> Choice:
    """Fit several models, and rank them by how likely they make readings that they did not see.

    Parameters
    ----------
    runs : sequence of Run
    models : str, or sequence of str or Actuator
        Names as on the command line: actuators, variants (``friend-2+leak.cubic``), or stages of ``actuator``.
    actuator : str or Actuator, optional
        What stages are added to.
    free : str or iterable of str
        As in ``identify``; a name that only some of the models have is freed in those. By default everything in the
        groups of a model's stages.
    per_run : str or iterable of str
        As in ``identify``.
    held_out : "runs" or "blocks", optional
        Whole runs (the default for two or more), or blocks of time of every run.
    blocks : int
        How many blocks are compared, about.
    folds : int
        How often each model is fitted without a part, at most.
    labels : sequence of str, optional
        A short name for each run.
    engine : Engine, optional
        Who fits: this process where it is left out. The answer is the same, to the last bit.
    progress : function of (str, int, int), optional
        Called before each fit with what is fitted, how many fits are done, and of how many.

    Returns
    -------
    choice : Choice

    Raises
    ------
    InputError
        No runs, no models, an unknown name, a number out of range, whole runs to hold out of one run. Not for a model
        whose stages do not go together: that one comes last, with its reason.
    IpmclabError
        None of the models could be compared.
    KeyboardInterrupt
        Ctrl-C before two models were finished. Later those that were finished are compared, and
        ``unfinished`` names the others.

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab import Run, load_actuator, simulate
    >>> clean = simulate(load_actuator("friend-2"), "step 1 V", duration=20, rate=50)
    >>> noise = 1e-4 * np.random.default_rng(20261121).standard_normal(1000)
    >>> run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
    >>> choose(run, "branches=1,2", actuator="friend-2").preferred
    'branches=2'
    """
    given = [runs] if isinstance(runs, Run) else list(runs)
    named = named_models(models, actuator)
    _refuse(given, blocks, folds, held_out)
    asked, own = words_of(free), words_of(per_run)
    built = [(name, model) for name, model in named if isinstance(model, Actuator)]
    candidates = {name: Candidate(name, reason=str(fault)) for name, fault in named if isinstance(fault, InputError)}
    if not built:
        raise none_compared(candidates)
    refuse_unknown((*asked, *own), [model for _, model in built])
    whole_runs = len(given) > 1 if held_out is None else held_out == "runs"
    run_names = list(labels) if labels is not None else run_labels(given)
    channels = {name for run in given for name in READ_OUTPUTS if name in run.channels}
    each = min(folds, len(given)) if whole_runs else folds
    count, done = len(built) * (1 + each), 0
    place_of = {name: f"model {place} of {len(built)}" for place, (name, _) in enumerate(built, start=1)}

    def on_progress(name: str, what: str) -> bool:
        nonlocal done
        if progress is not None:
            progress(f"{place_of[name]}: {name}, {what}", done, count)
        done += 1
        return True

    by, every = engine or Here(), _Given(given, run_names)
    tasks = [_Asked(name, model, free_of(model, channels, asked), _own(model, own)) for name, model in built]
    candidates |= {one.name: Candidate(one.name, free=one.free) for one in tasks}  # in the order in which they came
    for place, fit in by.map(_fit_all, every, (one for one in tasks if on_progress(one.name, "all runs"))):
        one = candidates[tasks[place].name]
        done += each if isinstance(fit, str) else 0
        candidates[one.name] = (
            replace(one, reason=fit) if isinstance(fit, str) else replace(one, fit=fit, parameters=len(fit.parameters))
        )
    division, unscored = _divide(given, run_names, candidates, whole_runs=whole_runs, blocks=blocks, folds=each)
    said: dict[str, HeldOut] = {}
    difference = differing_stages(dict(built))
    fitted = [one for one in tasks if candidates[one.name].fit is not None]
    try:
        for name, parts in _folds(by, replace(every, division=division), fitted, on_progress):
            if isinstance(parts, str):
                candidates[name] = replace(candidates[name], reason=f"without a part of the readings: {parts}")
            else:
                candidates[name], said[name] = _judged(candidates[name], parts, division, difference[name])
    except KeyboardInterrupt:
        if len(said) < FEWEST:
            raise
        candidates |= {
            name: replace(one, reason=UNFINISHED, log_predictive=None)
            for name, one in candidates.items()
            if name not in said and not one.reason
        }
    said = {name: said[name] for name in candidates if name in said}
    for name, stages in stages_held(dict(built), {name: candidates[name].free for name, _ in built}).items():
        candidates[name] = replace(candidates[name], held=stages)
    return ranked_choice(given, candidates, said, division, unscored, run_names)


def _judged(
    one: Candidate, parts: Sequence[Fold], division: Division, stages: Sequence[str]
) -> tuple[Candidate, HeldOut]:
    """A model with what it says of the readings that were held out; ``stages`` are those that not every model has."""
    assert one.fit is not None
    noise, said, left = judged_held_out(parts, division)
    judged = replace(
        one,
        log_predictive=float(said.score.sum()),
        rmse=held_out_rmse(parts, division),
        rmse_left=left,
        noise=noise,
        shown_in_one=shown_in_one(one.fit, stages, parts, division),
    )
    return judged, said


@dataclass(frozen=True, eq=False)
class _Given:
    """What all fits share."""

    runs: Sequence[Run]
    labels: Sequence[str]
    division: Division | None = None


@dataclass(frozen=True, eq=False)
class _Asked:
    """One fit: of a model, to everything or to everything but a fold."""

    name: str
    model: Actuator
    free: tuple[str, ...]
    per_run: Sequence[str]
    fold: int = 0


def _fit_all(given: _Given, asked: _Asked) -> Fit | str:
    """The fit of a model to everything, or why there is none."""
    try:
        fit = identify(asked.model, given.runs, free=asked.free, per_run=asked.per_run, labels=given.labels)
    except (IpmclabError, *_FAULTS) as fault:
        return _why(fault)
    return uninterrupted(fit)  # who interrupts a choice does not mean the last question of one of its fits


def _fit_without(given: _Given, asked: _Asked) -> Fold | str:
    """What the fit of a model to everything but a fold says, or why there is none."""
    assert given.division is not None
    try:
        return hold_out(asked.model, given.runs, given.division, asked.free, asked.per_run, asked.fold)
    except (IpmclabError, *_FAULTS) as fault:
        return _why(fault)


def _folds(
    engine: Engine, given: _Given, fitted: Sequence[_Asked], on_progress: Callable[[str, str], bool]
) -> Iterator[tuple[str, tuple[Fold, ...] | str]]:
    """Each model with what it says without each fold, as soon as all of that is there; or why there is something not.

    Of a model that has failed in one fold no other is begun.
    """
    assert given.division is not None
    count, failed = given.division.folds, set()
    begun: list[_Asked] = []
    parts: dict[str, dict[int, Fold]] = {one.name: {} for one in fitted}

    def tasks() -> Iterator[_Asked]:
        for one in fitted:
            for fold in range(count):
                if one.name not in failed and on_progress(one.name, f"part {fold + 1} of {count} held out"):
                    begun.append(replace(one, fold=fold))
                    yield begun[-1]

    for place, found in engine.map(_fit_without, given, tasks()):
        name, fold = begun[place].name, begun[place].fold
        if isinstance(found, str):
            if name not in failed:
                failed.add(name)
                yield name, found
            continue
        parts[name][fold] = found
        if len(parts[name]) == count:
            own = parts.pop(name)
            yield name, tuple(own[place] for place in range(count))


def _refuse(runs: Sequence[Run], blocks: int, folds: int, held_out: HoldOut | None) -> None:
    if not runs:
        raise InputError("no runs were given", code="no-runs", where="runs", repair="give at least one run")
    if held_out not in (None, "runs", "blocks"):
        raise InputError(
            f"{held_out!r} cannot be held out",
            code="bad-hold-out",
            where="hold out",
            repair="hold out 'runs' or 'blocks'",
        )
    if held_out == "runs" and len(runs) < 2:
        raise InputError(
            "there is one run: none is left for the fit",
            code="bad-hold-out",
            where="hold out",
            repair="give more runs, or hold out blocks",
        )
    if folds < 2 or blocks < folds:
        raise InputError(
            f"{blocks} blocks in {folds} folds",
            code="bad-folds",
            where="folds",
            repair="give at least 2 folds, and at least as many blocks",
        )


def _own(model: Actuator, words: Sequence[str]) -> list[str]:
    return list(free_of(model, (), words)) if words else []


def _why(fault: Exception) -> str:
    return str(fault) if isinstance(fault, IpmclabError) else f"its fit ended in {type(fault).__name__}: {fault}"


def _divide(
    runs: Sequence[Run],
    labels: Sequence[str],
    candidates: Mapping[str, Candidate],
    *,
    whole_runs: bool,
    blocks: int,
    folds: int,
) -> tuple[Division, tuple[str, ...]]:
    """The blocks, and what of each run is scored: the outputs that every model reads."""
    fits = [one.fit for one in candidates.values() if one.fit is not None]
    if not fits:
        raise none_compared(candidates)
    read = [[set(fit.observations[place].noise) for fit in fits] for place in range(len(runs))]
    keys = [
        (place, output)
        for place in range(len(runs))
        for output in READ_OUTPUTS
        if all(output in outputs for outputs in read[place])
    ]
    if not keys:
        raise IpmclabError(
            "there is no output that every model reads",
            code="nothing-to-compare",
            where="models",
            repair="free parameters of the same stages in each of them",
        )
    some = {output for of_run in read for outputs in of_run for output in outputs}
    records = []
    for place, run in enumerate(runs):
        outputs = [output for output in READ_OUTPUTS if any(output in of_fit for of_fit in read[place])]
        records.append(replace(prepare(run, place, outputs, check(run)), label=labels[place]))
    cut = run_blocks if whole_runs else time_blocks
    found = [block for block in cut(records, blocks, folds) if any(place == block.run for place, _ in keys)]
    return Division(records, found, keys, whole_runs), tuple(sorted(some - {output for _, output in keys}))
