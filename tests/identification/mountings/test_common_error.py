"""What mountings have in common: it neither averages out over them nor shows in how far they lie apart."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ipmclab import Run, identify, prediction_bands, read_fit, simulate, write_fit
from ipmclab.identification.identify import identify_freed
from ipmclab.identification.mountings.common_error import common_covariance, loadings_of, parted
from ipmclab.identification.problem.free import FreeParameters, Prior
from ipmclab.measurement.random_effect import random_effect
from ipmclab.model import Actuator
from tests.identification import many
from tests.identification.brief import brief
from tests.identification.many import CONTACT, FRIEND, noisy

SEED = 20261121
RHO = "circuit.dc_resistivity"
THICKNESS = "geometry.thickness"
PERMITTIVITY = "circuit.branches.1.permittivity"


def stating(name: str, deviation: float, strip: Actuator = FRIEND) -> Actuator:
    return replace(strip, standard_uncertainties={name: deviation})


def mountings(
    generator: np.random.Generator, spread: float, strip: Actuator = FRIEND, signal: str = "square 1 V 0.1 Hz"
) -> list[Run]:
    """Four mountings in which the dc resistivity strays."""
    factors = np.exp(spread * generator.standard_normal(4))
    strips = [strip.replace(**{RHO: strip[RHO] * float(factor)}) for factor in factors]
    return [noisy(generator, signal, strip=one, mounting=f"m{k}") for k, one in enumerate(strips)]


def log_width(interval: tuple[float, float] | None) -> float:
    assert interval is not None
    return float(np.log(interval[1] / interval[0]))


@given(
    values=st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=8),
    own=st.floats(0.0, 2.0),
    common=st.floats(1e-3, 10.0),
)
@example(values=[1.0, 1.0, 1.0], own=7.851131796700346e-36, common=1.0)  # below the rounding of the values
@example(values=[0.0, 0.0, 1.1125369292536007e-308], own=0.0, common=1.0)
@example(values=[0.0, 0.0, 2.767445975551352e-85], own=0.0, common=1.0)
def test_the_next_one_is_never_better_known_than_what_all_share(values: list[float], own: float, common: float) -> None:
    alone = random_effect(values, np.full(len(values), own))
    found = random_effect(values, np.full(len(values), own), common=common)
    assert found.next_one is not None
    assert alone.next_one is not None
    width = found.next_one[1] - found.next_one[0]
    assert width >= 2.0 * 1.959963 * common * (1.0 - 1e-6)
    assert width >= (alone.next_one[1] - alone.next_one[0]) * (1.0 - 1e-6)
    # It moves all of them alike.
    assert (found.between, found.p_value, found.mean) == (alone.between, alone.p_value, alone.mean)


@pytest.mark.parametrize(("own", "between"), [(0.1, 0.0), (0.1, 0.1), (0.1, 1.0), (1.0, 0.3)])
def test_the_next_one_lies_inside_when_a_common_error_is_drawn_anew(own: float, between: float) -> None:
    generator = np.random.default_rng(SEED)
    trials, inside, without = 400, 0, 0
    for _ in range(trials):
        truth = between * generator.standard_normal(5)
        read = truth[:4] + own * generator.standard_normal(4) + 0.5 * generator.standard_normal()
        low, high = random_effect(read, [own] * 4, common=0.5).next_one or (np.nan, np.nan)
        inside += low <= truth[4] <= high
        low, high = random_effect(read, [float(np.hypot(own, 0.5))] * 4).next_one or (np.nan, np.nan)
        without += low <= truth[4] <= high
    # Three standard deviations of 400 trials at 95 %: 3.3 %.
    assert inside / trials >= 0.917
    assert without <= inside


def test_errors_are_parted_by_their_mean_loading() -> None:
    found = parted([1.0, 1.0, 1.0], [[0.6, 0.0], [0.6, 0.0], [0.6, 0.3]])
    assert found.common == pytest.approx(np.hypot(0.6, 0.1))
    assert found.own[:2] == pytest.approx(np.hypot(0.8, 0.1))
    assert parted([1.0, 2.0, 3.0], np.zeros((3, 0))).own == pytest.approx([1.0, 2.0, 3.0])


def test_a_stated_thickness_does_not_hide_what_mountings_differ_by(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """They differ by 2 %, which the noise shows; the thickness makes all of them wrong by 30 %."""
    monkeypatch.setitem(many.NOISE, "current", 1e-5)
    generator = np.random.default_rng(SEED)
    runs = mountings(generator, 0.02)
    exact = identify(FRIEND, runs, free=RHO)
    fit = identify(stating(THICKNESS, 0.1 * FRIEND[THICKNESS]), runs, free=RHO)
    one = fit.parameters[RHO]
    assert log_width(one.interval_next_mounting) >= log_width(one.interval) > 1.0
    assert fit.mountings is not None
    assert exact.mountings is not None
    assert fit.mountings.between[RHO] == pytest.approx(exact.mountings.between[RHO], rel=0.15)
    assert fit.mountings.p_value[RHO] < 1e-6
    assert "mountings-differ" in {finding.code for finding in fit.findings}
    write_fit(fit, tmp_path / "fitted.toml")
    assert read_fit(tmp_path / "fitted.toml").mountings == fit.mountings


def test_a_contact_of_each_mounting_shares_the_error_of_the_sheet() -> None:
    """The drop over the electrodes and that over the contact add up: what is not known of one is not of the other."""
    generator = np.random.default_rng(SEED)
    runs = [noisy(generator, "step 1 V", strip=FRIEND.replace(**{CONTACT: 0.5}), mounting=f"m{k}") for k in range(4)]
    strip = stating("circuit.sheet_resistance", 0.03)
    fit = identify(strip, runs, free=[RHO, "circuit.branches.1.resistivity", PERMITTIVITY], per_mounting=CONTACT)
    one = fit.parameters[f"{CONTACT}[mounting m0]"]
    assert one.standard_error == pytest.approx(0.36, abs=0.01)
    assert one.interval_next_mounting is not None
    assert one.interval_next_mounting == pytest.approx((0.0, one.value + 1.96 * one.standard_error), rel=0.02)


def test_another_mounting_lies_inside_when_the_stated_value_is_drawn_anew() -> None:
    """Ten strips, the thickness of each known to 5 %, while mountings differ by 1 %."""
    generator = np.random.default_rng(SEED)
    inside = []
    for _ in range(10):
        true = FRIEND.replace(**{THICKNESS: FRIEND[THICKNESS] * float(np.exp(0.05 * generator.standard_normal()))})
        fit = brief(stating(THICKNESS, 0.05 * FRIEND[THICKNESS]), mountings(generator, 0.01, true))
        low, high = fit.parameters[RHO].interval_next_mounting or (np.nan, np.nan)
        inside.append(low <= FRIEND[RHO] * float(np.exp(0.01 * generator.standard_normal())) <= high)
    # At 95 %, fewer than 7 of 10 come once in a thousand.
    assert sum(inside) >= 7


def fitted_beside(
    runs: list[Run], strip: Actuator, other: Actuator, prior: Iterable[str] = (), free: str = RHO
) -> tuple[float, float]:
    """Width of the next mounting's interval, and of what moving the strip by one standard deviation alone gives."""
    fit, moved = (identify(one, runs, free=free, prior=tuple(prior)) for one in (strip, other))
    shift = abs(float(np.log(moved.parameters[RHO].value / fit.parameters[RHO].value)))
    return log_width(fit.parameters[RHO].interval_next_mounting), 2.0 * 1.96 * shift


