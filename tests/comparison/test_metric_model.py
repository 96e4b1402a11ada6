"""Effects, the next strip and strips unlike the others, where the truth is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from ipmclab.comparison.factors import FACTORS, Factor
from ipmclab.comparison.metric_model import MetricModel, model_metric
from ipmclab.comparison.table import RunRow
from tests.comparison.campaigns import campaign, row

EVERY = tuple(FACTORS.values())


def modelled(rows: list[RunRow], factors: tuple[Factor, ...] = EVERY) -> MetricModel:
    model = model_metric("displacement.largest", "step", rows, factors)
    assert model is not None
    return model


def test_effects_are_ratios_from_the_lowest_level_to_the_highest() -> None:
    """Without scatter they are the truth to the digit; what did not change is no factor."""
    rows = campaign(np.random.default_rng(1), scatter=(0.0, 0.0, 1e-9))
    model = modelled([row for row in rows if row.values["loading"] == 0.05])
    assert [factor.name for factor in model.factors] == ["thickness", "humidity"]
    thick, humid = model.effects()
    assert thick.value == pytest.approx(math.exp(0.5), rel=1e-3)
    assert humid.value == pytest.approx(math.exp(0.3), rel=0.02)  # at the humidity that was read, not at its level
    assert (thick.low, thick.high) == (pytest.approx(0.18e-3), pytest.approx(0.25e-3))
    assert (humid.low, humid.high) == (pytest.approx(60.0, abs=0.3), pytest.approx(80.0, abs=0.3))


def test_a_factor_between_strips_has_as_few_degrees_of_freedom_as_there_are_strips() -> None:
    """One within strips has as many as strips show how they answer to it; a sham is not found here."""
    model = modelled(campaign(np.random.default_rng(2)))
    thick, loading, humid = model.effects()
    assert model.fit.contrast([0.0, 1.0, 0.0, 0.0]).freedom == pytest.approx(5.0, rel=1e-3)
    assert model.fit.contrast([0.0, 0.0, 0.0, 1.0]).freedom > 70.0
    assert humid.p_value is not None
    assert humid.p_value < 1e-5
    assert loading.interval is not None
    assert loading.interval[0] < 1.0 < loading.interval[1]
    assert thick.interval is not None
    assert thick.interval[0] < math.exp(0.5) < thick.interval[1]


def test_a_factor_within_strips_is_judged_by_how_differently_strips_answer_to_it() -> None:
    """At two levels: Student's interval of the mean of the strips' own answers, however many runs each has."""
    draw = np.random.default_rng(20261129)
    answers = np.array([0.1, 0.5, 0.2, 0.4])
    rows = [
        row(
            float(np.exp(place + answer * level + 0.01 * draw.normal())),
            sample=f"{place}",
            humidity=60.0 + 20.0 * level,
        )
        for place, answer in enumerate(answers)
        for level in (0, 1)
        for _ in range(6)
    ]
    model = modelled(rows)
    (humid,) = model.effects()
    own = model.values.reshape(4, 2, 6).mean(axis=2) @ [-1.0, 1.0]
    expected = scipy.stats.t.interval(0.95, 3, own.mean(), own.std(ddof=1) / 2.0)
    assert np.log(humid.interval) == pytest.approx(expected, rel=1e-6)
    assert humid.p_value == pytest.approx(scipy.stats.ttest_1samp(own, 0.0).pvalue, rel=1e-6)
    # Two strips do not show how differently strips answer: theirs is the answer of these two.
    (of_two,) = modelled([one for one in rows if one.sample in "01"]).effects()
    assert of_two.interval is not None
    assert np.ptp(np.log(of_two.interval)) < np.ptp(np.log(humid.interval))


@pytest.mark.parametrize("strips", [3, 6])
def test_strips_that_answer_differently_show_no_effect_that_is_none(strips: int) -> None:
    """Of 300 campaigns in which humidity does nothing on the average 5 % find something: it was 45 %."""
    draw = np.random.default_rng(20261129)
    found = 0
    for _ in range(300):
        rows = campaign(draw, strips=strips, effects=(0.0, 0.0), answers=0.3)
        (humid,) = modelled(rows, (FACTORS["humidity"],)).effects()
        assert humid.p_value is not None
        found += humid.p_value < 0.05
    assert 3 <= found <= 30


def test_a_factor_that_one_strip_alone_shows_beside_another_is_judged_by_the_model() -> None:
    """Without the only strip that was warmed nothing is known of warmth; of the humidity three strips say enough."""
    draw = np.random.default_rng(1)
    conditions = [("a", 60.0, 20.0), ("a", 80.0, 20.0), ("a", 60.0, 30.0)]
    conditions += [(strip, humid, 20.0) for strip in "bc" for humid in (60.0, 80.0)]
    rows = [
        row(float(np.exp(0.1 * draw.normal())), sample=strip, humidity=humid, temperature=warm)
        for strip, humid, warm in conditions * 3
    ]
    model = modelled(rows)
    humid, warm = model.effects()
    assert humid.interval is not None
    assert warm.interval is not None
    whole = model.fit.contrast([0.0, 0.0, 1.0])
    assert np.log(warm.interval) == pytest.approx(whole.interval)


def test_two_strips_do_not_tell_what_thickness_does() -> None:
    """Each has its own thickness: the effect stands there, without an interval, with its reason."""
    rows = [one for one in campaign(np.random.default_rng(3)) if one.sample in ("strip-0", "strip-1")]
    model = modelled(rows)
    thick, humid = model.effects()
    assert thick.interval is None
    assert thick.p_value is None
    assert "no two strips have the same" in thick.reason
    assert humid.interval is not None
    assert model.next_strip({"thickness": 0.18e-3, "humidity": 60.0}) is None
    assert model.strip_deviations() == ()


def test_clamp_pressure_changed_with_every_mounting_is_not_told_from_the_mounting() -> None:
    rows = [
        row(value, sample=sample, mounting=mounting, clamp_pressure=pressure)
        for sample in "abc"
        for mounting, pressure in (("1", 1e4), ("2", 2e4))
        for value in (1.0, 1.1, 1.3)
    ]
    for place, one in enumerate(rows):  # three strips, two mountings each: pressure stands for all that changed between
        rows[place] = row(
            one.metrics["displacement.largest"].value * (1.0 + 0.01 * place),
            sample=one.sample,
            mounting=one.mounting,
            clamp_pressure=one.values["clamp_pressure"] + 5e3 * "abc".index(one.sample),
        )
    (pressure,) = modelled(rows).effects()
    assert pressure.interval is not None  # three mountings are left to scatter
    alone = [one for one in rows if one.sample == "a"]
    (pressure,) = modelled(alone).effects()
    assert pressure.interval is None
    assert "mount the strip again" in pressure.reason


def test_factors_that_change_together_are_named() -> None:
    rows = campaign(np.random.default_rng(4))
    for one in rows:
        dict(one.values)
    tied = [
        RunRow(**{**vars(one), "values": {**one.values, "temperature": one.values["humidity"] / 2.0}}) for one in rows
    ]
    model = modelled(tied)
    assert model.together == {"temperature": ("humidity",)}
    swapped = modelled(tied, (FACTORS["temperature"], FACTORS["humidity"]))
    assert swapped.together == {"humidity": ("temperature",)}


def test_the_next_strip_is_the_textbook_prediction_interval() -> None:
    """With one run a strip: mean plus or minus t times s sqrt(1 + 1/n)."""
    from scipy.stats import t as student

    values = [1.0e-3, 1.3e-3, 0.8e-3, 1.1e-3, 1.6e-3]
    model = modelled([row(value, sample=str(place)) for place, value in enumerate(values)])
    found = model.next_strip({})
    assert found is not None
    logs = np.log(values)
    reach = float(student.ppf(0.975, 4)) * float(np.std(logs, ddof=1)) * math.sqrt(1.2)
    assert found[0] == pytest.approx(math.exp(logs.mean()))
    assert found[1] == pytest.approx((math.exp(logs.mean() - reach), math.exp(logs.mean() + reach)))
    assert model.conditions() == [{}]


def test_a_strip_unlike_the_others_is_named_and_none_where_all_are_alike() -> None:
    rows = campaign(np.random.default_rng(5), scatter=(0.05, 0.03, 0.02))
    assert not any(one.is_unlike for one in modelled(rows).strip_deviations())
    poor = [
        row(
            0.3 * one.metrics["displacement.largest"].value
            if one.sample == "strip-3"
            else one.metrics["displacement.largest"].value,
            sample=one.sample,
            mounting=one.mounting,
            **one.values,
        )
        for one in rows
    ]
    first, *others = modelled(poor).strip_deviations()
    assert (first.sample, first.is_unlike) == ("strip-3", True)
    assert first.value == pytest.approx(0.3, rel=0.2)
    assert not any(one.is_unlike for one in others)


def test_the_next_strip_is_known_by_strips_though_they_are_more_alike_than_repeats() -> None:
    """Which chance does to few strips that differ: repeats, of which there are more, say nothing of another strip."""
    from scipy.stats import t as student

    sizes = {"a": (1.00, 1.21), "b": (1.22, 1.01), "c": (1.01, 1.20), "d": (1.20, 1.00)}
    model = modelled([row(1e-3 * size, sample=name) for name, both in sizes.items() for size in both])
    one = model.fit.new_reading([1.0])
    assert one.freedom > 5.0
    found = model.next_strip({})
    assert found is not None
    assert math.log(found[1][1] / found[0]) == pytest.approx(float(student.ppf(0.975, 3)) * one.standard_error)


def test_of_few_strips_that_are_alike_hardly_any_is_named() -> None:
    """Four in two thicknesses and two humidities; by the freedom of the fit alone 49 of these campaigns name one."""
    draw, named = np.random.default_rng(20261129), 0
    for _ in range(300):
        rows = []
        for strip in range(4):
            own = 0.3 * draw.normal()
            for humidity in (60.0, 80.0):
                size = 1e-3 * math.exp(own + 0.1 * draw.normal())
                rows.append(
                    row(size, sample=f"{strip}", thickness=(0.18 + 0.07 * (strip % 2)) * 1e-3, humidity=humidity)
                )
        named += any(one.is_unlike for one in modelled(rows).strip_deviations())
    assert named <= 20


def test_a_strip_that_scatters_more_is_not_named_for_that() -> None:
    """Seven strips alike, one of which scatters four times as far over its mountings: 11 of these 60 named one."""
    draw, named = np.random.default_rng(20261129), 0
    for _ in range(60):
        rows = [
            row(
                1e-3 * math.exp((0.4 if strip == 0 else 0.1) * draw.normal()), sample=f"{strip}", mounting=f"{mounting}"
            )
            for strip in range(7)
            for mounting in range(3)
        ]
        named += any(one.is_unlike for one in modelled(rows).strip_deviations())
    assert named <= 5


def test_too_few_runs_make_no_model() -> None:
    assert model_metric("displacement.largest", "step", [row(1.0), row(2.0)], EVERY) is None
    assert model_metric("displacement.largest", "step", [row(1.0)] * 5, EVERY) is None
    assert model_metric("force.largest", "step", [row(1.0), row(2.0), row(1.5)], EVERY) is None


def test_chance_is_covered() -> None:
    """A small twin of ``benchmarks/comparison.py``: 200 campaigns by way of the rows."""
    draw = np.random.default_rng(20261121)
    held, found = np.zeros(3), 0
    for _ in range(200):
        rows = campaign(draw, strips=9)
        new, rows = rows[-12:], rows[:-12]
        model = modelled(rows)
        thick, loading, humid = model.effects()
        for place, (effect, truth) in enumerate([(thick, 0.5), (humid, 0.3)]):
            assert effect.interval is not None
            reach = (effect.high - effect.low) / (20.0 if effect.factor.name == "humidity" else 0.07e-3)
            held[place] += effect.interval[0] <= math.exp(truth * reach) <= effect.interval[1]
        assert loading.p_value is not None
        found += loading.p_value < 0.05
        forecast = model.next_strip(new[0].values)
        assert forecast is not None
        held[2] += forecast[1][0] <= new[0].metrics["displacement.largest"].value <= forecast[1][1]
    assert np.all(held >= 178), held
    assert found <= 22


def test_strips_that_all_read_0_tell_nothing_of_another() -> None:
    """As a channel that was not connected."""
    rows = [row for row in campaign(np.random.default_rng(3)) if row.values["loading"] == 0.05]
    for one in rows[1:]:
        if one.sample != rows[0].sample:
            one.metrics["displacement.largest"] = replace(one.metrics["displacement.largest"], value=0.0)
    model = model_metric("displacement.largest", "step", rows, EVERY)
    assert model is None or rows[0].sample not in {one.sample for one in model.strip_deviations()}


def test_runs_of_strips_without_a_name_are_strips_of_their_own() -> None:
    """They would be one strip with many runs, which no campaign had; nor do they say what the next strip reads."""
    rows = [
        replace(one, sample="", mounting="", run=str(place))
        for place, one in enumerate(campaign(np.random.default_rng(3)))
    ]
    model = modelled(rows)
    assert model.samples == ()
    assert model.fit.unseen == ("mounting", "strip")
    assert model.next_strip(model.conditions()[0]) is None
    assert model.strip_deviations() == ()
