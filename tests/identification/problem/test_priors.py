"""What is known beforehand counts like a reading, and a fit says what the readings made of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Actuator, InputError, Run, identify, load_actuator, read_fit, simulate, write_fit
from ipmclab.identification.identify import identify_freed
from ipmclab.identification.problem.free import FreeParameters, Prior
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import prepare
from ipmclab.identification.problem.response import ActuatorResponder
from ipmclab.identification.problem.unknowns import actuator_unknown, with_known

FRIEND = load_actuator("friend-2")
SERIES, DC = "circuit.sheet_resistance", "circuit.dc_resistivity"


def known(actuator: Actuator = FRIEND, **uncertainties: float) -> Actuator:
    named = {name.replace("__", "."): value for name, value in uncertainties.items()}
    return replace(actuator, standard_uncertainties=named)


def measured(seed: int = 0, actuator: Actuator = FRIEND, noise: float = 1e-4) -> Run:
    generator = np.random.default_rng([20261121, seed])
    clean = simulate(actuator, "square 1 V 0.1 Hz", duration=40.0, rate=50.0)
    assert clean.current is not None
    noisy = clean.current + noise * generator.standard_normal(len(clean.current))
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=noisy)


def test_a_prior_counts_like_a_reading() -> None:
    """The sum of both precisions, and the mean of both values weighted by them."""
    run = measured()
    alone = identify(FRIEND, [run], free="electrical").parameters[DC]
    before = 43.0, 1.0 * alone.standard_error
    strip = known(FRIEND.replace(**{DC: before[0]}), circuit__dc_resistivity=before[1])
    both = identify(strip, [run], free="electrical", prior=DC).parameters[DC]
    weights = np.array([alone.standard_error, before[1]]) ** -2.0
    assert both.standard_error == pytest.approx(weights.sum() ** -0.5, rel=0.02)
    mean = float(weights @ [alone.value, before[0]] / weights.sum())
    assert both.value == pytest.approx(mean, abs=0.02 * alone.standard_error)
    assert both.prior == pytest.approx(before)
    ignored = identify(strip, [run], free="electrical").parameters[DC]
    assert (ignored.value, ignored.prior) == (pytest.approx(alone.value, rel=1e-6), None)


def test_a_prior_closes_what_the_current_leaves_open() -> None:
    run = measured(1, noise=1e-5)
    free = ["electrical", SERIES]
    strip = known(circuit__sheet_resistance=0.02)
    assert identify(strip, [run], free=free).rank == 5
    fit = identify(strip, [run], free=free, prior=SERIES)
    assert fit.rank == 6
    series = fit.parameters[SERIES]
    assert series.determined
    assert series.standard_error == pytest.approx(0.02, rel=0.1)
    (said,) = [finding for finding in fit.findings if finding.code == "prior"]
    assert said.message == (
        f"{SERIES} was 1.333 ohm/sq within 1.5 % beforehand; the readings alone leave it open, and add nothing"
    )


def test_where_both_disagree_the_fit_says_so() -> None:
    strip = known(FRIEND.replace(**{DC: 60.0}), circuit__dc_resistivity=1.0)
    fit = identify(strip, [measured(2)], free="electrical", prior="circuit.dc_resistivity")
    (said,) = [finding for finding in fit.findings if finding.code == "prior-contradicted"]
    assert said.message.startswith(
        f"{DC} was 60 ohm m within 1.7 % beforehand (one standard deviation), but the readings alone say 43."
    )
    assert said.values["deviations"] is not None
    assert said.values["deviations"] > 10.0


@pytest.mark.parametrize("part", [3e-10, 1e-12])
def test_a_prior_however_sharp_is_an_exact_value(part: float) -> None:
    """It takes nothing from what the readings say of the rest, though they know nothing nearly as well."""
    run = measured(1)
    exact = identify(FRIEND, [run], free="electrical")
    strip = known(circuit__sheet_resistance=part * FRIEND[SERIES])
    fit = identify(strip, [run], free=["electrical", SERIES], prior=SERIES)
    assert (fit.rank, fit.undetermined) == (6, ())
    for name, one in exact.parameters.items():
        found = fit.parameters[name]
        assert found.determined
        assert found.value == pytest.approx(one.value, rel=1e-6)
        assert found.interval == pytest.approx(one.interval, rel=1e-6)
        assert fit.practical.collinearity[name] == pytest.approx(exact.practical.collinearity[name], rel=1e-6)
    assert fit.parameters[SERIES].standard_error == pytest.approx(part * FRIEND[SERIES], rel=1e-6)


def test_what_the_readings_leave_open_stays_open_beside_a_sharp_prior() -> None:
    """The current says nothing of the contact against the branches, however well the sheet resistance is known."""
    contact = "circuit.contact_resistance"
    strip = FRIEND.replace(**{contact: 1.0})
    run = measured(1, strip)
    exact = identify(strip, [run], free=["electrical", contact])
    fit = identify(
        known(strip, circuit__sheet_resistance=1e-11), [run], free=["electrical", contact, SERIES], prior=SERIES
    )
    assert (exact.rank, fit.rank) == (5, 6)
    for name, one in exact.parameters.items():
        assert fit.parameters[name].determined == one.determined
        assert fit.parameters[name].interval == pytest.approx(one.interval, rel=1e-5)
    assert fit.parameters[SERIES].determined


def test_each_run_has_the_prior_of_a_parameter_of_its_own() -> None:
    contact = "circuit.contact_resistance"
    strip = known(FRIEND.replace(**{contact: 1.0}), circuit__contact_resistance=0.5)
    runs = [measured(3, FRIEND.replace(**{contact: ohm})) for ohm in (0.7, 1.4)]
    fit = identify(strip, runs, free="electrical", per_run=contact, prior=contact)
    assert [fit.parameters[f"{contact}[{place}]"].prior for place in (0, 1)] == [(1.0, 0.5)] * 2
    # The difference between two clampings is seen; their common part is as open as before.
    first, second = (fit.parameters[f"{contact}[{place}]"].value for place in (0, 1))
    assert second - first == pytest.approx(0.7, abs=0.05)


def test_a_range_that_strips_have_is_a_prior_too() -> None:
    clean = simulate(FRIEND, "square 1 V 0.1 Hz", duration=20.0, rate=50.0)
    assert clean.force is not None
    assert clean.displacement is not None
    force = clean.force + 1e-5 * np.random.default_rng(20261121).standard_normal(len(clean.time))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, force=force)
    free = ["coupling.gain", "beam.modulus"]
    assert identify(FRIEND, [run], free=free).rank == 1
    fit = identify(FRIEND, [run], free=free, prior="beam.modulus")
    modulus = fit.parameters["beam.modulus"]
    assert fit.rank == 2
    assert modulus.prior is not None
    assert modulus.interval == pytest.approx((41e6, 1.45e9), rel=0.02)
    assert not modulus.determined


def test_a_prior_from_the_same_runs_is_told(tmp_path: Path) -> None:
    run = measured(4)
    first = identify(FRIEND, [run], free="electrical")
    again = identify(first.actuator, [run], free="electrical", prior=DC)
    assert "prior-from-these-runs" in {finding.code for finding in again.findings}
    write_fit(again, tmp_path / "again.toml")
    assert read_fit(tmp_path / "again.toml").parameters == again.parameters
    other = identify(first.actuator, [measured(5)], free="electrical", prior=DC)
    assert "prior-from-these-runs" not in {finding.code for finding in other.findings}


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ("circuit.sheet_resistance", "prior: 'circuit.sheet_resistance' is not free; free it too"),
        ("circuit.dc_resistivity", "prior: nothing is known beforehand of circuit.dc_resistivity: its value has no"),
        ("circuit.dc_resistance", "prior: no parameter or group is called 'circuit.dc_resistance'; did you mean"),
        ("observation.offset.current", "prior: 'observation.offset.current' is found from the readings alone"),
    ],
)
def test_a_prior_that_is_none_is_refused(prior: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        identify(FRIEND, [measured()], free="electrical", prior=prior)


def test_what_follows_a_dimension_moves_with_it() -> None:
    """R_s = R w/d: with a width of 1 % and R/d of 0.5 %, both being known beforehand and nothing read of them."""
    fitted = "geometry.width", SERIES
    names = FreeParameters(
        fitted,
        priors={
            "geometry.width": Prior(5e-3, 0.05e-3, merely_uncertain=True),
            SERIES: Prior(1.333, 0.005 * 1.333, {"geometry.width": 1.333 / 5e-3}),
        },
    )
    width, series = with_known([actuator_unknown(FRIEND.parameters()[name], None) for name in fitted], names.priors)
    assert series.beforehand == pytest.approx((1.333, 1.333 * np.hypot(0.01, 0.005)))
    record = prepare(measured(), 0, ["current"], ())
    noise = {(0, "current"): 1.0}
    problem = Problem(FRIEND.parameter_values, [record], [width, series], ActuatorResponder(FRIEND), noise)
    theta = np.log([5e-3, 1.333])
    np.testing.assert_allclose(problem.from_priors(theta), 0.0, atol=1e-12)
    # A strip that is 1 % wider has a sheet resistance that is 1 % larger: that is no second surprise.
    np.testing.assert_allclose(problem.from_priors(theta + 0.01), [1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(problem.from_priors(np.add(theta, [0.0, 0.01])), [0.0, 2.0], atol=1e-9)
    rows = problem.evaluate(theta).jacobian[-2:]
    covariance = np.linalg.inv(rows.T @ rows)
    np.testing.assert_allclose(covariance, [[1e-4, 1e-4], [1e-4, 1.25e-4]], rtol=1e-9)
    assert names.without_priors == FreeParameters((SERIES,))
    # Sought as far as what it follows may be wrong too.
    merely = {**names.priors, SERIES: replace(names.priors[SERIES], merely_uncertain=True)}
    for unknown in with_known([actuator_unknown(FRIEND.parameters()[name], None) for name in fitted], merely):
        middle, uncertainty = unknown.beforehand or (0.0, 0.0)
        assert (unknown.lower, unknown.upper) == pytest.approx((middle - 6 * uncertainty, middle + 6 * uncertainty))


@pytest.mark.parametrize("correlation", [0.0, 0.99, -0.99])
def test_what_an_earlier_fit_found_together_is_known_together(correlation: float) -> None:
    """The information of the readings, which leave a valley, with the inverse of what is known of all three."""
    names = [SERIES, DC, "circuit.branches.0.resistivity"]
    deviations = np.array([0.004, 0.05, 0.1]) * [FRIEND[name] for name in names]
    together = np.outer(deviations, deviations) * [[1.0, 0.1, correlation], [0.1, 1.0, 0.0], [correlation, 0.0, 1.0]]
    earlier = {
        "covariance": {"names": names, "rows": together.tolist()},
        "values": {name: FRIEND[name] for name in names},
    }
    stated = dict(zip(names, deviations.tolist(), strict=True))
    strip = replace(FRIEND, standard_uncertainties=stated, fit_table=earlier)
    fit = identify(strip, [measured(noise=1e-3)], free=names, prior=names)
    assert fit.estimate is not None
    problem, solution = fit.estimate.problem, fit.estimate.solution
    readings = max(piece.stop for piece in problem.pieces.values())
    order = [[unknown.name for unknown in problem.unknowns].index(name) for name in names]
    values = np.array([fit.parameters[name].value for name in names])
    columns = solution.evaluation.jacobian[:readings, order] / values  # all three are moved as logarithms
    expected = np.linalg.inv(columns.T @ columns + np.linalg.inv(together))
    found = [[fit.covariance[one][other] for other in names] for one in names]
    np.testing.assert_allclose(
        found / np.outer(deviations, deviations), expected / np.outer(deviations, deviations), atol=0.02
    )
    for name, deviation in zip(names, deviations, strict=True):
        assert fit.parameters[name].prior == pytest.approx((FRIEND[name], deviation))


def test_a_dimension_that_the_readings_contradict_is_told() -> None:
    """A strip 10 % wider than was measured, within 1 %, while all else is known."""
    run = measured(3, FRIEND.replace(**{"geometry.width": 5.5e-3}))
    strip = known(geometry__width=0.05e-3)
    names = FreeParameters(("geometry.width",), priors={"geometry.width": Prior(5e-3, 0.05e-3, merely_uncertain=True)})
    fit = identify_freed(strip, [run], replace(names, shared=("geometry.width", DC)), None)
    (said,) = [finding for finding in fit.findings if finding.code == "prior-contradicted"]
    assert said.message.startswith("geometry.width was 5 mm within 1 % beforehand (one standard deviation), but the")
    assert said.values["deviations"] > 5.0


def test_what_is_held_with_an_uncertainty_may_make_a_prior_worse_and_the_fit_says_so() -> None:
    strip = known(geometry__width=0.05e-3, circuit__dc_resistivity=2.0)
    clean = simulate(FRIEND, "step 1 V delay=5 s", duration=30.0, rate=20.0)
    assert clean.current is not None
    noise = 3e-5 * np.random.default_rng(20261121).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold="zero")
    fit = identify(strip, [run], free=["geometry.width", SERIES], prior="geometry.width")
    assert fit.parameters["geometry.width"].standard_error > 1.5 * 0.05e-3
    (said,) = [finding for finding in fit.findings if finding.code == "prior"]
    assert "what is held with an uncertainty of its own makes it worse" in said.message
    assert said.repair.endswith("under its own prior")


def test_a_prior_follows_its_branch_where_branches_are_sorted() -> None:
    """An actuator whose slow branch stands first: the fit calls it the second, and its prior too."""
    strip = load_actuator("friend-2")
    names = [f"circuit.branches.{k}.permittivity" for k in (0, 1)]
    other = [f"circuit.branches.{k}.resistivity" for k in (0, 1)]
    swapped = {one: strip[two] for pair in (names, other) for one, two in (pair, pair[::-1])}
    slow_first = replace(strip.replace(**swapped), standard_uncertainties={names[0]: 0.05 * strip[names[1]]})
    clean = simulate(strip, "step 1 V", duration=30.0, rate=10.0)
    noise = 1e-4 * np.random.default_rng(20261121).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
    fit = identify(slow_first, run, free=[*names, *other], prior=names[0])
    assert [name for name, one in fit.parameters.items() if one.prior is not None] == [names[1]]
    (said,) = [finding.message for finding in fit.findings if finding.code == "prior"]
    assert said.startswith(names[1])