def test_the_pull_of_a_prior_is_common() -> None:
    """Moved by its standard deviation, the prior moves all mountings; the next one is not better known than that."""
    sheet, generator = "circuit.sheet_resistance", np.random.default_rng(SEED)
    strip = stating(sheet, 0.05 * FRIEND[sheet])
    other = stating(sheet, 0.05 * FRIEND[sheet], FRIEND.replace(**{sheet: 1.05 * FRIEND[sheet]}))
    runs = mountings(generator, 0.0, signal="square 1 V 1 Hz")
    found, alone = fitted_beside(runs, strip, other, prior=[sheet], free=f"{RHO},{sheet}")
    assert alone > 0.0
    assert found >= 0.95 * alone


def test_the_band_of_the_next_mounting_holds_what_all_have_in_common() -> None:
    generator = np.random.default_rng(SEED)
    runs = mountings(generator, 0.01)
    deviation = 0.1 * FRIEND[PERMITTIVITY]
    fit = identify(stating(PERMITTIVITY, deviation), runs, free=RHO)
    new = noisy(generator, "sine 1 V 0.02 Hz", duration=60.0, mounting="another")
    bands = prediction_bands(fit, new)
    assert bands.mounting == "the next"
    other = FRIEND.replace(**{PERMITTIVITY: FRIEND[PERMITTIVITY] + deviation})
    moved = identify(other, runs, free=RHO).actuator
    common = np.abs(simulate(moved, new).channels["current"] - bands.predicted["current"])
    assert common.max() > 1e-4
    late = common > 0.3 * common.max()
    # A tenth is beyond first order.
    assert np.all(bands.of_parameters["current"][late] >= 0.85 * common[late])


