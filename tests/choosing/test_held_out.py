"""Held-out readings are hidden from the fit, and their density is that of the dense Gaussian."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ipmclab.choosing.blocks import run_blocks, time_blocks
from ipmclab.choosing.held_out import Division, Fold, held_out_rmse, hold_out, judged_held_out, score_blocks
from ipmclab.choosing.noise import FadingNoise, Part
from ipmclab.identification.problem.record import as_read, prepare
from ipmclab.identification.uncertainty import interval
from ipmclab.model import load_actuator
from ipmclab.model.simulate import simulate
from ipmclab.run import Run

SEED, ROWS = 20261121, 90
NOISE = FadingNoise(1.0, (Part(0.3, 0.5),))


def division(*, whole_runs: bool) -> Division:
    generator = np.random.default_rng(SEED)
    time = np.arange(ROWS) * 0.05
    records = [
        prepare(
            Run.from_arrays(
                time=time,
                voltage=np.ones(ROWS),
                current=np.exp(-time) + 0.01 * generator.standard_normal(ROWS),
            ),
            place,
            ["current"],
            [],
        )
        for place in range(2)
    ]
    cut = run_blocks if whole_runs else time_blocks
    return Division(records, cut(records, 8, 2), [(0, "current"), (1, "current")], whole_runs)


def fold_of(divided: Division, columns: int = 0) -> Fold:
    """Residuals, and how far they may be off along some columns."""
    generator = np.random.default_rng([SEED, 1])
    return Fold(
        {key: divided.series(key, 0.1 * generator.standard_normal(ROWS)) for key in divided.keys},
        {key: 0.1 * generator.standard_normal((ROWS, columns)) for key in divided.keys},
        dict.fromkeys(divided.keys, 100.0),
    )


def dense(
    divided: Division, key: tuple[int, str], rows: np.ndarray, residual: np.ndarray, off: np.ndarray | None = None
) -> float:
    """Log density of some rows, from the covariance of every two of them."""
    series = divided.series(key, residual)
    time = series.time[rows]
    matrix = np.diag(np.full(len(time), series.noise**2))
    matrix += (0.3 * series.extent) ** 2 * np.exp(-np.abs(time[:, None] - time) / 0.5)
    if off is not None:
        matrix += off[rows] @ off[rows].T
    return float(multivariate_normal(cov=matrix).logpdf(residual[rows])) if len(time) else 0.0


def test_a_block_of_a_run_is_judged_by_what_was_seen_on_both_sides() -> None:
    divided = division(whole_runs=False)
    folds = (fold_of(divided), fold_of(divided))
    found, _ = score_blocks(folds, divided, {"current": NOISE})
    for number, block in enumerate(divided.blocks):
        key = block.run, "current"
        residual = folds[block.fold].residuals[key].residual
        kept = np.flatnonzero(~divided.held_rows(divided.records[block.run], block.fold))
        both = np.sort(np.concatenate([kept, np.arange(block.start, block.stop)]))
        wanted = dense(divided, key, both, residual) - dense(divided, key, kept, residual)
        assert found.score[number] == pytest.approx(wanted, rel=1e-6, abs=1e-6)


def test_the_blocks_of_a_whole_run_add_up_to_it() -> None:
    divided = division(whole_runs=True)
    folds = (fold_of(divided), fold_of(divided))
    found, _ = score_blocks(folds, divided, {"current": NOISE})
    for place in range(2):
        mine = [number for number, block in enumerate(divided.blocks) if block.run == place]
        series = folds[divided.blocks[mine[0]].fold].residuals[place, "current"]
        wanted = dense(divided, (place, "current"), np.arange(ROWS), series.residual)
        assert found.score[mine].sum() == pytest.approx(wanted, rel=1e-6)


def test_parameters_that_are_not_known_widen_the_prediction() -> None:
    """Of a whole run, and of a block: the dense covariance with the outer product of the columns."""
    divided = division(whole_runs=True)
    folds = (fold_of(divided, 3), fold_of(divided, 3))
    found, _ = score_blocks(folds, divided, {"current": NOISE})
    mine = [number for number, block in enumerate(divided.blocks) if block.run == 0]
    number = divided.blocks[mine[0]].fold
    fold, key, other = folds[number], (0, "current"), (1, "current")
    # The sandwich, from the dense covariance of what the fit saw: the other run, and nothing of this one.
    series, slope = fold.residuals[other], fold.slopes[other]
    apart = np.abs(series.time[:, None] - series.time)
    matrix = (0.3 * series.extent) ** 2 * np.exp(-apart / 0.5) + np.diag(np.full(ROWS, series.noise**2))
    inverse = np.linalg.inv(slope.T @ slope)
    covariance = inverse @ slope.T @ matrix @ slope @ inverse
    off = fold.slopes[key] @ np.linalg.cholesky(covariance)
    wanted = dense(divided, key, np.arange(ROWS), fold.residuals[key].residual, off)
    assert found.score[mine].sum() == pytest.approx(wanted, rel=1e-6)


def test_what_the_parameters_of_a_fold_may_be_off_by_is_no_noise() -> None:
    """A fit that hardly saw an edge is wrong at each edge of the run that was held out, and as sure of all else.

    Along a valley it may be wrong by a hundred of its standard errors: by how many is luck.
    """
    divided = division(whole_runs=True)
    edges = np.exp(-20.0 * (np.arange(ROWS) * 0.05 % 1.0))[:, None]
    scores = []
    for size in (0.0, 0.2, 20.0):
        folds = []
        for number in range(2):
            noise = np.random.default_rng([SEED, number]).standard_normal((2, ROWS))
            held = {block.run for block in divided.blocks if block.fold == number}
            residuals = {
                key: divided.series(key, 0.01 * noise[key[0]] + size * edges[:, 0] * (key[0] in held))
                for key in divided.keys
            }
            slopes = {key: edges * (1.0 if key[0] in held else 0.03) for key in divided.keys}
            folds.append(Fold(residuals, slopes, dict.fromkeys(divided.keys, 100.0)))
        noise_of, said, _ = judged_held_out(folds, divided)
        assert noise_of["current"].parts == ()
        scores.append(float(said.score.sum()))
    assert scores[1] == pytest.approx(scores[0], abs=4.0)
    assert scores[2] == pytest.approx(scores[0], abs=20.0)


@pytest.mark.parametrize("whole_runs", [False, True])
def test_profiles_are_followed_only_where_somebody_reads_them(
    whole_runs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether a run alone determines a stage is asked of whole runs; they were half of the time of every choice."""
    strip, walked = load_actuator("friend-2"), []
    walk = interval.Walk
    monkeypatch.setattr(interval, "Walk", lambda *given, **named: walked.append(1) or walk(*given, **named))
    generator = np.random.default_rng(SEED)
    runs = []
    for signal in ("step 1 V delay=1 s", "square 1 V 0.2 Hz"):
        clean = simulate(strip, signal, duration=10.0, rate=25.0)
        current = clean.current + 1e-3 * generator.standard_normal(len(clean))
        runs.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current))
    records = [prepare(run, place, ["current"], []) for place, run in enumerate(runs)]
    cut = run_blocks if whole_runs else time_blocks
    divided = Division(records, cut(records, 8, 2), [(0, "current"), (1, "current")], whole_runs)
    hold_out(strip, runs, divided, ["electrical"], [], 0)
    assert bool(walked) is whole_runs


def test_what_is_held_out_is_hidden_and_its_voltage_is_not() -> None:
    divided = division(whole_runs=False)
    record = divided.records[0]
    held = divided.held_rows(record, 0)
    run = as_read(record, held)
    assert np.isnan(run.current[held]).all()
    assert np.array_equal(run.current[~held], record.run.current[~held])
    assert np.array_equal(run.voltage, record.run.voltage)
    assert np.array_equal(run.time, record.run.time)


@pytest.mark.parametrize("whole_runs", [False, True])
def test_held_out_errors_are_those_of_the_fits_that_did_not_see_the_rows(whole_runs: bool) -> None:
    divided = division(whole_runs=whole_runs)
    folds = []
    for number in range(divided.folds):
        errors = {
            (place, output): np.where(divided.held_rows(divided.records[place], number), 1e-3 * (1 + place), 7.0)
            for place, output in divided.keys
        }
        folds.append(Fold({key: divided.series(key, error) for key, error in errors.items()}, {}, {}))
    # As many rows are off by 1 mA as by 2 mA.
    assert held_out_rmse(folds, divided)["current"] == pytest.approx(1e-3 * np.sqrt((1.0 + 4.0) / 2.0))
