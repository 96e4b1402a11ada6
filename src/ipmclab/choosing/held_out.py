"""Fit a model without some readings, and see what it says of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.choosing.blocks import Block
from ipmclab.choosing.compare import HeldOut
from ipmclab.choosing.kernels import filter_covariance
from ipmclab.choosing.noise import FadingNoise, Filtered, ResidualSeries, fit_noise
from ipmclab.choosing.spread import directions, slopes
from ipmclab.errors import IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.identification.identify import identify_freed
from ipmclab.identification.problem.free import parse_free
from ipmclab.identification.problem.record import PreparedRun, as_read
from ipmclab.model import Actuator
from ipmclab.prediction.fitted import fitted_outputs
from ipmclab.prediction.scores import Comparison
from ipmclab.prediction.validate import validate
from ipmclab.run import Run

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]
Key = tuple[int, str]
"""Place of a run, and an output."""

_Explained = Mapping[tuple[int, str], FloatArray]
"""Of the number of a block, and an output: what its errors have along what the parameters may be off [SI]."""

_AGAIN: Final = 3  # times that the noise is sought in what the parameters leave (a limit)
_WIDER: Final = 2.0  # times as wide, at each step of the search for how far parameters are off (convention)
_WIDENED: Final = 8  # such steps at most (a limit)
_SEEN: Final = 1e-6  # of the largest: how far errors move along slopes that are more than rounding


@dataclass(frozen=True, eq=False)
class Division:
    """The runs, and how they are divided.

    Parameters
    ----------
    records : sequence of PreparedRun
        With every output that some model reads.
    blocks : sequence of Block
    keys : sequence of (place, output)
        What is scored: the outputs of each run that every model reads.
    whole_runs : bool
        Whether the fit never sees anything of a run that is held out.
    """

    records: Sequence[PreparedRun]
    blocks: Sequence[Block]
    keys: Sequence[Key]
    whole_runs: bool

    @property
    def outputs(self) -> tuple[str, ...]:
        """What is scored, of any run."""
        return tuple(dict.fromkeys(output for _, output in self.keys))

    def outputs_of(self, place: int) -> list[str]:
        """What is scored of one run."""
        return [output for of_run, output in self.keys if of_run == place]

    @property
    def folds(self) -> int:
        """How often each model is fitted to a part."""
        return 1 + max(block.fold for block in self.blocks)

    def held_rows(self, record: PreparedRun, fold: int) -> npt.NDArray[np.bool_]:
        """Which rows of a run a fold holds out."""
        held = np.zeros(len(record.run), dtype=bool)
        for block in self.blocks:
            if block.run == record.place and block.fold == fold:
                held[block.start : block.stop] = True
        return held

    def series(self, key: Key, residual: FloatArray) -> ResidualSeries:
        """A residual with the yardsticks of its record, which are the same for every model."""
        record = self.records[key[0]]
        reading = record.readings[key[1]]
        extent = float(np.ptp(reading.measured)) or 1.0
        return ResidualSeries(
            time=record.run.time,
            residual=np.where(reading.exact, residual, 0.0),
            observed=reading.exact,
            noise=max(reading.noise, 1e-9 * extent),
            extent=extent,
        )

    def indices(self) -> tuple[IndexArray, IndexArray]:
        """The block of each held-out reading, in the order of ``HeldOut``, and the run of each block."""
        block_of = [
            np.full(
                int(np.count_nonzero(self.records[block.run].readings[output].exact[block.start : block.stop])),
                number,
                dtype=np.intp,
            )
            for number, block in enumerate(self.blocks)
            for output in self.outputs_of(block.run)
        ]
        return np.concatenate(block_of), np.array([block.run for block in self.blocks], dtype=np.intp)


Residuals = Mapping[Key, ResidualSeries]


@dataclass(frozen=True, eq=False)
class Fold:
    """What the fit without one fold says.

    Parameters
    ----------
    residuals : mapping of (place, output) to ResidualSeries
        In the rows that the fit saw and in those that it did not.
    slopes : mapping of (place, output) to float array, shape (n_time, n_parameter) [SI]
        How its prediction moves with its parameters.
    weights : mapping of (place, output) to float [1/SI]
        What the fit gave to each reading of what it saw.
    left_open : tuple of str
        The parameters that what it saw does not determine.
    """

    residuals: Residuals
    slopes: Mapping[Key, FloatArray]
    weights: Mapping[Key, float]
    left_open: tuple[str, ...] = ()


def hold_out(
    actuator: Actuator, runs: Sequence[Run], division: Division, free: Sequence[str], per_run: Sequence[str], fold: int
) -> Fold:
    """Fit a model to everything but one fold, and see what it leaves of every reading.

    A row is held out by taking its readings away; its time and its voltage stay, so that the model arrives at
    the next row with its whole history.

    Returns
    -------
    fold : Fold
    """
    held = [division.held_rows(record, fold) for record in division.records]
    kept = [place for place in range(len(runs)) if not (division.whole_runs and held[place].any())]
    part = identify_freed(
        actuator,
        [as_read(division.records[place], held[place]) for place in kept],
        parse_free(actuator.parameter_values, free, per_run, ()),
        [division.records[place].label for place in kept],
        diagnosed=False,
        followed=division.whole_runs,  # what one run alone determines is asked; of blocks nobody reads an interval
    )
    left: dict[Key, ResidualSeries] = {}
    moved: dict[Key, FloatArray] = {}
    weights: dict[Key, float] = {}
    for place, run in enumerate(runs):
        in_fit = kept.index(place) if place in kept else None
        delay: float | None = None
        if in_fit is not None:
            left |= residuals(division, part, run, place, in_fit)
        else:
            validated = validate(part.actuator, [run]).runs[0]
            left |= _series(division, place, validated.comparisons)
            delay = validated.delay
        outputs = division.outputs_of(place)
        found = slopes(part, division.records[place], outputs, in_fit=in_fit, delay=delay)
        moved |= {(place, output): columns for output, columns in found.items()}
        if in_fit is not None:
            weights |= {(place, output): 1.0 / part.observations[in_fit].noise[output] for output in outputs}
    left_open = tuple(name for name, one in part.parameters.items() if not one.determined)
    return Fold(left, moved, weights, left_open)


def residuals(division: Division, fit: Fit, run: Run, place: int, in_fit: int) -> dict[Key, ResidualSeries]:
    """What a fit leaves of a run that it saw, in all its rows; ``in_fit`` is the run's place in that fit."""
    return _series(division, place, fitted_outputs(fit, run, in_fit))


