"""The likelihood and the search of correlated noise, against dense covariance matrices and made noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
import scipy.signal
from scipy.linalg import null_space, toeplitz
from scipy.stats import multivariate_normal

from ipmclab.normal_equations import inverse
from ipmclab.statespace.columns import CONSTANTS, Columns, constants, steps_between, whitened, without
from ipmclab.statespace.likelihood import Others, likelihood
from ipmclab.statespace.long_run import long_run
from ipmclab.statespace.noise_model import NoiseModel
from ipmclab.statespace.screen import needs_search
from ipmclab.statespace.search import Allowed, choose_terms, refine, settled
from ipmclab.statespace.shape import Shape, drawn, spread_by, structure
from ipmclab.statespace.terms import Terms, autoregression, state_space
from ipmclab.statespace.whitening import Whitening

SEED = 20261121
STEP = 0.1
Array = npt.NDArray[np.float64]

SHAPES = (
    (Terms(), ()),
    (Terms(1, offset=True), (0.8,)),
    (Terms(walk=True, offset=True), (-1.0,)),
    (Terms(2, offset=True, trend=True), (1.2, -0.4)),
    (Terms(1, white=True, offset=True), (1.5, 0.3)),
    (Terms(2, walk=True, offset=True, trend=True), (1.2, -0.4, -1.0)),
    (Terms(1, walk=True, white=True, offset=True), (1.0, -2.0, 0.3)),
)


def dense(terms: Terms, entries: tuple[float, ...], time: Array) -> Array:
    """The covariance from the definition: impulse responses for the autoregression, min(t, t') for the walk."""
    rows = np.rint((time - time[0]) / STEP).astype(int)
    count = int(rows[-1]) + 1
    if terms.order:
        denominator = np.poly(_roots(np.tanh(np.array(entries[: terms.order]))))
        impulse = scipy.signal.lfilter([1.0], denominator, np.eye(1, 4000)[0])
        lags = [float(impulse[lag:] @ impulse[: len(impulse) - lag]) for lag in range(count)]
        found = toeplitz(lags)
    else:
        found = np.eye(count)
    if terms.walk:
        found = found + math.exp(2.0 * entries[terms.order]) * np.minimum.outer(np.arange(count), np.arange(count))
    if terms.white:
        found = found + math.exp(2.0 * entries[-1]) * np.eye(count)
    return found[np.ix_(rows, rows)]


def _roots(partials: Array) -> Array:
    """Poles of an autoregression of order 1 or 2, from phi2 = kappa2 and phi1 = kappa1 (1 - kappa2)."""
    if len(partials) == 1:
        return partials
    first, second = partials
    return np.roots([1.0, -first * (1.0 - second), -second])


def readings(*, gaps: bool) -> tuple[Array, Columns]:
    generator = np.random.default_rng(SEED)
    rows = np.sort(generator.choice(60, 40, replace=False)) if gaps else np.arange(40)
    time = 3.0 + STEP * rows
    matrix = np.column_stack([constants(time), generator.standard_normal((40, 4))])
    return time, Columns(matrix, steps_between(time, STEP))


@pytest.mark.parametrize("gaps", [False, True], ids=["every row", "gaps"])
@pytest.mark.parametrize(("terms", "entries"), SHAPES, ids=str)
def test_whitening_is_the_inverse_of_the_cholesky_factor(terms: Terms, entries: tuple[float, ...], gaps: bool) -> None:
    time, columns = readings(gaps=gaps)
    factor = np.linalg.cholesky(dense(terms, entries, time))
    found, logarithm = columns.whitened(terms, np.array(entries))
    np.testing.assert_allclose(found, np.linalg.solve(factor, columns.matrix), atol=1e-9)
    assert logarithm == pytest.approx(2.0 * np.log(factor.diagonal()).sum(), abs=1e-8)


@pytest.mark.parametrize(
    ("terms", "column"),
    [
        (Terms(1, trend=True), lambda time: (time - time[0])[:, None]),
        (Terms(1, offset=True), lambda time: np.ones((len(time), 1))),
        (Terms(1, offset=True, trend=True), lambda time: np.column_stack([np.ones(len(time)), time])),
    ],
    ids=["trend", "offset", "both"],
)
def test_a_trend_alone_begins_at_the_first_reading(terms: Terms, column: Callable[[Array], Array]) -> None:
    """An offset that is asked elsewhere is the one there: a trend about the middle would move it too."""
    time, columns = readings(gaps=True)
    entries, others = np.array([0.8]), columns.matrix[:, CONSTANTS:]
    white = np.linalg.cholesky(np.linalg.inv(dense(terms, (0.8,), time))).T
    own = white @ column(time)
    left = white @ others - own @ np.linalg.lstsq(own, white @ others, rcond=None)[0]
    found, _ = without(columns.products(terms, entries)[0], terms)
    np.testing.assert_allclose(found, left.T @ left, rtol=1e-9, atol=1e-9)
    inside = np.ones(len(time), dtype=bool)
    whitening = Whitening.of(terms, entries, 1.0, time, columns.steps, inside)
    rows = whitening.apply(others.T)
    np.testing.assert_allclose(rows @ rows.T, left.T @ left, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("gaps", [False, True], ids=["every row", "gaps"])
@pytest.mark.parametrize(("terms", "entries"), SHAPES, ids=str)
def test_likelihood_is_that_of_the_contrasts(terms: Terms, entries: tuple[float, ...], gaps: bool) -> None:
    """Restricted likelihood: the density of what is left when all unknown constants are projected out."""
    time, columns = readings(gaps=gaps)
    covariance = dense(terms, entries, time)
    held = [column for column, has in enumerate((terms.offset, terms.trend)) if has]
    design = columns.matrix[:, [*held, 2, 3, 4]]
    contrasts = null_space(design.T)
    left = contrasts.T @ columns.matrix[:, -1]

    def minus_twice(variance: float) -> float:
        inside = variance * contrasts.T @ covariance @ contrasts
        return -2.0 * float(multivariate_normal(cov=inside).logpdf(left))

    nothing = np.diag([1e-12, 1e-12, 1e-12, 0.0])
    found = likelihood(columns, Others(nothing), terms, np.array(entries))
    # The density of the contrasts lacks log det X'X and has n - p times log 2 pi more.
    constant = np.linalg.slogdet(design.T @ design)[1] - len(left) * math.log(2.0 * math.pi)
    assert found.deviance == pytest.approx(minus_twice(found.variance) + constant, abs=1e-5)
    assert minus_twice(found.variance) <= min(minus_twice(0.99 * found.variance), minus_twice(1.01 * found.variance))


def test_other_readings_count_in_the_likelihood_as_if_all_were_one() -> None:
    """A second stretch of white readings of the same parameters, through its normal equations or as rows."""
    terms, entries = SHAPES[1]
    time, columns = readings(gaps=True)
    generator = np.random.default_rng(SEED + 1)
    more = generator.standard_normal((25, 4))
    found = likelihood(columns, Others(more.T @ more), terms, np.array(entries))
    covariance = dense(terms, entries, time) * found.variance
    design = np.block([[columns.matrix[:, [0, 2, 3, 4]]], [np.zeros((25, 1)), more[:, :3]]])
    both = np.block([[covariance, np.zeros((40, 25))], [np.zeros((25, 40)), np.eye(25)]])
    contrasts = null_space(design.T)
    left = contrasts.T @ np.concatenate([columns.matrix[:, -1], more[:, -1]])
    density = multivariate_normal(cov=contrasts.T @ both @ contrasts).logpdf(left)
    constant = np.linalg.slogdet(design.T @ design)[1] - len(left) * math.log(2.0 * math.pi)
    assert found.deviance == pytest.approx(-2.0 * float(density) + constant, abs=1e-5)


def test_partial_autocorrelations_make_every_stationary_autoregression() -> None:
    coefficients, covariances = autoregression(np.array([0.9, -0.5, 0.3]))
    impulse = scipy.signal.lfilter([1.0], np.append(1.0, -coefficients), np.eye(1, 3000)[0])
    wanted = [float(impulse[lag:] @ impulse[: len(impulse) - lag]) for lag in range(3)]
    np.testing.assert_allclose(covariances, wanted, rtol=1e-10)
    noise = NoiseModel(step=1.0, driven=2.0, coefficients=tuple(coefficients))
    assert noise.stationary == pytest.approx(4.0 * wanted[0], rel=1e-10)


@pytest.mark.parametrize(("terms", "entries"), SHAPES, ids=str)
def test_the_spread_of_least_squares_is_that_of_the_dense_covariance(terms: Terms, entries: tuple[float, ...]) -> None:
    time, columns = readings(gaps=True)
    stationary = replace(terms, offset=False, trend=False)
    found = spread_by(columns.matrix, columns.steps, Shape(stationary, np.array(entries), 2.0))
    wanted = 2.0 * columns.matrix.T @ dense(stationary, entries, time) @ columns.matrix
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("terms", "entries"), SHAPES, ids=str)
def test_terms_count_and_name_what_they_have(terms: Terms, entries: tuple[float, ...]) -> None:
    assert terms.shapes == len(entries) == len(terms.bounds)
    assert all(low < entry < high for entry, (low, high) in zip(entries, terms.bounds, strict=True))
    words = str(terms)
    assert terms.constants == ("offset" in words) + ("trend" in words)
    assert terms.drifts == ("walk" in words or "trend" in words)
    assert terms.is_white == (words == "white")


@pytest.mark.parametrize(("terms", "entries"), SHAPES, ids=str)
def test_how_far_a_noise_goes_in_some_steps_is_that_of_the_dense_covariance(
    terms: Terms, entries: tuple[float, ...]
) -> None:
    time, _ = readings(gaps=False)
    covariance = 2.0 * dense(terms, entries, time)
    found = structure(Shape(terms, np.array(entries), 2.0), [1, 7])
    wanted = [covariance[0, 0] + covariance[lag, lag] - 2.0 * covariance[0, lag] for lag in (1, 7)]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


@pytest.mark.parametrize(("terms", "entries"), [SHAPES[2], SHAPES[3], SHAPES[6]], ids=str)
def test_draws_have_the_dense_covariance(terms: Terms, entries: tuple[float, ...]) -> None:
    time, columns = readings(gaps=True)
    few, steps = time[:6], columns.steps[:6]
    generator = np.random.default_rng(SEED)
    draws = np.array([drawn(Shape(terms, np.array(entries), 2.0), steps, generator) for _ in range(3000)])
    wanted = 2.0 * dense(terms, entries, few)
    size = np.sqrt(wanted.diagonal())
    assert np.abs((draws.T @ draws / len(draws) - wanted) / np.outer(size, size)).max() < 5.0 * math.sqrt(2.0 / 3000)


@pytest.mark.parametrize(("terms", "entries"), SHAPES, ids=str)
def test_a_noise_model_gives_back_what_it_was_made_of_also_from_its_table(
    terms: Terms, entries: tuple[float, ...]
) -> None:
    made = NoiseModel.of(terms, np.array(entries), 3e-4, 0.02)
    for model in (made, NoiseModel.from_table(made.to_table())):
        assert (model.terms, model.driven, model.step) == (terms, 3e-4, 0.02)
        np.testing.assert_allclose(model.entries, entries, rtol=1e-12)
    covariance = 3e-4**2 * dense(terms, entries, np.arange(3.0, 4.05, STEP))
    np.testing.assert_allclose(made.deviation(np.array([0.0, 0.2])) ** 2, covariance.diagonal()[[0, 10]], rtol=1e-9)


def made(kind: str, rows: int, generator: np.random.Generator) -> Array:
    white = generator.standard_normal(rows)
    if kind == "AR(1)":
        return scipy.signal.lfilter([1.0], [1.0, -0.9], white)
    if kind == "AR(2)":
        return scipy.signal.lfilter([1.0], [1.0, -1.2, 0.5], white)
    if kind == "offset, linear trend, white":
        return white + 3.0 * np.arange(rows) / rows + 1.0
    if kind == "offset, white, random walk":
        return white + 0.1 * np.cumsum(generator.standard_normal(rows))
    return white


@pytest.mark.parametrize(
    "kind", ["white", "AR(1)", "AR(2)", "offset, linear trend, white", "offset, white, random walk"]
)
def test_the_terms_that_made_the_noise_are_found(kind: str) -> None:
    rows = 1500
    generator = np.random.default_rng(SEED)
    time = np.arange(rows) * STEP
    answers = np.column_stack([np.exp(-time / 3.0), np.sin(time)])
    right = 0
    for _ in range(4):
        matrix = np.column_stack([constants(time), answers, made(kind, rows, generator)])
        found = choose_terms(Columns(matrix, steps_between(time, STEP)), np.diag([1e-9, 1e-9, 0.0]), Allowed())
        right += str(found.terms) == kind
    assert right >= 3


def test_white_noise_asks_for_no_search() -> None:
    generator = np.random.default_rng(SEED)
    asked = sum(needs_search(generator.standard_normal(1000), 0.0) for _ in range(300))
    assert asked <= 15
    for kind in ("AR(1)", "AR(2)", "offset, white, random walk"):
        assert needs_search(made(kind, 1000, generator), 0.0)
    assert needs_search(generator.standard_normal(1000), 20.0)


def test_white_noise_is_left_as_it_is() -> None:
    matrix = np.random.default_rng(SEED).standard_normal((20, 3))
    found, logarithm = whitened(state_space(Terms(), np.zeros(0)), matrix, np.ones(20, dtype=np.int64))
    np.testing.assert_array_equal(found, matrix)
    assert logarithm == 0.0


def test_the_long_run_variance_of_an_autoregression() -> None:
    """Of e_k = 0.9 e_(k-1) + white noise of variance 1, the sum over n rows has the variance n/(1 - 0.9)^2."""
    generator, rows = np.random.default_rng(SEED), 20_000
    found = [
        long_run(np.ones((rows, 1)), scipy.signal.lfilter([1.0], [1.0, -0.9], generator.standard_normal(rows)))[0, 0]
        for _ in range(20)
    ]
    assert np.mean(found) == pytest.approx(rows / 0.1**2, rel=0.15)


def test_a_long_run_covariance_is_one() -> None:
    """Symmetric and nowhere negative, also where one column's scores follow the other's a row later."""
    error = scipy.signal.lfilter([1.0], [1.0, -0.8], np.random.default_rng(SEED).standard_normal(2000))
    late = np.concatenate([[0.0], error[:-1]])
    found = long_run(np.column_stack([error, late, np.ones(2000)]), error)
    np.testing.assert_allclose(found, found.T, rtol=1e-12)
    assert np.linalg.eigvalsh(found).min() > 0.0


def test_directions_that_the_constants_imitate_leave_every_number_finite() -> None:
    """A trend, a direction that is the trend, and a residual that is made of both: nothing is left but rounding."""
    time = STEP * np.arange(8.0)
    trend = constants(time)
    matrix = np.column_stack([trend, 0.3 + 2.0 * trend[:, 1], np.exp(-time), 1.3 - trend[:, 1]])
    columns, others = Columns(matrix, steps_between(time, STEP)), np.diag([1e-9, 1e-9, 0.0])
    for terms, entries in SHAPES:
        found = likelihood(columns, Others(others), terms, np.array(entries))
        assert np.isfinite([found.deviance, found.criterion, found.variance]).all()
        back = inverse((others + found.products)[:-1, :-1])
        assert np.isfinite(back).all()
        assert (np.linalg.eigvalsh(back) > 0.0).all()


def test_the_inverse_of_normal_equations_is_their_inverse_whatever_the_units() -> None:
    columns = np.random.default_rng(SEED).standard_normal((20, 4))
    units = np.array([1e-9, 1.0, 1e6, 1e-3])
    products = (columns * units).T @ (columns * units)
    expected = np.linalg.inv(columns.T @ columns) / np.outer(units, units)
    np.testing.assert_allclose(inverse(products), expected, rtol=1e-9)
    np.testing.assert_array_equal(np.isfinite(inverse(np.ones((3, 3)))), True)


def test_an_autoregression_has_at_most_one_lag_for_five_readings() -> None:
    generator = np.random.default_rng(SEED)
    for count in (3, 4, 5, 9, 14):  # of three readings no two are four steps apart
        matrix = np.column_stack([constants(np.arange(float(count))), np.cumsum(generator.standard_normal(count))])
        columns = Columns(matrix, np.ones(count, dtype=np.int64))
        found = choose_terms(columns, np.zeros((1, 1)), Allowed())
        assert found.terms.order <= count // 5
        assert math.isfinite(found.criterion)


def test_wherever_a_search_of_the_noise_begins_it_ends_at_one_point() -> None:
    """To a millionth of the error of an entry: what least squares allow a zero and a slope hangs on it."""
    generator = np.random.default_rng([SEED, 7])
    count, terms = 600, Terms(1, white=True, offset=True)
    time = STEP * np.arange(count)
    true = Shape(terms, np.array([1.4, 0.2]), 1.0)
    residual = drawn(true, steps_between(time, STEP), generator)
    matrix = np.column_stack([constants(time), np.sin(time), residual])
    columns = Columns(np.ascontiguousarray(matrix), steps_between(time, STEP))
    others = np.diag([1e-3, 1e-3])
    starts = true.entries + generator.standard_normal((6, 2)) / math.sqrt(count)
    ends = np.array([refine(columns, others, terms, [start]).entries for start in starts])
    assert np.ptp(ends, axis=0).max() * math.sqrt(count) < 1e-6


def test_an_entry_at_its_bound_and_one_that_changes_nothing_stay() -> None:
    def height(point: Array) -> float:
        return float((point[0] - 0.3) ** 2 + point[0] * point[1] + math.cos(point[0]) + point[1])

    found = settled(height, np.array([0.5, 0.0, 0.7]), [(-2.0, 2.0), (0.0, 1.0), (-1.0, 1.0)], 1.0)
    assert found[1:].tolist() == [0.0, 0.7]
    assert 2.0 * (found[0] - 0.3) == pytest.approx(math.sin(found[0]), abs=1e-3)  # slopes by differences
