"""The posterior of a fit against what is known without sampling."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import (
    Finding,
    Fit,
    InputError,
    Run,
    RunMetadata,
    identify,
    load_actuator,
    read_fit,
    sample_posterior,
    simulate,
    write_fit,
    write_posterior,
)
from ipmclab.identification.solved import solved
from ipmclab.posterior.coordinates import Valley
from ipmclab.posterior.density import Density
from ipmclab.posterior.doubts import doubts
from ipmclab.posterior.packages import bayes_package
from ipmclab.posterior.posterior import Posterior
from ipmclab.reporting.figures.pairs import pairs_figure
from tests.independent.bounds import current_of, noisy_current
from tests.independent.thesis import FRIEND_2, Strip, circuit

Array = npt.NDArray[np.float64]
FRIEND = load_actuator("friend-2")
SERIES, FIRST, DC = "circuit.sheet_resistance", "circuit.branches.0.resistivity", "circuit.dc_resistivity"
RATE, NOISE = 20.0, 2e-4
TIME = np.arange(400) / RATE
VOLTAGE = np.where(TIME % 10.0 < 5.0, 1.0, -1.0)


def measured(*, fading: float = 0.0, resting: int = 0) -> Run:
    """After some rows at 0 V, which show the noise by itself."""
    generator = np.random.default_rng(20261121)
    voltage = np.concatenate([np.zeros(resting), VOLTAGE])
    clean = noisy_current(FRIEND_2, voltage, RATE, 0.0, generator)
    error = NOISE * generator.standard_normal(len(voltage))
    for row in range(1, len(voltage) if fading else 0):
        error[row] = fading * error[row - 1] + (1.0 - fading**2) ** 0.5 * error[row]
    rest = RunMetadata(starts_from_rest=True)
    time = np.arange(len(voltage)) / RATE
    return Run.from_arrays(time=time, voltage=voltage, current=clean + error, hold="zero", metadata=rest)


@pytest.fixture(scope="module")
def fit() -> Fit:
    return identify(FRIEND, [measured()], free="electrical")


@pytest.fixture(scope="module")
def posterior(fit: Fit) -> Posterior:
    return sample_posterior(fit)


def assert_agrees(posterior: Posterior, fit: Fit, *, within: float) -> None:
    """Means, widths and ends of intervals; an end is known to 0.1 standard deviations."""
    for name, one in fit.parameters.items():
        found = posterior.parameters[name]
        assert found.mean == pytest.approx(one.value, abs=within * one.standard_error)
        assert found.standard_deviation == pytest.approx(one.standard_error, rel=within)
        assert found.interval == pytest.approx(one.interval, abs=2.0 * within * one.standard_error)


def test_it_agrees_with_the_intervals_of_a_fit_whose_errors_are_small(posterior: Posterior, fit: Fit) -> None:
    narrow = {name: one for name, one in fit.parameters.items() if one.standard_error < 0.05 * one.value}
    assert len(narrow) >= 4
    assert_agrees(posterior, replace(fit, parameters=narrow), within=0.15)
    for one in posterior.parameters.values():
        assert one.convergence.r_hat <= 1.01
        assert min(one.convergence.bulk, one.convergence.tail) >= 1000


def test_noise_that_hangs_together_is_in_it_and_so_is_a_fixed_value_that_is_not_exact() -> None:
    known = replace(FRIEND, standard_uncertainties={SERIES: 0.02, "beam.modulus": 1e8})
    fit = identify(known, [measured(fading=0.8, resting=100)], free=DC)
    assert fit.observations[0].noise_model["current"].coefficients
    found = sample_posterior(fit)
    # The modulus does not matter to a current.
    assert set(found.parameters) == {DC, SERIES}
    # A fit passes the uncertainty on as it is; with all else fixed the current knows the series resistance better.
    assert not found.parameters[SERIES].is_free
    assert found.parameters[SERIES].standard_deviation < 0.5 * 0.02
    exact = identify(FRIEND, [measured(fading=0.8, resting=100)], free=[DC, SERIES])
    assert_agrees(found, exact, within=0.15)


def test_a_drift_begins_where_the_zero_stands_that_rows_at_0_v_show() -> None:
    """It went through zero at the middle of the record: the zero was at its bound, and the dc path 15 errors off."""
    clean, noise = simulate(FRIEND, "step 1 V delay=1 s", duration=40.0, rate=50.0), np.random.default_rng(20261128)
    current = clean.current + 0.6e-3 * (clean.time / 40.0 - 0.5) + 1e-4 * noise.standard_normal(len(clean))
    fit = identify(FRIEND, Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current), free=DC)
    assert set(fit.parameters) == {DC, "observation.offset.current[0]"}
    assert fit.observations[0].noise_model["current"].trend
    assert_agrees(sample_posterior(fit), fit, within=0.15)


def test_what_is_said_of_a_walker_does_not_depend_on_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = identify(FRIEND, [measured(fading=0.8, resting=100)], free="electrical")
    density = Density(solved(fit), {}, {})
    middle = density.coordinates(density.coordinates.middle[None])[0][0]
    generator = np.random.default_rng(20261121)
    vectors = middle + 1e-2 * generator.standard_normal((12, len(middle)))
    vectors[3] = density.upper + 1.0
    branches = [[f"circuit.branches.{n}.{what}" for what in ("resistivity", "permittivity")] for n in (0, 1)]
    names = [unknown.name for unknown in density.unknowns]
    first, second = ([names.index(name) for name in branch] for branch in branches)
    vectors[5, first + second] = vectors[5, second + first]
    found = density(vectors)
    # One is beyond a bound, and one calls the slower branch the first.
    np.testing.assert_array_equal(np.flatnonzero(np.isneginf(found)), [3, 5])
    np.testing.assert_allclose(found, [density(one[None])[0] for one in vectors], rtol=1e-13)
    monkeypatch.setattr("ipmclab.posterior.density._MOST_READINGS", 5 * 500)
    np.testing.assert_allclose(found, Density(solved(fit), {}, {})(vectors), rtol=1e-13)


@pytest.mark.parametrize("correlation", [0.0, 0.99, -0.99])
def test_what_an_earlier_fit_found_together_is_known_together(correlation: float) -> None:
    """Where the current leaves the series resistance open against the first branch, what is known of both decides."""
    names = [SERIES, FIRST]
    deviations = np.array([0.004, 0.1]) * [FRIEND[name] for name in names]
    together = np.outer(deviations, deviations) * [[1.0, correlation], [correlation, 1.0]]
    earlier = {
        "covariance": {"names": names, "rows": together.tolist()},
        "values": {name: FRIEND[name] for name in names},
    }
    stated = dict(zip(names, deviations.tolist(), strict=True))
    fit = identify(replace(FRIEND, standard_uncertainties=stated, fit_table=earlier), [measured()], free=DC)
    assert fit.estimate is not None
    solved, theta = fit.estimate.problem, fit.estimate.solution.theta
    # Where errors are small: the information of the readings, with the inverse of what is known of the two.
    columns = np.hstack([solved.evaluate(theta).jacobian * FRIEND[DC] ** -1.0, solved.fixed_jacobian(theta, names)])
    information = columns.T @ columns
    information[1:, 1:] += np.linalg.inv(together)
    expected = np.sqrt(np.linalg.inv(information).diagonal())
    found = sample_posterior(fit).parameters
    for name, size in zip((DC, *names), expected, strict=True):
        assert found[name].standard_deviation == pytest.approx(size, rel=0.1)
    for name, deviation in zip(names, deviations, strict=True):
        assert found[name].prior == pytest.approx((FRIEND[name], deviation))


def equivalent(strip: Strip, series: float) -> Array | None:
    """Logarithms of (rho_1, R_s, rho_dc, eps_1, rho_2, eps_2) that draw the same current behind another resistance.

    With Y the admittance, 1/(1/Y - S') is the admittance behind the series resistance S', in partial fractions.
    """
    a, b, c, d = circuit(strip)
    poles = np.linalg.eigvals(a)
    numerator = np.poly(a - b @ c[:1] / d[0, 0]) * d[0, 0]
    behind = np.polysub(np.poly(poles), series * numerator)
    if behind[0] <= 0.0:
        return None
    roots = np.roots(behind)
    if (roots.imag != 0).any() or (roots >= 0).any():
        return None
    slope = np.polyder(behind)
    residues = np.array([np.polyval(numerator, root) / np.polyval(slope, root) for root in roots])
    resistances = roots / residues  # the residue is -(1/R) (1/(R C)), the root -1/(R C)
    order = np.argsort(roots)
    resistances, capacitances = resistances[order], (-1.0 / (roots * resistances))[order]
    dc = np.polyval(behind, 0.0) / np.polyval(numerator, 0.0)
    if (resistances <= 0).any() or dc <= 0:
        return None
    scale = strip.total_length * strip.width / strip.thickness
    return np.log(
        [
            resistances[0] * scale,
            series / (2.0 * strip.total_length / strip.width),
            dc * scale,
            capacitances[0] / scale,
            resistances[1] * scale,
            capacitances[1] / scale,
        ]
    )


def strip_at(logarithms: Array) -> Strip:
    first, sheet, dc, eps1, second, eps2 = np.exp(logarithms)
    return FRIEND_2.changed(
        electrode_resistance=float(sheet) * FRIEND_2.total_length / FRIEND_2.width,
        resistivities=(float(first), float(second)),
        permittivities=(float(eps1), float(eps2)),
        dc_resistance=float(dc) * FRIEND_2.thickness / (FRIEND_2.total_length * FRIEND_2.width),
    )


def test_a_bent_valley_is_filled_as_quadrature_along_it_says() -> None:
    """Six parameters from current alone, the sheet resistance known to 30 %.

    All circuits along the null curve draw the same current. For thin cross sections the posterior of log rho_1 is the
    prior there over the root of the determinant of the information on the five others.
    """
    known = replace(FRIEND, standard_uncertainties={SERIES: 0.3 * FRIEND[SERIES]})
    fit = identify(known, [measured()], free=["electrical", SERIES], prior=SERIES)
    posterior = sample_posterior(fit)
    most = 1.0 / circuit(FRIEND_2)[3][0, 0]  # all of the first resistance
    places = [equivalent(FRIEND_2, most * (1.0 - part)) for part in np.logspace(-5.5, -0.05, 96)]
    curve = np.array(sorted((one for one in places if one is not None), key=lambda one: one[0]))
    weights = []
    for point in curve:
        columns = []
        for place in range(1, 6):
            moved = [point.copy(), point.copy()]
            moved[0][place] += 1e-5
            moved[1][place] -= 1e-5
            up, down = (current_of(strip_at(one), TIME, VOLTAGE) for one in moved)
            columns.append((up - down) / 2e-5 / NOISE)
        information = np.linalg.slogdet(np.transpose(columns).T @ np.transpose(columns))[1]
        away = (point[1] - np.log(FRIEND[SERIES])) / 0.3
        weights.append(-0.5 * away**2 - 0.5 * information)
    density = np.exp(np.array(weights) - max(weights))
    # Below the curve's last point the first branch is nothing, all else stands, and the density is level to the bound.
    start = float(np.log(1e-6))
    logarithms = np.concatenate([[start], curve[:, 0]])
    density = np.concatenate([density[:1], density])
    cumulated = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(logarithms))])
    samples = np.log(posterior.samples[FIRST]).ravel()
    for part in (0.25, 0.5, 0.75, 0.9):
        expected = float(np.interp(part, cumulated / cumulated[-1], logarithms))
        assert np.mean(samples < expected) == pytest.approx(part, abs=0.06)
    assert posterior.parameters[FIRST].at_bound
    # Beside it everything else is where the curve has it: the thin tube is never left.
    at_samples = np.interp(samples, curve[:, 0], curve[:, 1])
    assert np.abs(np.log(posterior.samples[SERIES]).ravel() - at_samples).max() < 0.03


def test_a_valley_is_followed_where_another_direction_becomes_the_weakest() -> None:
    """It was lost there, and chains along straight lines did not agree after 5000 steps."""
    names = (DC, FIRST, "circuit.branches.0.permittivity", "circuit.branches.1.resistivity")
    values = (47.7, 0.367, 0.0854, 22.0)
    strip = FRIEND.replace(**dict(zip(names, values, strict=True)), **{"circuit.branches.1.permittivity": 0.782})
    clean = simulate(strip, "step 1 V delay=2 s", duration=10.0, rate=20.0)
    noise = 3e-4 * np.random.default_rng([20261128, 8]).standard_normal(len(clean))
    fit = identify(FRIEND, Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise))
    assert isinstance(Density(solved(fit), {}, {}).coordinates, Valley)
    found = sample_posterior(fit, steps=2000).parameters
    # The dc path may draw nothing at all: its bound ends it.
    assert found[DC].at_bound
    for name, value in zip(names[1:], values[1:], strict=True):
        assert found[name].interval[0] < value < found[name].interval[1]


def test_files_and_figure(posterior: Posterior, fit: Fit, tmp_path: Path) -> None:
    arviz = bayes_package("arviz")
    write_posterior(posterior, tmp_path / "posterior.nc")
    again = arviz.from_netcdf(tmp_path / "posterior.nc")
    np.testing.assert_array_equal(again.posterior[DC].values, posterior.samples[DC])
    assert again.posterior.attrs["actuator"] == "friend-2"
    with pytest.raises(InputError, match="exists"):
        write_posterior(posterior, tmp_path / "posterior.nc")
    figure = pairs_figure(posterior, fit)
    shown = [panel for panel in figure.axes if panel.get_visible()]
    assert len(shown) == 15  # five alone and ten pairs
    assert {panel.get_xlabel().partition("\n")[0] for panel in shown[-5:]} == {"ρ_dc", "ρ_1", "ε_1", "ρ_2", "ε_2"}
    # Each outline holds the part of the samples that it says: checked where the pair is most correlated.
    assert abs(posterior.correlation(DC, "circuit.branches.1.resistivity")) > 0.9


def test_residuals_that_no_noise_describes_are_told(fit: Fit) -> None:
    assert fit.estimate is not None
    assert doubts(fit, fit.estimate) == ()
    wrong = identify(FRIEND.replace(**{"circuit.branches.1.permittivity": 0.3}), [measured()], free=DC)
    assert wrong.estimate is not None
    assert {"model-incomplete", "posterior-too-narrow"} <= {finding.code for finding in doubts(wrong, wrong.estimate)}


def test_what_a_fit_is_refused_for_and_what_its_model_lacks_is_told(fit: Fit) -> None:
    assert fit.estimate is not None
    lost = Finding("contact-lost", "error", "the contact was open", channel="current")
    aside = Finding("response-opposite", "error", "it goes the wrong way", channel="displacement")
    lacks = Finding("stage-missing", "warning", "the residuals show a leak", channel="current")
    noted = Finding("exact-fixed-value", "warning", "taken as exact")
    told = doubts(replace(fit, findings=(lost, aside, lacks, noted)), fit.estimate)
    assert told == (lost, lacks)


def in_mountings(*leaks: float) -> list[Run]:
    """Runs of one strip whose leak the clamp changes: one period each, as a filter goes through their rows."""
    generator = np.random.default_rng(20261121)
    noise = 1e-3
    time, voltage = TIME[: len(TIME) // 2], VOLTAGE[: len(TIME) // 2]
    runs = []
    for name, leak in zip("abc", leaks, strict=False):
        strip = FRIEND_2.changed(dc_resistance=leak * FRIEND_2.thickness / (FRIEND_2.total_length * FRIEND_2.width))
        clean = noisy_current(strip, voltage, RATE, noise, generator)
        about = RunMetadata(mounting_id=name, starts_from_rest=True)
        runs.append(Run.from_arrays(time=time, voltage=voltage, current=clean, hold="zero", metadata=about))
    return runs


def test_mountings_that_differ_are_told_with_the_interval_of_the_next() -> None:
    runs = in_mountings(36.0, 40.0, 44.0)
    fit = identify(FRIEND, runs, free=DC)
    found = sample_posterior(fit)
    assert [finding.code for finding in found.findings if finding.code == "mountings-differ"] == ["mountings-differ"]
    one = found.parameters[DC]
    assert one.is_average
    assert one.interval_next_mounting == fit.parameters[DC].interval_next_mounting
    assert one.interval_next_mounting is not None
    # The samples hold for none of the outer two; the next mounting's interval for each.
    assert 36.0 < one.interval[0] < one.interval[1] < 44.0
    assert one.interval_next_mounting[0] < 36.0 < 44.0 < one.interval_next_mounting[1]
    assert found.next_mounting_unknown == ""


def test_each_mounting_has_samples_of_its_own_and_two_tell_nothing_of_a_third() -> None:
    found = sample_posterior(identify(FRIEND, in_mountings(36.0, 44.0), free=DC, per_mounting=DC))
    assert found.findings == ()
    for name, leak in (("a", 36.0), ("b", 44.0)):
        own = found.parameters[f"{DC}[mounting {name}]"]
        assert not own.is_average
        assert abs(own.mean - leak) < 4.0 * own.standard_deviation
        assert own.interval_next_mounting is None
    assert "cannot be estimated from two mountings: it takes three or more" in found.next_mounting_unknown


def test_where_mountings_differ_nobody_is_sent_to_the_intervals_of_the_fit() -> None:
    """They hold for none of the mountings either."""
    wrong = identify(FRIEND.replace(**{"circuit.branches.1.permittivity": 0.3}), [measured()], free=DC)
    assert wrong.estimate is not None
    differ = Finding("mountings-differ", "warning", "2 mountings differ by more than their errors")
    for findings, cure in ((wrong.findings, "use the intervals of the fit"), ((differ,), "per_mounting")):
        told = {one.code: one for one in doubts(replace(wrong, findings=findings), wrong.estimate)}
        assert cure in told["posterior-too-narrow"].repair


def test_what_cannot_be_sampled_is_refused(fit: Fit, tmp_path: Path) -> None:
    write_fit(fit, tmp_path / "fitted.toml")
    with pytest.raises(InputError, match="no longer has its readings; identify again"):
        sample_posterior(read_fit(tmp_path / "fitted.toml"))
    with pytest.raises(InputError, match="steps: 399 steps are too few; give 400 or more"):
        sample_posterior(fit, steps=399)


def test_a_missing_package_is_named(fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "emcee", None)
    with pytest.raises(InputError, match=r'emcee is not installed; .*write: uv tool install "\.\[bayes\]"'):
        sample_posterior(fit)