def _series(division: Division, place: int, comparisons: Mapping[str, Comparison]) -> dict[Key, ResidualSeries]:
    found: dict[Key, ResidualSeries] = {}
    label = division.records[place].label
    for output in division.outputs_of(place):
        if output not in comparisons:
            raise IpmclabError(
                f"its fit to a part of the readings leaves the {output} out",
                code="no-readings",
                where=label,
                repair="give runs with more readings of it",
            )
        one = comparisons[output]
        series = division.series((place, output), one.measured - one.predicted)
        lost = np.flatnonzero(~np.isfinite(series.residual))
        if len(lost):
            raise IpmclabError(
                f"it predicts no {output} in {len(lost)} rows that have a reading, the first is row {lost[0]}",
                code="not-finite",
                where=label,
                repair="see that the model holds for this run",
            )
        found[place, output] = series
    return found


def judged_held_out(
    folds: Sequence[Fold], division: Division
) -> tuple[dict[str, FadingNoise], HeldOut, dict[str, float]]:
    """The noise of each output under which the held-out errors of this model are most likely, and what it says of them.

    Last comes the RMSE [SI]; of whole runs of what the errors have not along what the parameters may be off.

    What errors have along what the parameters may be off is no noise: a fit that never saw an edge is wrong at all
    edges of the run that was held out. So the noise is sought again in what that leaves, as long as it makes the
    errors more likely. Of whole runs it is sought from what the slopes leave of them, too: an error of parameters that
    is far larger than all noise would else be taken for noise from the start.
    """
    starts: list[_Explained] = [{}, *([_along_slopes(folds, division)] if division.whole_runs else [])]
    noise, said, explained = max(
        (_judged_from(start, folds, division) for start in starts), key=lambda found: found[1].score.sum()
    )
    # Blocks are of one strip at one time: there an error of the parameters is no luck.
    return noise, said, held_out_rmse(folds, division, explained if division.whole_runs else {})


