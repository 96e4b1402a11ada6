"""Units that were read as others: nothing where they are right, exactly that finding where one is off by 1000."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import Actuator, Run, check, identify, import_run, load_actuator, simulate
from ipmclab.consistency import cross_check
from ipmclab.quality import scale
from ipmclab.quality.record import Record
from tests.profiles import costly

MAPS = Path(__file__).parents[2] / "docs" / "import_maps"
SAMPLES = (
    *(f"friend-{sample}-measured" for sample in (1, 3, 4, 5, 6, 7)),
    "friend-2-measured-displacement",
    "friend-2-measured-force",
)
SIGNALS = ("step 1 V", "step 3 V delay=5 s", "sine 1 V 0.1 Hz", "sine 1 V 1 Hz", "square 1 V 0.1 Hz", "prbs 1 V")
REAL = ("step_1V", "step_2V", "step_2V_poor", "step_3V")


def found(run: Run, actuator: Actuator | None = None) -> list[str | None]:
    return [finding.channel for finding in check(run, actuator) if finding.code == scale.CODE]


def times(run: Run, what: str, factor: float) -> Run:
    return replace(run, **{what: factor * getattr(run, what)})


@costly()
@given(
    sample=st.sampled_from(SAMPLES),
    signal=st.sampled_from(SIGNALS),
    rate=st.sampled_from([25.0, 50.0, 1000.0]),
    what=st.sampled_from(["time", "current", "displacement", "force", "voltage"]),
    factor=st.sampled_from([1000.0, 0.001]),
    told=st.booleans(),
)
def test_one_unit_is_off_and_nothing_else_is_said(
    sample: str, signal: str, rate: float, what: str, factor: float, told: bool
) -> None:
    actuator = load_actuator(sample)
    run = simulate(actuator, signal, duration=20.0, rate=rate)
    strip = actuator if told else None
    assert found(run, strip) == []
    if what == "voltage" and factor < 1.0:
        return  # that is no voltage at all
    wrong = check(times(run, what, factor), strip)
    assert (wrong[0].code, wrong[0].severity) == (scale.CODE, "error")
    assert found(times(run, what, factor), strip) == [None if what == "time" else what]
    right = {(finding.code, finding.channel) for finding in check(run, strip)}
    assert {(finding.code, finding.channel) for finding in wrong[1:]} <= right


def real(folder: Path, name: str) -> Run:
    return import_run(folder / f"{name}.csv.gz", MAPS / f"{name}.toml")


@pytest.mark.parametrize("name", REAL)
def test_the_real_records(real_runs: Path, name: str) -> None:
    run = real(real_runs, name)
    assert found(run) == []
    for what in ("time", "current", "displacement"):
        for factor in (1000.0, 0.001):
            assert found(times(run, what, factor)) == [None if what == "time" else what]
    # Their force is nothing but noise: that is too much for a strip, or says nothing.
    assert found(times(run, "force", 1000.0)) == ["force"]
    assert found(times(run, "force", 0.001)) == []


def test_what_is_known_is_what_known_strips_show(real_runs: Path) -> None:
    """The table's ends against the samples' simulated runs and the real records: within 15 %, and none beyond it."""
    shown: dict[str, list[float]] = {}
    other = load_actuator("friend-2").replace(
        **{"geometry.free_length": 25e-3, "geometry.thickness": 0.5e-3, "geometry.sensing_length": 15e-3}
    )
    runs = [(real(real_runs, name), other) for name in REAL]
    for sample in SAMPLES:
        actuator = load_actuator(sample)
        for signal in (*SIGNALS, "step 3 V", "sine 1 V 0.01 Hz"):
            runs.append((simulate(actuator, signal, duration=40.0, rate=50.0), actuator))
    for run, actuator in runs:
        noise = frozenset(f.channel for f in check(run) if f.code == "noise-only" and f.channel)
        seen = scale.scales_of(Record.of(run), noise)
        by = scale.per_dimensions(actuator)
        for name, value in seen.per_volt.items():
            if name not in seen.hidden:
                shown.setdefault(name, []).append(value * by[name])
        without = scale.scales_of(Record.of(replace(run, current=None)), noise)
        shown.setdefault("time", []).extend(one.settling for one in (seen, without) if one.settling is not None)
    for name, (least, most) in scale.KNOWN.items():
        assert least == pytest.approx(min(shown[name]), rel=0.15), name
        assert most == pytest.approx(max(shown[name]), rel=0.15), name
        low, high = scale.bounds(name)
        assert 1000.0 * least > high
        assert most / 1000.0 < low


def test_the_words() -> None:
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=20.0, rate=50.0)
    (large,) = (f for f in check(times(run, "current", 1000.0)) if f.code == scale.CODE)
    assert "the current is about 1000 times too large" in large.message
    assert "mA may have been read as A" in large.message
    (long,) = (f for f in check(times(run, "time", 1000.0)) if f.code == scale.CODE)
    assert "the time is about 1000 times too long" in long.message
    assert "ms may have been read as s" in long.message
    assert "read the record again" in long.repair
    (volts,) = (f for f in check(times(run, "voltage", 1000.0)) if f.code == scale.CODE)
    assert "it reaches 1000 V" in volts.message
    assert "mV may have been read as V" in volts.message


def test_identify_says_it_first_and_proposes_no_stage() -> None:
    strip = load_actuator("friend-2")
    run = simulate(load_actuator("friend-2+leak.exponential"), "step 2 V", duration=20.0, rate=25.0)
    fit = identify(strip, [times(run, "current", 1000.0)], free=["electrical"])
    assert fit.findings[0].code == scale.CODE
    assert "1000 times too large" in fit.findings[0].message
    assert {finding.code for finding in fit.findings if finding.effect == "none"} == {scale.CODE}
    assert fit.diagnoses == ()
    assert fit.message.endswith(f"but errors contradict this fit (see the findings {scale.CODE})")


def test_facts_of_a_record_in_wrong_units_are_held_against_nothing() -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V", duration=20.0, rate=50.0)
    right = {finding.code for finding in cross_check(strip, [run])}
    for what in ("time", "current", "displacement", "force"):
        assert {finding.code for finding in cross_check(strip, [times(run, what, 1000.0)])} <= right
