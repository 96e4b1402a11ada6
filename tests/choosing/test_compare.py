"""The standard error of a difference: what it says happens as often as it says."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from ipmclab.choosing.compare import HeldOut, difference

SEED, BLOCKS, ROWS = 20261121, 24, 40
BLOCK_OF = np.repeat(np.arange(BLOCKS), ROWS)
ONE_RUN = np.zeros(BLOCKS, dtype=np.intp)


def said(error: np.ndarray, size: float = 1.0) -> HeldOut:
    """A model that is off by this much, and takes its errors as independent."""
    density = -0.5 * ((error / size) ** 2 + np.log(2.0 * np.pi * size**2))
    return HeldOut(np.bincount(BLOCK_OF, density), error, np.full(len(error), size**2))


def slow(generator: np.random.Generator, rows: int, decay: float) -> np.ndarray:
    """Noise of variance 1 that is autocorrelated."""
    found = generator.standard_normal(rows)
    for row in range(1, rows):
        found[row] = decay * found[row - 1] + np.sqrt(1.0 - decay**2) * found[row]
    return found


@pytest.mark.parametrize("decay", [0.0, 0.9], ids=["white", "correlated"])
def test_two_equally_wrong_models_are_told_apart_at_the_nominal_rate(decay: float) -> None:
    """Also where the noise that both assume is wrong: the blocks scatter more, and the error follows."""
    generator = np.random.default_rng(SEED)
    shape = 0.3 * np.sin(np.arange(len(BLOCK_OF)) / 7.0)
    trials, told = 400, 0
    for _ in range(trials):
        noise = slow(generator, len(BLOCK_OF), decay)
        found = difference(("A", said(noise + shape)), ("B", said(noise - shape)), BLOCK_OF, ONE_RUN)
        told += found.is_distinguished
    # 5 % of 400 are 20, with a standard deviation of 4.4.
    assert told <= 20 + 3 * 4.4


def test_the_error_is_that_of_a_difference_of_gaussians() -> None:
    """White noise and a known shape between the models: the variance of the difference is the sum of its squares."""
    generator = np.random.default_rng(SEED)
    shape = np.full(len(BLOCK_OF), 0.2)
    errors, values = [], []
    for _ in range(300):
        noise = generator.standard_normal(len(BLOCK_OF))
        found = difference(("A", said(noise)), ("B", said(noise + shape)), BLOCK_OF, ONE_RUN)
        errors.append(found.standard_error)
        values.append(found.value)
    whole = float(shape @ shape)
    assert np.mean(values) == pytest.approx(0.5 * whole, abs=4.0 * np.sqrt(whole / 300))
    assert np.std(values) == pytest.approx(np.sqrt(whole), rel=0.15)
    assert np.std(values) <= np.mean(errors) <= 1.3 * np.std(values)


def test_models_that_say_the_same_are_not_told_apart() -> None:
    noise = np.random.default_rng(SEED).standard_normal(len(BLOCK_OF))
    same = difference(("A", said(noise)), ("B", said(noise)), BLOCK_OF, ONE_RUN)
    nearly = difference(("A", said(noise)), ("B", said(noise * (1.0 + 1e-9))), BLOCK_OF, ONE_RUN)
    assert not same.is_distinguished
    assert not nearly.is_distinguished
    assert str(nearly).startswith("These records cannot distinguish A from B")


def test_a_wide_and_a_narrow_model_are_told_apart() -> None:
    """A model that is far too sure of itself, or far too unsure, loses by what the blocks agree on."""
    noise = np.random.default_rng(SEED).standard_normal(len(BLOCK_OF))
    found = difference(("A", said(noise)), ("B", said(noise, 1000.0)), BLOCK_OF, ONE_RUN)
    assert found.is_distinguished
    assert found.value > 0.0


def test_one_reading_of_which_a_model_knows_nothing_does_not_hide_what_all_others_say() -> None:
    """Beside a step a larger model can be a thousand times as unsure of one reading; it made the error 2800 nats."""
    noise = np.random.default_rng(SEED).standard_normal(len(BLOCK_OF))
    sizes = np.ones(len(BLOCK_OF))
    sizes[137] = 1000.0

    def scored(error: np.ndarray, size: np.ndarray) -> HeldOut:
        density = -0.5 * ((error / size) ** 2 + np.log(2.0 * np.pi * size**2))
        return HeldOut(np.bincount(BLOCK_OF, density), error, size**2)

    found = difference(("A", scored(noise, sizes)), ("B", said(noise + 0.5)), BLOCK_OF, ONE_RUN)
    assert found.is_distinguished
    assert found.value > 0.0


def test_one_of_four_runs_against_three_is_no_proof() -> None:
    """What differs between runs counts: a model that is better in half of the runs is not better."""
    generator = np.random.default_rng(SEED)
    runs = np.repeat(np.arange(4), BLOCKS // 4)
    sign = np.where(np.isin(runs, (0, 2)), 1.0, -1.0)[BLOCK_OF]
    noise = generator.standard_normal(len(BLOCK_OF))
    better, worse = np.where(sign > 0, noise, noise + 0.6), np.where(sign > 0, noise + 0.7, noise)
    found = difference(("A", said(better)), ("B", said(worse)), BLOCK_OF, runs)
    assert not found.is_distinguished


def test_the_standard_error_counts_how_neighbouring_blocks_follow_each_other() -> None:
    """Errors that keep half of the last one: their sum scatters by the root of three times what independent ones' does.

    Bartlett's weights of 400 blocks find 2.5 of these 3.
    """
    generator, blocks, apart = np.random.default_rng(20261121), 400, 0.3
    block_of, one_run = np.arange(blocks), np.zeros(blocks, dtype=int)
    sums, errors = [], []
    for _ in range(400):
        error = scipy.signal.lfilter([np.sqrt(0.75)], [1.0, -0.5], generator.standard_normal(blocks + 50))[50:]
        right, wrong = (HeldOut(-0.5 * said**2, said, np.ones(blocks)) for said in (error, error + apart))
        found = difference(("right", right), ("wrong", wrong), block_of, one_run)
        sums.append(found.value)
        errors.append(found.standard_error)
    assert np.mean(errors) == pytest.approx(np.std(sums), rel=0.15)