def _judged_from(
    start: _Explained, folds: Sequence[Fold], division: Division
) -> tuple[dict[str, FadingNoise], HeldOut, _Explained]:
    """The same with the noise first sought in what a start leaves, and what the errors of the parameters explain."""
    noise = _noise_of(folds, division, start)
    said, explained = _most_likely(folds, division, noise)
    for _ in range(_AGAIN):
        other = _noise_of(folds, division, explained)
        there, by_other = _most_likely(folds, division, other)
        if not there.score.sum() > said.score.sum():
            break
        noise, said, explained = other, there, by_other
    return noise, said, explained


def _along_slopes(folds: Sequence[Fold], division: Division) -> _Explained:
    """What of the errors of each run that is held out whole lies along its slopes, by least squares."""
    found: dict[tuple[int, str], FloatArray] = {}
    for number, block in enumerate(division.blocks):
        for output in division.outputs_of(block.run):
            series = folds[block.fold].residuals[block.run, output]
            columns, seen = folds[block.fold].slopes[block.run, output], series.observed
            size = np.sqrt((columns[seen] ** 2).sum(axis=0))
            inside = columns[:, size > 0.0] / size[size > 0.0]
            by = np.linalg.lstsq(inside[seen], series.residual[seen], rcond=_SEEN)[0]
            found[number, output] = (inside @ by)[block.start : block.stop]
    return found


def _most_likely(
    folds: Sequence[Fold], division: Division, noise: Mapping[str, FadingNoise]
) -> tuple[HeldOut, _Explained]:
    """What is said where the parameters of a fold are off by as many times their errors as makes it most likely.

    Along a valley errors are no straight lines: a fit that does not determine a parameter may miss a run by many times
    what they say, and by how many is luck. Of blocks of time the errors are as they are.
    """
    said, explained = score_blocks(folds, division, noise)
    if not division.whole_runs:
        return said, explained
    of_fold = np.array([block.fold for block in division.blocks])
    times, rising = np.ones(len(folds)), np.ones(len(folds), dtype=bool)
    for _ in range(_WIDENED):
        there, wider = score_blocks(folds, division, noise, np.where(rising, _WIDER, 1.0) * times)
        gained = np.bincount(of_fold, there.score - said.score, minlength=len(folds))
        rising &= gained > 0.0
        if not rising.any():
            break
        times[rising] *= _WIDER
        said, explained = (there, wider) if rising.all() else score_blocks(folds, division, noise, times)
    return said, explained


def _noise_of(folds: Sequence[Fold], division: Division, explained: _Explained) -> dict[str, FadingNoise]:
    return {output: fit_noise(_held_out(folds, division, output, explained)) for output in division.outputs}


def held_out_rmse(
    folds: Sequence[Fold], division: Division, explained: _Explained = MappingProxyType({})
) -> dict[str, float]:
    """Root mean square of the held-out errors of each output, less what explains them [SI]."""
    found = {}
    for output in division.outputs:
        errors = np.concatenate([one.residual[one.observed] for one in _held_out(folds, division, output, explained)])
        found[output] = math.sqrt(float(np.mean(errors**2)))
    return found


