"""Young's modulus from a push: closed forms, drawn errors, and pushes that are wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ipmclab import InputError, Run, follow_procedure, write_run
from ipmclab.consistency.push import pushes
from ipmclab.measurement.push import Push, stiffness
from ipmclab.measurement.push_slips import outlier_in
from ipmclab.measurement.uncertain import exact
from ipmclab.procedure.procedure_file import procedure_from_text
from ipmclab.procedure.push import modulus
from ipmclab.procedure.step import Step
from ipmclab.run import QUALITY_FLAGS

KNOWN = {f"geometry.{name}": exact(value) for name, value in (("width", 5e-3), ("thickness", 0.245e-3))}
POSITION = exact(21e-3)
MEASURED = """
name = "strip"
[geometry]
free_length = { value = "25 mm", standard_uncertainty = "0.2 mm" }
clamped_length = { value = "5 mm", standard_uncertainty = "0.2 mm" }
width = { value = "5 mm", standard_uncertainty = "0 mm" }
thickness = { value = "0.245 mm", standard_uncertainty = "0 mm" }
sensing_length = { value = "21 mm", standard_uncertainty = "0 mm" }
"""
K = 2.8782  # N/m: that of the thesis's numbers, 1.45e9 x 5e-3 x (0.245e-3)^3 / (4 x (21e-3)^3)
IN_AND_OUT = np.concatenate([np.linspace(0.0, 0.5e-3, 11), np.linspace(0.5e-3, 0.0, 11)])


def codes(push: Push) -> list[str]:
    return [finding.code for finding in stiffness(push)[1]]


def test_equation_4_11() -> None:
    step = modulus(Push(IN_AND_OUT, K * IN_AND_OUT + 4e-3), POSITION, KNOWN)  # with a preload
    assert step.results["beam.modulus"].amount.value == pytest.approx(1.45e9, rel=1e-4)
    assert step.also["f/δ"].amount.value == pytest.approx(K)
    assert not step.findings


def test_the_slope_lies_within_its_uncertainty() -> None:
    rng = np.random.default_rng(20261121)
    off = []
    for _ in range(400):
        slope, findings = stiffness(Push(IN_AND_OUT, K * IN_AND_OUT + 2e-5 * rng.standard_normal(22)))
        off.append((slope.value - K) / slope.uncertainty)
        assert not {one.code for one in findings} - {"push-hysteresis", "push-not-straight"}
    assert np.mean(np.abs(off) < 1.96) > 0.925
    assert np.std(off) > 0.7  # and not because it is told too wide


def test_a_clean_push_is_seldom_called_bad() -> None:
    rng = np.random.default_rng(20261121)
    found = [codes(Push(IN_AND_OUT, K * IN_AND_OUT + 1e-5 * rng.standard_normal(22))) for _ in range(300)]
    assert sum(bool(one) for one in found) < 9


def test_friction_shows_as_a_loop() -> None:
    rng = np.random.default_rng(20261121)
    friction = np.where(np.arange(22) < 11, 5e-5, -5e-5)
    slope, findings = stiffness(Push(IN_AND_OUT, K * IN_AND_OUT + friction + 5e-6 * rng.standard_normal(22)))
    (finding,) = findings
    assert finding.code == "push-hysteresis"
    assert finding.values["width"] == pytest.approx(1e-4, rel=0.1)
    # Each way has its own level, so that the slope does not take up the loop.
    assert slope.value == pytest.approx(K, rel=0.02)


@pytest.mark.parametrize(("part", "told"), [(0.03, True), (0.012, False)])
def test_a_loop_is_told_from_two_percent_of_the_force_on(part: float, told: bool) -> None:
    half = 0.5 * part * K * 0.5e-3
    found = codes(Push(IN_AND_OUT, K * IN_AND_OUT + np.where(np.arange(22) < 11, half, -half)))
    assert ("push-hysteresis" in found) is told


def test_creep_makes_the_way_out_steeper_and_the_slope_less_sure() -> None:
    out = np.arange(22) >= 11
    force = np.where(out, 1.3 * K * IN_AND_OUT - 0.15 * K * 0.5e-3, K * IN_AND_OUT)
    slope, findings = stiffness(Push(IN_AND_OUT, force))
    assert "push-hysteresis" in [one.code for one in findings]
    assert slope.parts["hysteresis of the push"] == pytest.approx(0.15 * K, rel=0.05)
    assert slope.interval[0] < K < slope.interval[1]


def test_a_way_out_that_was_hardly_read_is_not_taken_for_the_next_way_in() -> None:
    """In, two readings on the way back, in again, stiffer: no way out was read, so that nothing is said of a loop."""
    travel = 1e-4 * np.array([0, 1, 2, 3, 4, 5, 3.5, 2, 3, 4, 5.0])
    force = K * np.where(np.arange(11) < 6, travel, 1.2 * travel)
    slope, findings = stiffness(Push(travel, force))
    assert "hysteresis of the push" not in slope.parts
    assert {"push-one-way"} == {one.code for one in findings} - {"push-not-straight"}


def test_in_out_and_in_again_compares_both_ways_in_with_the_way_out() -> None:
    ways = [np.linspace(0.0, 0.5e-3, 11), np.linspace(0.45e-3, 0.0, 10), np.linspace(0.05e-3, 0.5e-3, 10)]
    force = [K * way * (1.2 if number == 1 else 1.0) for number, way in enumerate(ways)]
    slope, findings = stiffness(Push(np.concatenate(ways), np.concatenate(force)))
    assert slope.parts["hysteresis of the push"] == pytest.approx(0.1 * K, rel=1e-6)
    (finding,) = [one for one in findings if one.code == "push-hysteresis"]
    assert (finding.values["in"], finding.values["out"]) == pytest.approx((K, 1.2 * K), rel=1e-6)


def test_before_contact_the_force_says_nothing() -> None:
    rng = np.random.default_rng(20261121)
    travel = np.concatenate([np.linspace(0.0, 1e-3, 41), np.linspace(1e-3, 0.0, 41)])
    force = K * np.maximum(travel - 0.42e-3, 0.0) + 5e-6 * rng.standard_normal(82)
    slope, findings = stiffness(Push(travel, force))
    (finding,) = [one for one in findings if one.code == "push-without-contact"]
    assert 28 <= finding.count <= 40
    assert abs(slope.value - K) < 3.0 * slope.uncertainty
    assert slope.uncertainty < 0.02 * K


@pytest.mark.parametrize("distance", [0.0, 12.3e-3])
@pytest.mark.parametrize("way_back", [False, True])
def test_a_push_towards_negative_is_the_same_push(way_back: bool, distance: float) -> None:
    """Also where a laser tells its distance: the way before contact was then taken for a strip that bends."""
    rng = np.random.default_rng(20261121)
    travel = np.linspace(0.0, 0.5e-3, 21)
    travel = np.concatenate([travel, travel[::-1]]) if way_back else travel
    force = K * np.maximum(travel - 0.2e-3, 0.0) + 2e-6 * rng.standard_normal(len(travel))
    slope, findings = stiffness(Push(travel, force))
    other, others = stiffness(Push(distance - travel, -force))
    assert abs(other.value - K) < 3.0 * other.uncertainty
    assert (other.value, other.uncertainty) == pytest.approx((slope.value, slope.uncertainty))
    assert [(one.code, one.samples) for one in others] == [(one.code, one.samples) for one in findings]
    assert "push-without-contact" in [one.code for one in others]


def test_a_record_that_rests_for_long_before_contact_has_its_slope() -> None:
    """Four fifths of the readings lie where the cell does not touch: the contact is sought over the travel."""
    rng = np.random.default_rng(20261121)
    time = np.linspace(0.0, 60.0, 240)
    travel = 0.5e-3 * np.interp(time, [0.0, 25.0, 30.0, 35.0, 60.0], [0.0, 0.0, 1.0, 0.0, 0.0])
    force = K * np.maximum(travel - 0.2e-3, 0.0) + 1e-5 * rng.standard_normal(240)
    slope, findings = stiffness(Push(travel, force))
    assert "push-without-contact" in [one.code for one in findings]
    assert abs(slope.value - K) < 3.0 * slope.uncertainty
    assert slope.uncertainty < 0.05 * K


def test_where_noise_hides_the_contact_the_slope_says_so() -> None:
    """Both slopes are possible: the uncertainty holds both, and holds the true one as often as it should."""
    rng = np.random.default_rng(20261121)
    travel = np.concatenate([np.linspace(0.0, 0.5e-3, 30), np.linspace(0.5e-3, 0.0, 30)])
    off, told = [], 0
    for _ in range(100):
        force = K * np.maximum(travel - 0.15e-3, 0.0) + 1.2e-4 * rng.standard_normal(60)
        slope, _ = stiffness(Push(travel, force))
        off.append((slope.value - K) / slope.uncertainty)
        told += "where the push touches" in slope.parts
    assert told > 50
    assert np.mean(np.abs(off) < 1.96) > 0.9


@pytest.mark.parametrize(("change", "told"), [(0.4, True), (0.07, True), (0.03, False)])
def test_a_slope_that_changes_by_five_percent_over_the_push_is_told(change: float, told: bool) -> None:
    middle = IN_AND_OUT - 0.25e-3
    force = K * middle * (1.0 + 0.5 * change * middle / 0.5e-3)
    assert ("push-not-straight" in codes(Push(IN_AND_OUT, force))) is told


def test_a_push_one_way_and_a_push_too_far() -> None:
    travel = np.linspace(0.0, 5e-3, 20)
    step = modulus(Push(travel, K * travel), POSITION, KNOWN)
    assert {"push-one-way", "push-too-far"} <= {one.code for one in step.findings}


def test_the_scales_count() -> None:
    slope, _ = stiffness(Push(IN_AND_OUT, K * IN_AND_OUT, calibration=0.02))
    assert slope.uncertainty / slope.value == pytest.approx(0.02, rel=1e-3)


@pytest.mark.parametrize(
    ("travel", "force", "code"),
    [
        ([0.0, 1e-4, 2e-4], [0.0, 1e-4, 2e-4], "too-few-readings"),
        ([1e-4] * 6, [0.0] * 6, "bad-value"),
        ([0.0, 1e-4, 2e-4, 3e-4, np.nan], [0.0, 1e-4, 2e-4, 3e-4, 4e-4], "bad-value"),
        (IN_AND_OUT, -K * IN_AND_OUT, "out-of-range"),
    ],
)
def test_what_is_no_push(travel, force, code) -> None:
    with pytest.raises(InputError) as error:
        stiffness(Push(np.array(travel), np.array(force)))
    assert error.value.code == code
    assert error.value.repair


def test_a_force_that_is_hidden_in_its_scatter_gives_no_modulus() -> None:
    scatter = np.where(np.arange(22) % 2 == 0, 2e-3, -2e-3)
    with pytest.raises(InputError, match=r"is not known: \d+ % of its variance is the scatter of the push") as error:
        modulus(Push(IN_AND_OUT, K * IN_AND_OUT + scatter), POSITION, KNOWN)
    assert (error.value.code, error.value.where) == ("no-modulus", "modulus")


CONTACT = {"at once": 0.0, "after a third": 0.2e-3}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("contact", CONTACT.values(), ids=CONTACT)
@pytest.mark.parametrize("place", [7, 10, 12])
@pytest.mark.parametrize("factor", [0.1, 10.0, 1000.0])
def test_a_force_with_a_wrong_digit_or_unit_lies_apart(factor: float, place: int, contact: float, sign: float) -> None:
    rng = np.random.default_rng(place)
    true = K * np.maximum(IN_AND_OUT - contact, 0.0)
    force = true + 5e-6 * rng.standard_normal(22)
    force[place] *= factor
    outlier = outlier_in(sign * IN_AND_OUT, sign * force)
    assert outlier is not None
    assert (outlier.place, outlier.in_displacement) == (place, False)
    assert outlier.expected == pytest.approx(sign * true[place], abs=2e-5)


@pytest.mark.parametrize("factor", [10.0, 1000.0])
def test_a_displacement_with_a_wrong_digit_or_unit_lies_apart(factor: float) -> None:
    travel = IN_AND_OUT.copy()
    travel[4] *= factor
    outlier = outlier_in(travel, K * IN_AND_OUT + 5e-6 * np.random.default_rng(4).standard_normal(22))
    assert outlier is not None
    assert (outlier.place, outlier.in_displacement) == (4, True)


@pytest.mark.parametrize("noise", [0.0, 2e-6, 1e-4])
def test_readings_that_only_scatter_have_none_that_lies_apart(noise: float) -> None:
    rng = np.random.default_rng(20261122)
    loop = np.where(np.arange(22) < 11, 1e-4, -1e-4)
    found = 0
    for shape in (IN_AND_OUT, np.maximum(IN_AND_OUT - 0.2e-3, 0.0), IN_AND_OUT + loop / K, IN_AND_OUT + IN_AND_OUT**2):
        for _ in range(5):
            found += outlier_in(IN_AND_OUT, K * shape + noise * rng.standard_normal(22)) is not None
    assert found == 0


def test_a_push_beyond_the_free_end_is_refused() -> None:
    """Its position counts cubed: 12 mm for 21 mm is a fifth of the modulus."""
    push = '[modulus]\ndisplacement = ["0 mm", "1 mm"]\nforce = ["0 mN", "1 mN"]\nposition = "{} mm"\n'
    at_the_end = procedure_from_text(MEASURED + push.format(25)).push_position
    assert at_the_end is not None
    assert at_the_end.value == 25e-3
    with pytest.raises(InputError, match=r"the push, at 25\.1 mm, is beyond the free length 25 mm") as error:
        procedure_from_text(MEASURED + push.format(25.1), where="p.toml")
    assert error.value.where == "p.toml: modulus.position"


UP_AND_PART_OF_THE_WAY_BACK = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.4, 0.3]) * 1e-3


@pytest.mark.parametrize("place", range(8))
@pytest.mark.parametrize("loop", [-1e-4, 0.0, 1e-4])
@pytest.mark.parametrize("slip", [-2e-3, 2e-3])
def test_a_slip_is_not_laid_to_the_one_other_reading_of_its_way(slip: float, loop: float, place: int) -> None:
    """Without that the slip would be alone, and lie on a line of its own."""
    rng = np.random.default_rng(place)
    force = K * UP_AND_PART_OF_THE_WAY_BACK + 1e-5 * rng.standard_normal(8)
    force[6:] += loop
    force[place] += slip
    outlier = outlier_in(UP_AND_PART_OF_THE_WAY_BACK, force)
    assert outlier is not None
    assert (outlier.place, outlier.in_displacement) == (place, False)


def test_a_strip_that_is_not_touched_reads_nothing_but_a_slip() -> None:
    force = np.zeros(6)
    force[4] = 5e-3
    outlier = outlier_in(np.arange(6.0) * 1e-4, force)
    assert outlier is not None
    assert (outlier.place, outlier.expected) == (4, 0.0)


def test_the_end_of_the_travel_is_no_slip_of_the_displacement() -> None:
    """A little beyond all others it lies by itself; a slip lies beyond them by more than all of their range."""
    travel = np.arange(10.0) * 1e-4
    force = K * travel
    force[9] *= 0.1
    outlier = outlier_in(travel, force)
    assert outlier is not None
    assert (outlier.place, outlier.in_displacement) == (9, False)
    travel[8] = 2.5 * travel[9]
    outlier = outlier_in(travel, K * np.arange(10.0) * 1e-4)
    assert outlier is not None
    assert (outlier.place, outlier.in_displacement) == (8, True)


def test_a_force_that_is_read_with_the_other_sign_bends_where_it_is_touched_too() -> None:
    force = -K * np.maximum(IN_AND_OUT - 0.2e-3, 0.0) + 5e-6 * np.random.default_rng(7).standard_normal(22)
    expected, force[7] = -K * 0.15e-3, -K * 1.5e-3
    outlier = outlier_in(IN_AND_OUT, force)
    assert outlier is not None
    assert outlier.place == 7
    assert outlier.expected == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize(("count", "is_told"), [(9, True), (8, False)])
def test_where_a_push_bends_is_known_from_four_readings_on(count: int, is_told: bool) -> None:
    travel = np.arange(float(count)) * 1e-4
    force = K * np.maximum(travel - 3.5e-4, 0.0) + 1e-7 * np.random.default_rng(3).standard_normal(count)
    force[6] += 2e-3
    outlier = outlier_in(travel, force)
    assert (None if outlier is None else outlier.place) == (6 if is_told else None)


def test_a_straight_push_of_five_readings_in_and_out_tells_a_slip() -> None:
    travel = np.array([0.0, 1e-4, 2e-4, 1e-4, 0.0])
    force = K * travel + 1e-10 * np.array([1.0, 0.0, -2.0, 1.0, 3.0])
    force[1] += 2e-3
    outlier = outlier_in(travel, force)
    assert outlier is not None
    assert outlier.place == 1


def test_how_many_readings_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ipmclab.measurement.push_slips._MOST", 7)
    for count, is_told in ((4, False), (5, True), (7, True), (8, False)):
        travel = np.arange(float(count)) * 1e-4
        force = K * travel
        force[1] = 5e-3
        assert (outlier_in(travel, force) is not None) == is_told


def step_of(table: str) -> Step:
    return follow_procedure(procedure_from_text(MEASURED + table)).steps[4]


def test_rows_that_check_masks_are_no_readings_of_a_push(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A laser that is lost on the way, the value it then gives marked by nobody, and rows that the operator masked."""
    monkeypatch.chdir(tmp_path)
    travel = np.concatenate([np.linspace(0.0, 0.5e-3, 201), np.linspace(0.5e-3, 0.0, 201)])
    rng = np.random.default_rng(20261121)
    x, f = travel + 1e-7 * rng.standard_normal(402), K * travel + 1e-6 * rng.standard_normal(402)
    masked = np.zeros(402, dtype=np.uint8)
    x[150:160] = x[300:306] = -0.1
    f[50:70] += 1e-3
    masked[50:70] = QUALITY_FLAGS["masked_by_operator"]
    run = Run.from_arrays(
        time=np.arange(402) / 10.0, voltage=np.zeros(402), displacement=x, force=f, quality={"force": masked}
    )
    write_run(run, "push.nc")
    step = step_of('[modulus]\nrun = "push.nc"\ncalibration = 0.0\n')
    assert step.also["f/δ"].amount.value == pytest.approx(K, rel=1e-3)
    assert not step.findings
    (fact,) = pushes([run])
    assert fact.value == pytest.approx(K, rel=5e-3)
    assert not fact.doubts


