"""Zeros: what the channels tell at rest, the two of a force, and what their change does to the uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import IpmclabError, check, load_actuator
from ipmclab.model import Actuator
from ipmclab.quality import usable
from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import THESIS_RIG, Rig, VirtualStrip
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.recording.zeroing import read_rest, read_tare, uncertainties, wait_for_preload
from ipmclab.rig.virtual import VirtualBench
from ipmclab.run import QUALITY_FLAGS, ZeroReading
from tests.rig.captured import captured

RATE = 50.0
MN = 1e-3


@pytest.fixture(scope="module")
def strip() -> Actuator:
    return load_actuator("friend-2")


def changed(channel: str, rig: Rig = THESIS_RIG, **values: object) -> Rig:
    channels = tuple(replace(one, **values) if one.name == channel else one for one in rig.channels)
    return replace(rig, channels=channels)


def test_the_rest_is_read_with_its_uncertainty(strip: Actuator) -> None:
    bench = VirtualBench(strip)
    bench.open(["voltage", "current", "force", "relative_humidity"], RATE)
    rest = read_rest(bench, ["voltage", "current", "force", "relative_humidity"], RATE, when="before")
    bench.close()
    assert [(zero.channel, zero.kind, zero.when) for zero in rest.zeros] == [
        ("voltage", "zero", "before"),
        ("current", "zero", "before"),
        ("force", "preload", "before"),
    ]
    # 0.1 mN of the sensor and 240 uV of the converter, over 500 readings.
    noise = np.hypot(0.1 * MN, 240e-6 * 9.80665e-3)
    assert rest.noise["force"] == pytest.approx(noise, rel=0.1)
    assert rest["force"].standard_uncertainty == pytest.approx(noise / np.sqrt(500), rel=0.1)
    assert abs(rest["force"].value - 4.48 * MN) < 5 * rest["force"].standard_uncertainty
    # The standard error of the slope through n readings over T is noise sqrt(12 / n) / T.
    assert rest["force"].drift is not None
    assert abs(rest["force"].drift) < 5 * noise * np.sqrt(12 / 500) / 10.0


def test_a_preload_is_waited_for_until_it_has_settled(strip: Actuator) -> None:
    # 2 mN that go with a time constant of 10 min: 3.3 uN/s at first, below 1.7 uN/s after 7 min.
    rig = replace(THESIS_RIG, virtual=VirtualStrip(preload_drift=2.0 * MN))
    rig = changed("force", rig, sensor_noise=0.0)
    bench = VirtualBench(strip, rig=rig)
    bench.operate("tip on cell")
    seen: list[ZeroReading] = []
    names = ["voltage", "force"]
    bench.open(names, RATE)
    rest = wait_for_preload(
        bench, names, RATE, most_drift=1.7e-6, duration=20.0, longest_wait=900.0, on_reading=seen.append
    )
    assert 380.0 < 20.0 * len(seen) < 440.0
    assert rest["force"] == seen[-1]
    expected = 4.48 * MN - 2.0 * MN * (1.0 - np.exp(-(20.0 * len(seen) - 10.0) / 600.0))
    assert rest["force"].value == pytest.approx(expected, abs=5e-6)
    with pytest.raises(IpmclabError, match=r"still drifts by -1\.\d+ uN/s after 40 s, 0.5 uN/s are allowed"):
        wait_for_preload(bench, names, RATE, most_drift=0.5e-6, duration=20.0, longest_wait=40.0)
    bench.close()


def test_the_force_is_the_reading_less_the_preload_and_both_zeros_are_kept(strip: Actuator) -> None:
    rig = replace(THESIS_RIG, virtual=VirtualStrip(preload_drift=2.0 * MN))
    # A strip that hardly pushes: what the preload changes by is the drift alone.
    bench = VirtualBench(strip.replace(**{"coupling.gain": 0.01 * strip["coupling.gain"]}), rig=rig)
    bench.operate("tip clear")
    before = read_tare(bench, RATE, when="before")
    bench.operate("tip on cell")

    def finish(open_bench: object) -> list[ZeroReading]:
        bench.operate("tip clear")
        names = ("voltage", "current", "force")
        return [read_rest(bench, names, RATE, when="after", force="tare")["force"]]

    outcome = captured(bench, "step 1 V", duration=60.0, rate=RATE, rest_after=20.0, tares=[before], finish=finish)
    run = outcome.run
    assert run is not None
    told = {(zero.channel, zero.kind, zero.when): zero for zero in run.metadata.zeros}
    assert set(told) == {
        ("force", "tare", "before"),
        *((name, "zero", when) for name in ("voltage", "current") for when in ("before", "after")),
        ("force", "preload", "before"),
        ("force", "preload", "after"),
        ("force", "tare", "after"),
    }
    preload = told["force", "preload", "before"].value
    assert run.force is not None
    raw = run.raw["force"] * THESIS_RIG["force"].gain
    assert run.force == pytest.approx(raw - preload, abs=1e-12)
    assert abs(told["force", "tare", "before"].value) < 0.05 * MN
    assert abs(told["force", "tare", "after"].value) < 0.05 * MN
    # 90 s of the drift are in the change of the preload, and that is in the uncertainty.
    change = told["force", "preload", "after"].value - preload
    assert change == pytest.approx(-2.0 * MN * np.exp(-5.0 / 600) * (1 - np.exp(-90.0 / 600)), abs=0.05 * MN)
    assert run.metadata.uncertainties["force"] == pytest.approx(abs(change) / np.sqrt(3.0), rel=0.01)
    assert "current" not in run.metadata.uncertainties  # nothing is subtracted, and the rig file states none


def test_the_parts_of_an_uncertainty() -> None:
    force = replace(THESIS_RIG["force"], uncertainty=0.3 * MN)
    current = replace(THESIS_RIG["current"], uncertainty=1e-4)
    zeros = [
        ZeroReading("force", "tare", "before", 0.0, 0.01 * MN),
        ZeroReading("force", "tare", "after", 1.0 * MN, 0.01 * MN),
        ZeroReading("force", "preload", "before", 4.5 * MN, 0.04 * MN),
        ZeroReading("force", "preload", "after", 5.1 * MN, 0.04 * MN),
        ZeroReading("current", "zero", "before", 1e-4, 2e-6),
    ]
    found = uncertainties([force, current, THESIS_RIG["voltage"]], zeros)
    assert found["force"] == pytest.approx(MN * np.sqrt(0.3**2 + 0.04**2 + 0.6**2 / 3.0))
    assert found["current"] == 1e-4  # its zero is not subtracted: it is told, and that is all
    assert "voltage" not in found


@pytest.mark.parametrize("with_tare", [True, False])
def test_a_tip_that_leaves_the_cell_is_no_force_of_zero(strip: Actuator, with_tare: bool) -> None:
    # 8 times the coupling: the strip pulls its tip off a preload of 4.48 mN at negative voltage.
    strong = strip.replace(**{"coupling.gain": 8 * strip["coupling.gain"]})
    bench = VirtualBench(strong)
    tares = []
    if with_tare:
        bench.operate("tip clear")
        tares = [read_tare(bench, RATE, when="before")]
        bench.operate("tip on cell")
    run = record(bench, "square 1 V 0.05 Hz", duration=40.0, rate=RATE, tares=tares)
    quiet = changed("force", sensor_noise=0.0, converter=replace(THESIS_RIG["force"].converter, noise=0.0))
    truth = record(VirtualBench(strip, rig=quiet), "square 1 V 0.05 Hz", duration=40.0, rate=RATE).force
    assert truth is not None
    assert run.force is not None
    away = 8 * truth < -5.0 * MN
    assert 100 < away.sum() < 1000
    flags = run.quality["force"] & QUALITY_FLAGS["contact_lost"]
    assert np.mean(flags[away] > 0) > 0.999
    assert not flags[8 * truth > -3.0 * MN].any()
    # The reading itself stays, and nothing computes with it.
    assert run.force[away] == pytest.approx(-4.48 * MN, abs=0.5 * MN)
    findings = check(run)
    assert "contact-flagged" in [finding.code for finding in findings]
    assert not usable(run, findings)["force"][flags > 0].any()


def test_a_tip_that_does_not_press_is_refused_before_a_volt(strip: Actuator) -> None:
    bench = VirtualBench(strip)
    bench.operate("tip clear")
    tare = read_tare(bench, RATE, when="before")
    with pytest.raises(IpmclabError, match="the tip does not press") as told:
        record(bench, "step 1 V", duration=1.0, rate=RATE, tares=[tare])
    assert told.value.code == "no-preload"


def test_an_output_that_is_not_at_0_is_found_before_the_run(strip: Actuator) -> None:
    bench = VirtualBench(strip)
    given_out = bench.apply

    def offset(source: object) -> object:
        for block in given_out(source):  # type: ignore[arg-type]
            volts = {**block.readings, "voltage": block.readings["voltage"] + 1.0}
            yield replace(block, readings=volts)

    bench.apply = offset  # type: ignore[method-assign, assignment]
    with pytest.raises(BenchError, match="the output should be at 0 V and 1"):
        record(bench, "step 1 V", duration=1.0, rate=RATE)
