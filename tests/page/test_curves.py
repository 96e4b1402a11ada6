"""What a plot is answered about its curves."""

from __future__ import annotations

import json

import numpy as np

from ipmclab import Run
from ipmclab.page.curves import Panel, Series, answer, compared_panels, run_panels
from ipmclab.units import CHANNELS


def head(message: bytes) -> dict[str, object]:
    told: dict[str, object] = json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
    return told


def test_an_answer_about_a_stretch_says_from_when_to_when_there_are_curves() -> None:
    early, late = np.arange(1.0, 9.0), np.arange(3.0, 21.0)
    series = [Series("a", "a", early, early), Series("b", "b", late, late), Series("c", "c", early[:0], early[:0])]
    panels = [Panel.of("current", CHANNELS["current"], series)]
    for begin, end in ((None, None), (4.0, 5.0)):
        assert head(answer(panels, begin, end, 400))["whole"] == [1.0, 20.0]
    nothing = [Panel.of("current", CHANNELS["current"], series[2:])]
    assert head(answer(nothing, None, None, 400))["whole"] is None


def looks_of(panel: Panel) -> list[tuple[int, str]]:
    return [(one.colour, one.style) for one in panel.series]


def test_runs_over_each_other_are_told_apart() -> None:
    time = np.arange(4.0)
    runs = {f"run {k}": Run.from_arrays(time=time, voltage=k + time, hold="zero") for k in range(24)}
    runs["read"] = Run.from_arrays(time=time, voltage=time, current=time, hold="zero")
    voltage, current = run_panels(runs)
    assert [(panel.key, [one.label for one in panel.series]) for panel in (voltage, current)] == [
        ("voltage", list(runs)),
        ("current", ["read"]),
    ]
    assert np.array_equal(voltage.series[5].values, 5.0 + time)
    looks = looks_of(voltage)
    assert {colour for colour, _ in looks} == set(range(8))  # the palette
    assert len(set(looks[:24])) == 24
    assert looks_of(current) == [looks[24]]


def test_slow_readings_stand_at_their_own_times_also_where_they_are_as_many_as_the_rows() -> None:
    time, slow = np.arange(3.0), np.array([0.0, 10.0, 20.0])
    run = Run.from_arrays(time=time, voltage=time, temperature=20.0 + time, time_environment=slow)
    voltage, temperature = run_panels({"a": run})
    assert np.array_equal(voltage.series[0].time, time)
    assert np.array_equal(temperature.series[0].time, slow)


def test_models_over_each_other_are_told_apart_and_from_what_was_measured() -> None:
    models = {f"m{k}": f"model {k}" for k in range(9)}
    row = np.arange(4.0)
    arrays = {
        f"{prefix}.force.{what}": 10.0 * k + place + row
        for k, prefix in enumerate(models)
        for place, what in enumerate(("time", "measured", "model", "residual"))
    }
    above, below = compared_panels(arrays, models, residuals=True)
    assert [panel.key for panel in (above, below)] == ["force", "force.left"]
    measured, *drawn = above.series
    assert [one.label for one in drawn] == [one.label for one in below.series] == list(models.values())
    assert [float(one.values[0]) for one in (measured, *drawn)] == [1.0, *(10.0 * k + 2.0 for k in range(9))]
    assert [float(one.values[0]) for one in below.series] == [10.0 * k + 3.0 for k in range(9)]
    # What is left over of a model looks like the model; voltage and measured curves have the other two colours.
    assert looks_of(below) == looks_of(above)[1:]
    assert [one.colour for one in drawn] == [0, 1, 2, 3, 4, 5, 0, 1, 2]
    assert measured.colour == 7
    # Where neighbours agree, the one below shows through the gaps of the one above.
    styles = [one.style for one in drawn]
    assert all(len(set(styles[k : k + 3])) == 3 for k in range(7))
    assert [panel.key for panel in compared_panels(arrays, models, residuals=False)] == ["force"]
