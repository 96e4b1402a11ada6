"""The plan: its steps in the order of section 3.5, and what is refused before anything moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ipmclab import load_actuator, signals
from ipmclab.errors import InputError
from ipmclab.rig.channels import THESIS_RIG, Converter, Rig
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.rig.experiments.plan import Plan, check_answers, make_plan, unanswered
from ipmclab.rig.experiments.steps import reversed_signal

GOOD: dict[str, Any] = {"sample": "strip-1", "signal": "step 1 V", "rate": "50 Hz", "duration": "40 s"}
AIR = {"temperature": "25 degC", "relative_humidity": "80 percent", "settle": "30 min"}


def planned(rig: Rig = THESIS_RIG, *, bytes_free: int = 10**10, actuator: str | None = None, **changes: Any) -> Plan:
    table = {key: value for key, value in (GOOD | changes).items() if value is not None}
    model = load_actuator(actuator) if actuator else None
    return make_plan(experiment_from_table(table), rig, bytes_free=bytes_free, actuator=model)


def names(plan: Plan) -> list[str]:
    return [step.name for step in plan.steps]


def test_the_steps_of_the_thesis() -> None:
    plan = planned(environment=AIR, fingerprint=False)
    assert names(plan) == [
        "hydrate",
        "clamp",
        "chamber-on",
        "equilibrium",
        "chamber-off",
        "zero",
        "preload",
        "apply",
        "hydrate",
    ]
    assert plan.seconds == 1800.0 + 10.0 + (10.0 + 50.0 + 10.0)
    # At room conditions steps 4 to 6 are left out (Friend, section 3.5).
    assert "equilibrium" not in names(planned())
    assert names(planned(steps=["clamp", "apply"], fingerprint=False)) == ["clamp", "apply"]
    text = planned(steps=["clamp", "apply"], fingerprint=False, zero_time="2 s").steps[-1].text
    assert text.endswith("; zeros are read for 2 s before and 2 s after")


def test_pairs_repeats_and_a_baseline() -> None:
    plan = planned(signals=["step 1 V", "sine 1 V 0.1 Hz"], signal=None, pair=True, repeats=2, baseline=True)
    runs = [run for run in plan.runs if run.purpose != "fingerprint"]
    assert [str(run.signal) for run in runs] == ["step 0 V"] + 2 * ["step 1 V", "step -1 V"] + 2 * [
        "sine 1 V 0.1 Hz",
        "sine -1 V 0.1 Hz",
    ]
    assert [run.repeat for run in runs] == [1, 1, 1, 2, 2, 1, 1, 2, 2]
    ids = [run.pair_id for run in runs]
    assert ids[0] is None
    assert len(set(ids[1:])) == 4
    assert ids[1::2] == ids[2::2]
    # Before each run with voltage there is a fingerprint, after it and between runs a pause.
    assert names(plan).count("fingerprint") == 8
    assert names(plan).count("pause") == 8 + 8


@pytest.mark.parametrize(
    "text",
    [
        "sine 1 V 0.1 Hz phase=30 deg offset=0.2 V",
        "square 1 V 0.5 Hz for 2 s then step 0.5 V",
        "prbs 1 V 0.1 s seed=3",
        "samples 0 s 1 V 1 s -0.5 V",
        "chirp 1 V 0.05 Hz 5 Hz",
        "multisine 1 V 0.5 Hz 5 Hz",
    ],
)
def test_the_other_polarity(text: str) -> None:
    signal = signals.parse(text)
    time = np.linspace(0.0, 5.0, 101)
    assert np.allclose(reversed_signal(signal).voltage(time), -signal.voltage(time), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("changes", "code", "where", "words"),
    [
        ({"signal": "step 35 V"}, "voltage-limit", "signal", "the limit is 3.5 V"),
        (
            {"limits": {"voltage": "10 V"}, "signal": "step 12 V"},
            "out-of-range",
            "signal",
            "the output gives -10 V to 10 V",
        ),
        ({"signal": "step 4 V"}, "voltage-limit", "signal", "the limit is 3.5 V"),
        ({"limits": {"voltage": "2 V"}, "signal": "step 3 V"}, "voltage-limit", "signal", "the limit is 2 V"),
        ({"limits": {"votlage": "2 V"}}, "unknown-key", "limits.votlage", "did you mean 'voltage'"),
        ({"rate": "1 MHz"}, "bad-unit", "rate", "Hz"),
        ({"rate": "1e6 Hz", "duration": "1 h"}, "too-many-rows", "duration", "400000000"),
        ({"duration": "1e-6 s", "rest_before": "5 s"}, "too-short", "duration", "nothing of it would be applied"),
        ({"signal": "sine 1 V 50 Hz", "rate": "50 Hz"}, "signal-too-fast", "signal", "give a rate of 100 Hz"),
        ({"bytes_free": 10**6}, "no-room", "", "the disk has"),
        ({"actuator": "friend-2", "limits": {"current": "40 mA"}}, "beyond-limit", "signal", "56.9 mA"),
    ],
)
def test_what_is_refused(changes: dict[str, Any], code: str, where: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        planned(**changes)
    assert where in caught.value.where
    assert words in str(caught.value)
    assert caught.value.code == code


ALONE: dict[str, Any] = {"fingerprint": False, "rest_before": "0 s", "rest_after": "0 s", "rate": "1000 Hz"}


@pytest.mark.parametrize(
    ("rows", "code"), [(1, "too-short"), (2, ""), (6, ""), (7, "too-many-rows"), (8, "too-many-rows")]
)
def test_a_run_has_from_two_rows_to_the_most(rows: int, code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ipmclab.rig.experiments.plan.MOST_ROWS", 6)
    asked = {**ALONE, "duration": f"{rows} ms"}
    if not code:
        assert [run.rows for run in planned(**asked).runs] == [rows]
        return
    with pytest.raises(InputError, match=f"are {rows} rows, a run has 2 to 6") as caught:
        planned(**asked)
    assert caught.value.code == code


def test_a_signal_lasts_for_half_a_row_and_more() -> None:
    """What is shorter is no row of it, and would pass every limit."""
    rested = ALONE | {"rest_before": "5 ms", "signal": "step 3 V", "limits": {"voltage": "2 V"}}
    for duration in ("0.4 ms", "0.5 ms"):
        with pytest.raises(InputError, match="nothing of it would be applied"):
            planned(**rested, duration=duration)
    with pytest.raises(InputError, match="the limit is 2 V"):
        planned(**rested, duration="0.6 ms")
    assert planned(**rested | {"signal": "step 2 V"}, duration="0.6 ms").runs[0].rows == 6


@pytest.mark.parametrize(
    ("most", "volts", "words"),
    [
        ("7 V", -8.0, "the output gives -5 V to 10 V"),
        ("4 V", -8.0, "the limit is 4 V"),
        ("7 V", 8.0, "the limit is 7 V"),
        ("4 V", 4.5, "the limit is 4 V"),
    ],
)
def test_of_output_and_limit_the_narrower_is_told(most: str, volts: float, words: str) -> None:
    lopsided = replace(THESIS_RIG, output=replace(THESIS_RIG.output, low=-5.0))
    with pytest.raises(InputError, match=words):
        planned(lopsided, signal=f"step {volts} V", limits={"voltage": most})


def test_a_channel_that_the_rig_lacks() -> None:
    blind = replace(THESIS_RIG, channels=tuple(one for one in THESIS_RIG.channels if one.name != "force"))
    with pytest.raises(InputError, match="has no channel 'force'"):
        planned(blind)


def test_what_is_remarked() -> None:
    assert any("1.23 V" in remark for remark in planned(signal="step 2 V").remarks)
    # The square of 1 V draws 99 mA at each reversal through 10 ohm and more: within 200 mA, beyond 80 % of 0.1 A.
    narrow = replace(
        THESIS_RIG,
        channels=tuple(
            replace(one, converter=Converter(-0.1, 0.1, noise=0.0)) if one.name == "current" else one
            for one in THESIS_RIG.channels
        ),
    )
    assert any(
        "wider range" in remark for remark in planned(narrow, signal="square 1 V 0.1 Hz", actuator="friend-2").remarks
    )
    assert not any("wider range" in remark for remark in planned(signal="step 1 V", actuator="friend-2").remarks)


def test_who_changes_the_strip_is_told_which() -> None:
    asked = {step.name: step.question.text for step in planned(weigh=True).steps if step.question is not None}
    assert all(asked[name].startswith("strip-1: ") for name in ("hydrate", "weigh", "clamp"))


def test_answers_are_known_beforehand() -> None:
    plan = planned()
    assert unanswered(plan, {"hydrate": "done"}) == ["clamp", "zero", "preload"]
    check_answers(plan, {"clamp": "kept", "fingerprint": "continue"})
    with pytest.raises(InputError, match="no step 'clmap' asks a question; did you mean 'clamp'"):
        check_answers(plan, {"clmap": "done"})
    with pytest.raises(InputError, match="'maybe' is no answer to 'clamp'"):
        check_answers(plan, {"clamp": "maybe"})


@pytest.mark.parametrize("rate", ["70 kHz", "200 kHz", "500 kHz"])
def test_a_rate_that_no_module_can_do_is_told_before_anything_moves(rate: str) -> None:
    chassis = replace(THESIS_RIG, bench="ni")
    with pytest.raises(InputError, match=r"experiment: rate: .* the 4 channels on cDAQ1Mod1 are read at 62500 Hz"):
        planned(chassis, rate=rate)
    assert planned(chassis, rate="62.5 kHz").runs
    assert planned(rate=rate).runs  # a virtual bench can do any


def test_a_rate_at_which_a_chassis_is_looked_at_too_seldom_is_told_before_anything_moves() -> None:
    chassis = replace(THESIS_RIG, bench="ni")
    with pytest.raises(InputError, match=r"experiment: rate: .* on a chassis it is 25 Hz at least"):
        planned(chassis, rate="24.9 Hz")
    assert planned(chassis, rate="25 Hz").runs
    assert planned(rate="24.9 Hz").runs


def test_fewer_channels_are_read_faster_than_the_output_goes() -> None:
    chassis = replace(THESIS_RIG, bench="ni", channels=(THESIS_RIG["voltage"], THESIS_RIG["current"]))
    with pytest.raises(InputError, match="the output is given out at 100000 Hz at most"):
        planned(chassis, rate="120 kHz", measured=["current"])


def test_a_limit_that_is_not_measured_is_said_not_to_be_watched() -> None:
    plan = planned(measured=["current", "displacement"], limits={"force": "5 mN"})
    assert plan.as_dict()["limits"]["force"] == "not watched: it is not measured"
    assert "not watched" not in plan.as_dict()["limits"]["voltage"]
    assert "the limit of the force is not watched: it is not measured" in plan.remarks


def test_the_limit_that_is_proposed_for_a_small_current_is_enough() -> None:
    """It was rounded to whole milliamperes: "0 mA"."""
    asked = {"signal": "step 5 mV", "actuator": "friend-2", "fingerprint": False}
    with pytest.raises(InputError, match="is expected to draw") as caught:
        planned(**asked, limits={"current": "0.1 mA"})
    proposed = caught.value.repair.partition('limits.current = "')[2].rstrip('"')
    assert planned(**asked, limits={"current": proposed}).runs


def test_what_the_guard_would_end_is_told_before_anything_moves() -> None:
    """Only the peak of the current was foretold: the guard ended a run that the plan had found nothing against."""

    def told(**limits: str) -> list[str]:
        plan = planned(
            signal="step 3 V", actuator="friend-1-measured", fingerprint=False, limits={"current": "0.3 A", **limits}
        )
        return [one for one in plan.remarks if "the guard" in one]

    (remark,) = told()
    assert "ended by the guard at 5.62 s" in remark
    assert "the mean power over 1 s is 0.4534 W" in remark
    assert "state limits.power where" in remark
    assert told(power="0.6 W") == []


@pytest.mark.parametrize(
    ("steps", "told"),
    [
        (None, ""),
        (["chamber-on", "equilibrium", "apply"], ""),
        (["chamber-on", "apply"], "no step is equilibrium:"),
        (["apply"], "no step is chamber-on or equilibrium:"),
    ],
)
def test_a_condition_that_no_step_brings_about_is_told(steps: list[str] | None, told: str) -> None:
    asked = planned(environment={"temperature": "25 degC"}, steps=steps, fingerprint=False)
    assert ["".join(one.partition("no step is")[1:])[: len(told)] for one in asked.remarks if "stated, and" in one] == (
        [told] if told else []
    )
