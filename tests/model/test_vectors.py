"""Sixteen numbers in one variable of a kernel, and the laws of many ports that are solved with them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.law_loop import law, solve_several
from ipmclab.model.numerics.law_rows_loop import LAW_ROWS, PAST_ROWS, WORK_ROWS, guess, nearby, put_laws, remember
from ipmclab.model.numerics.vectors_loop import WIDTH, begin_of, exponential, filled, load, store, turned


@kernel
def exponentials(x: Any, found: Any) -> None:
    given, made = begin_of(x), begin_of(found)
    for b in range(0, x.shape[0], WIDTH):
        store(made, b, exponential(load(given, b)))


@kernel
def turn(square: Any, place: int, found: Any) -> None:
    turned(begin_of(square), place, square.shape[1], begin_of(found), 3, found.shape[1])


@kernel
def solve_nearby(form: int, k: Any, laws: Any, q: Any, r: Any, at: Any, work: Any) -> bool:
    rows = begin_of(laws), begin_of(q), begin_of(r), begin_of(at[0]), begin_of(at[1]), begin_of(work)
    return nearby(form, k.shape[0], rows[0], r.shape[0], rows[1], rows[2], rows[3], rows[4], rows[5])


@kernel
def look_back(past: Any, solution: Any, following: Any) -> None:
    remember(begin_of(past), past.shape[1], begin_of(solution))
    guess(begin_of(past), past.shape[1], begin_of(following))


def test_exponentials_are_those_of_the_library() -> None:
    x = np.concatenate([np.linspace(-650.0, 650.0, 4096), np.linspace(-1e-3, 1e-3, 512), np.zeros(WIDTH)])
    found = np.empty_like(x)
    exponentials(x, found)
    assert np.max(np.abs(found / np.exp(x) - 1.0)) < 1e-15
    assert np.all(found[-WIDTH:] == 1.0)
    exponentials(np.full(WIDTH, np.nan), found[:WIDTH])
    assert not np.any(found[:WIDTH] < np.inf)


def test_a_square_is_turned_and_what_is_around_it_stays() -> None:
    square, found = np.random.default_rng(5).normal(size=(8, 16)), np.zeros((8, 12))
    turn(square, 4, found)
    assert np.array_equal(found[:, 3:11], square[:, 4:12].T)
    assert not np.any(found[:, :3])
    assert not np.any(found[:, 11:])


def test_the_last_four_solutions_point_to_the_next_of_every_cubic() -> None:
    """The latest comes first, and what is older than four rows is forgotten."""
    coefficients = np.random.default_rng(7).normal(size=(4, 2 * WIDTH))
    rows = [np.polynomial.polynomial.polyval(float(row), coefficients) for row in range(7)]
    past, following = np.zeros((PAST_ROWS, 2 * WIDTH)), np.empty(2 * WIDTH)
    for row in rows[:-1]:
        look_back(past, row, following)
    assert np.array_equal(past, rows[-2:1:-1])
    np.testing.assert_allclose(following, rows[-1], rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("count", [1, 10, 17, 40])
@pytest.mark.parametrize("form", [0, 1, 2])
def test_laws_of_any_number_of_ports_are_solved_from_nearby(form: int, count: int) -> None:
    random = np.random.default_rng(100 * form + count)
    tried = solved = 0
    for steepness in (1e-3, 1.0, 1e3, 1e6):
        root = random.normal(size=(count, count))
        q = root @ root.T / count + 0.1 * np.eye(count)
        k = np.column_stack(
            [steepness * random.uniform(0.5, 2.0, count), random.uniform(0.0, 0.5, count), np.ones(count)]
        )
        k[:, 2] = random.uniform(0.05, 0.5, count)
        forms, width = np.full(count, form), filled(count)
        laws = np.zeros((LAW_ROWS, width))
        put_laws(form, k, laws)
        columns, r = np.zeros((count, width)), np.zeros(width)
        columns[:, :count], r[:count] = q.T, 2.0 * random.normal(size=count)
        p, w = np.zeros(count), np.zeros(count)
        assert solve_several(forms, k, q, r[:count], p, w)
        for off in (0.0, 1e-7, 1e-3, 0.3, 3.0):
            at = np.zeros((2, width))
            at[0, :count] = p + off * random.normal(size=count)
            tried += 1
            if not solve_nearby(form, k, laws, columns, r, at, np.zeros((WORK_ROWS + count, width))):
                continue
            solved += 1
            most = np.max(np.abs(r))
            assert np.max(np.abs(at[0, :count] - p)) < 1e-12 * most
            assert np.max(np.abs(at[0, :count] + q @ at[1, :count] - r[:count])) < 1e-12 * most
            assert not np.any(at[:, count:])
            slopes = np.array([law(form, own, voltage)[1] for own, voltage in zip(k, p, strict=True)])
            assert np.all(np.abs(at[1, :count] - w) <= 1e-12 * (1.0 + np.abs(w) + np.minimum(slopes, 1.0) * most))
    assert solved >= 0.4 * tried  # others are none that this way is for