def _held_out(folds: Sequence[Fold], division: Division, output: str, explained: _Explained) -> list[ResidualSeries]:
    """The errors of each run, every block from the fit that did not see it, less what explains them."""
    joined = []
    for place in (of_run for of_run, name in division.keys if name == output):
        residual = np.zeros(len(division.records[place].run))
        for number, block in enumerate(division.blocks):
            if block.run == place:
                rows = slice(block.start, block.stop)
                own = folds[block.fold].residuals[place, output].residual[rows]
                residual[rows] = own - explained.get((number, output), 0.0)
        joined.append(division.series((place, output), residual))
    return joined


def score_blocks(
    folds: Sequence[Fold], division: Division, noise: Mapping[str, FadingNoise], times: FloatArray | None = None
) -> tuple[HeldOut, _Explained]:
    """The log predictive density of every block, given the readings that the fit saw.

    The noise is autocorrelated, so what the fit saw before and after a block says something of the noise
    in it: the density of a block is that of the observed readings with the block over that without it.
    A model that bends with a drift gains nothing over one that leaves the drift to the noise. Of a run that was
    held out whole nothing was observed: its blocks follow each other.

    The parameters are not known better than the readings of the fit allow under this noise: along what they may be off,
    the prediction is so much wider, in each fold by so many ``times`` where that is given. Beside the densities comes
    what the errors of each block and output have along it, as far as they show it [SI].
    """
    off_by = [_off_by(fold, place, division, noise) for place, fold in enumerate(folds)]
    if times is not None:
        off_by = [factor * own for factor, own in zip(times, off_by, strict=True)]
    scores = np.zeros(len(division.blocks))
    innovation: list[FloatArray] = []
    variance: list[FloatArray] = []
    known: dict[tuple[int, Key], Filtered] = {}
    learned: dict[int, tuple[FloatArray, FloatArray]] = {}
    along: dict[tuple[int, str], tuple[int, FloatArray]] = {}
    for number, block in enumerate(division.blocks):
        fold = folds[block.fold]
        held = division.held_rows(division.records[block.run], block.fold)
        here = np.zeros(len(held), dtype=bool)
        here[block.start : block.stop] = True
        for output in division.outputs_of(block.run):
            key = block.run, output
            series, columns = fold.residuals[key], fold.slopes[key] @ off_by[block.fold]
            if (block.fold, key) not in known:
                known[block.fold, key] = (
                    noise[output].filter(series, columns=columns)
                    if division.whole_runs
                    else noise[output].filter(series, series.observed & ~held)
                )
            filtered, rows = known[block.fold, key], here & series.observed
            if division.whole_runs:
                error, variances = filtered.innovation[rows], filtered.variance[rows]
                scores[number] -= 0.5 * float(np.sum(np.log(2.0 * np.pi * variances) + error**2 / variances))
            else:
                before = filtered.total
                columns[~here] = 0.0
                filtered = noise[output].filter(series, series.observed & (~held | here), columns)
                scores[number] += filtered.total - before
            deviation = np.sqrt(filtered.variance[rows])
            white, count = filtered.whitened[rows], columns.shape[1]
            at = block.run if division.whole_runs else -1 - number
            mean, root = learned.setdefault(at, (np.zeros(count), np.eye(count)))
            left, widened = np.empty(len(deviation)), np.empty(len(deviation))
            scores[number] += filter_covariance(filtered.innovation[rows] / deviation, white, mean, root, left, widened)
            innovation.append(left * deviation)
            variance.append(widened * deviation**2)
            along[number, output] = at, columns[block.start : block.stop]
    explained = {key: columns @ learned[at][0] for key, (at, columns) in along.items()}
    return HeldOut(scores, np.concatenate(innovation), np.concatenate(variance)), explained


def _off_by(fold: Fold, number: int, division: Division, noise: Mapping[str, FadingNoise]) -> FloatArray:
    """The errors of a fold's parameters, from what its fit saw."""
    observed = []
    for key, weight in fold.weights.items():
        series = fold.residuals[key]
        held = division.held_rows(division.records[key[0]], number)
        observed.append((replace(series, observed=series.observed & ~held), fold.slopes[key], weight, noise[key[1]]))
    return directions(observed)
