"""The order in which runs are given says nothing of the strip."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Fit, identify, leave_one_run_out
from tests.identification.many import FRIEND, noisy

LEAK = "circuit.dc_resistivity"


@pytest.fixture(
    scope="module",
    params=[((30.0, 40.0, 55.0), "square 1 V 0.05 Hz"), ((40.0, 42.0, 44.0), "square 0.1 V 0.05 Hz")],
    ids=["far apart", "hardly apart"],
)
def fits(request: pytest.FixtureRequest) -> dict[str, Fit]:
    """Of three runs that disagree, in every order: what one leaves takes up what another would."""
    generator = np.random.default_rng(3)
    runs = {}
    leaks, signal = request.param
    for name, leak in zip("abc", leaks, strict=True):
        strip = FRIEND.replace(**{LEAK: leak})
        runs[name] = noisy(generator, signal, strip=strip, duration=20.0, rate=50.0, mounting=name)
    orders = ("abc", "acb", "bac", "bca", "cab", "cba")
    return {order: leave_one_run_out(identify(FRIEND, [runs[name] for name in order], free=LEAK)) for order in orders}


def test_a_fit_of_runs_that_disagree_is_the_same_in_every_order(fits: dict[str, Fit]) -> None:
    first = fits["abc"].parameters[LEAK]
    for fit in fits.values():
        one = fit.parameters[LEAK]
        assert one.value == pytest.approx(first.value, abs=0.01 * first.standard_error)
        assert one.interval == pytest.approx(first.interval, abs=0.01 * first.standard_error)
        assert {finding.code for finding in fit.findings} == {finding.code for finding in fits["abc"].findings}


def test_so_is_what_each_run_left_out_is_predicted_as(fits: dict[str, Fit]) -> None:
    for order, fit in fits.items():
        for name, one in zip(order, fit.left_out, strict=True):
            expected = fits["abc"].left_out["abc".index(name)]
            assert one.inside["current"] == pytest.approx(expected.inside["current"], abs=0.01)
            assert one.standardised["current"] == pytest.approx(expected.standardised["current"], rel=0.01)