@pytest.mark.parametrize("kind", ["a table", "a run"])
def test_scales_that_nobody_states_are_taken_as_usual_and_that_is_said(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the same run is held against a strip: 3 % of each scale."""
    monkeypatch.chdir(tmp_path)
    run = Run.from_arrays(
        time=np.arange(22.0), voltage=np.zeros(22), displacement=IN_AND_OUT, force=K * IN_AND_OUT, hold="unknown"
    )
    write_run(run, "push.nc")
    lists = {
        "displacement": [f"{1e3 * x:.3f} mm" for x in IN_AND_OUT],
        "force": [f"{1e3 * K * x} mN" for x in IN_AND_OUT],
    }
    push = '[modulus]\nrun = "push.nc"\n'
    if kind == "a table":
        push = "[modulus]\n" + "".join(f"{key} = {json.dumps(texts)}\n" for key, texts in lists.items())
    step = step_of(push)
    slope = step.also["f/δ"].amount
    assert slope.uncertainty / slope.value == pytest.approx(0.03 * np.sqrt(2.0), rel=1e-3)
    (finding,) = [one for one in step.findings if one.code == "assumed-uncertainty"]
    assert "calibration of the push" in finding.message
    assert "calibration = 0.01" in finding.repair
    stated = step_of(push + "calibration = 0.0\n")
    assert stated.also["f/δ"].amount.uncertainty < 1e-3 * K
    assert "assumed-uncertainty" not in {one.code for one in stated.findings}
