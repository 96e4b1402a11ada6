"""Noise that grows with the answer: how it is found in residuals, without any fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import chi2, rankdata

from ipmclab.identification.noise.growing import Growth, _ranks, growth
from ipmclab.identification.noise.unseen import _chance
from ipmclab.identification.problem.record import Reading

SEED = 20261121
KEY = (0, "current")
FloatArray = npt.NDArray[np.float64]


def found(answer: FloatArray, residual: FloatArray, measured: npt.NDArray[np.bool_] | None = None) -> Growth | None:
    """Of residuals in units of a noise of 0.5, the model's answer being the reading and what it misses."""
    exact = np.ones(len(answer), dtype=bool) if measured is None else measured
    side = np.where(exact, 0, 1).astype(np.int8)
    reading = Reading(answer - 0.5 * residual, np.ones(len(answer), dtype=bool), side, 0.5)
    problem = SimpleNamespace(pieces={KEY: slice(0, len(answer))}, noise={KEY: 0.5}, readings={KEY: reading})
    evaluation = SimpleNamespace(residual=residual)
    fit: Any = SimpleNamespace(problem=problem, plain=evaluation, whitened=evaluation)
    return growth(fit, KEY)


def test_equal_values_share_the_mean_of_their_ranks() -> None:
    """So that many equal answers, of a voltage that stays, are no growth and hide none."""
    values = np.random.default_rng(SEED).integers(0, 9, 100).astype(float)
    np.testing.assert_array_equal(_ranks(values), rankdata(values))


@pytest.mark.parametrize("scale", [1.0, -1e-4])
def test_the_variance_of_each_row_is_found(scale: float) -> None:
    """Of ``9 (1 + 8 y^2)``, whatever the sign and the unit of the answer; bounds stay out."""
    generator = np.random.default_rng(SEED)
    part = np.append(0.0, generator.uniform(0.0, 1.0, 3999))
    answer, variance = scale * part, 9.0 * (1.0 + 8.0 * part**2)
    residual = np.sqrt(variance) * generator.standard_normal(4000)
    measured = np.arange(4000) % 10 != 1
    one = found(answer, residual, measured)
    assert one is not None
    assert one.times == pytest.approx(3.0, rel=0.1)
    assert one.variance[measured] == pytest.approx(variance[measured], rel=0.2)
    assert np.all(one.variance[~measured] == 1.0)


def test_noise_of_one_size_or_that_shrinks_or_of_few_rows_does_not_grow() -> None:
    generator = np.random.default_rng(SEED)
    answer = generator.uniform(0.0, 1.0, 1000)
    noise = generator.standard_normal(1000)
    assert found(answer, noise) is None
    assert found(answer, noise * (2.0 - answer)) is None
    assert found(np.zeros(1000), noise) is None
    steep = noise * (0.01 + answer)
    assert found(answer[:49], steep[:49]) is None
    assert found(answer[:50], steep[:50]) is not None


def test_of_a_step_the_few_large_answers_tell() -> None:
    """Noise that is larger in some 30 of 1,500 rows: the ranks of all answers showed it in none of 60."""
    answer = 0.06 + np.exp(-np.arange(1500) / 12.0) + 0.02 * np.exp(-np.arange(1500) / 600.0)
    generator = np.random.default_rng(SEED)
    even = [generator.standard_normal(1500) for _ in range(200)]
    growing = [found(answer, np.hypot(1.0, 4.0 * answer) * noise) for noise in even[:60]]
    assert sum(one is not None for one in growing) >= 36
    assert not [noise for noise in even if found(answer, noise) is not None]


def chance(cost: float, lost: float, *, rows: int = 103, times: float = 1.0) -> float:
    """Of a stage of two parameters, where three are found."""

    def solution(power: float, residual: float) -> Any:
        every = np.full(rows, residual)
        evaluation = SimpleNamespace(residual=every, of_readings=every, cost=power)
        return SimpleNamespace(theta=np.zeros(3), evaluation=evaluation)

    under: Any = SimpleNamespace(inflation=lambda change: times * float(change[0]))
    return _chance(under, solution(cost, 2.0), solution(cost + lost, 3.0), 2)


def test_leaving_a_stage_out_is_as_rare_as_chi_square_says() -> None:
    for lost in (0.0, 1.0, 13.8):
        assert chance(200.0, lost) == pytest.approx(chi2.sf(lost / 2.0, 2))
        assert chance(2.0, 0.01 * lost) == pytest.approx(chi2.sf(lost / 2.0, 2))
    for rows in (3, 4):  # at least one reading is left to tell the noise by
        assert chance(2.0, 3.0, rows=rows) == pytest.approx(chi2.sf(1.5, 2))
    # Noise that hangs together loses as much more easily; a better point is no loss.
    assert chance(200.0, 13.8, times=4.0) == pytest.approx(chi2.sf(13.8 / 8.0, 2))
    assert chance(200.0, -1.0) == 1.0


def test_where_nothing_is_left_any_loss_is_one() -> None:
    """Of readings that the model meets to the last digit."""
    assert chance(0.0, 0.0) == 1.0
    assert chance(0.0, 1e-12) == 0.0