def test_the_band_of_the_next_mounting_has_a_contact_of_its_own() -> None:
    """Student's interval of three answers, of which the contact is all that differs."""
    generator = np.random.default_rng(SEED)
    contacts = {"a": 0.5, "b": 3.0, "c": 1.0}
    runs = [noisy(generator, "step 1 V", strip=FRIEND.replace(**{CONTACT: c}), mounting=m) for m, c in contacts.items()]
    fit = identify(FRIEND, runs, free=RHO, per_mounting=CONTACT)
    new = noisy(generator, "step 1 V", mounting="another")
    bands = prediction_bands(fit, new)
    each = [simulate(FRIEND.replace(**{CONTACT: c}), new).channels["current"][5] for c in contacts.values()]
    reach = 4.303 * np.std(each, ddof=1) * np.sqrt(4.0 / 3.0)
    assert bands.reach("current", of_readings=False)[5] == pytest.approx(reach, rel=0.1)


def test_a_prior_that_follows_a_dimension_is_wrong_by_itself_only_in_what_it_says_beside_it() -> None:
    """Sheet resistance and dc resistivity were computed with one width: it moves all, and moves them once."""
    width, sheet = "geometry.width", "circuit.sheet_resistance"
    slope = FRIEND[sheet] / FRIEND[width]
    priors = {
        width: Prior(FRIEND[width], 0.02 * FRIEND[width], merely_uncertain=True),
        sheet: Prior(FRIEND[sheet], 0.01 * FRIEND[sheet], {width: slope}),
    }
    electrical = [name for name in FRIEND.parameter_values if name.startswith(("circuit.dc", "circuit.branches"))]
    free = FreeParameters((width, sheet, *electrical), priors=priors)
    generator = np.random.default_rng(SEED)
    fit = identify_freed(FRIEND, [noisy(generator, "step 1 V", mounting="a")], free, None)
    for name, moved in loadings_of(fit).items():
        together = sum(one**2 for one in moved.values())
        assert together <= 1.001 * fit.covariance[name][name]
    assert fit.covariance[sheet][width] == pytest.approx(slope * fit.covariance[width][width], rel=0.05)


@pytest.mark.parametrize("correlation", [0.0, 0.9, -0.9])
def test_what_an_earlier_fit_found_together_counts_once(correlation: float) -> None:
    """Two held numbers that are wrong together move an estimate by what both do, not by the sum of what each does."""
    names = ["circuit.sheet_resistance", "circuit.branches.0.resistivity"]
    deviations = np.array([0.01, 0.2]) * [FRIEND[name] for name in names]
    together = np.outer(deviations, deviations) * [[1.0, correlation], [correlation, 1.0]]
    earlier = {
        "covariance": {"names": names, "rows": together.tolist()},
        "values": {name: FRIEND[name] for name in names},
    }
    stated = dict(zip(names, deviations.tolist(), strict=True))
    strip = replace(FRIEND, standard_uncertainties=stated, fit_table=earlier)
    free = ["circuit.branches.0.permittivity", RHO]
    fit = identify(strip, [noisy(np.random.default_rng(SEED), "square 1 V 0.1 Hz")], free=free)
    loadings = loadings_of(fit)
    for name in free:
        beside = [fit.covariance[name][other] for other in names]
        expected = float(beside @ np.linalg.solve(together, beside))
        assert sum(moved**2 for moved in loadings[name].values()) == pytest.approx(expected, rel=1e-6)
        assert expected < fit.covariance[name][name]
    values = {name: fit.parameters[name].value for name in free}
    every, covariance = common_covariance(fit, [loadings, loadings], [values, values])
    order = [every.index(name) for name in (*free, *names)]
    size = np.sqrt(covariance.diagonal()[order])
    expected = [[fit.covariance[one][other] for other in names] for one in (*free, *names)]
    np.testing.assert_allclose(
        covariance[np.ix_(order, order[2:])] / np.outer(size, size[2:]),
        np.array(expected) / np.outer(size, size[2:]),
        atol=1e-6,
    )


def test_mountings_none_of_which_determines_a_parameter_are_compared_in_the_others() -> None:
    generator = np.random.default_rng(SEED)
    runs = [noisy(generator, "step 1 V", mounting=name) for name in "ab"]
    fit = identify(FRIEND, runs, free=["electrical", "geometry.width"])
    assert not fit.parameters["geometry.width"].determined
    assert "mountings-differ" not in {finding.code for finding in fit.findings}
