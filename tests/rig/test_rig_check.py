"""A rig that is fit for its strip has nothing to mend; each thing that is wrong with one is told with its repair."""

from __future__ import annotations

import datetime
from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Finding, load_actuator, simulate
from ipmclab.rig.bench import BenchError, Block
from ipmclab.rig.channels import THESIS_RIG, Converter, Rig, Thermometer
from ipmclab.rig.checks.check import RigCheck, check_rig
from ipmclab.rig.checks.ranges import expected_peak
from ipmclab.rig.virtual import VirtualBench
from ipmclab.signals import Signal

TODAY = datetime.date(2026, 11, 21)
STRIP = load_actuator("friend-2")


def changed(name: str, **values: object) -> Rig:
    return replace(
        CALIBRATED,
        channels=tuple(replace(one, **values) if one.name == name else one for one in CALIBRATED.channels),
    )


CALIBRATED = replace(
    THESIS_RIG,
    channels=tuple(replace(one, calibrated="2026-10-01") for one in THESIS_RIG.channels),
    output=replace(THESIS_RIG.output, current_limit=None),  # but for the test of it
)


def looked_at(rig: Rig = CALIBRATED, *operate: str, amplitude: float = 1.0) -> RigCheck:
    bench = VirtualBench(rig=rig)
    for words in operate:
        bench.operate(words)
    return check_rig(bench, STRIP, amplitude=amplitude, today=TODAY)


def only(found: RigCheck) -> Finding:
    assert len(found.findings) == 1, found.findings
    return found.findings[0]


def test_a_rig_that_is_fit_has_nothing_to_mend() -> None:
    found = looked_at()
    assert found.findings == ()
    assert found.peak_current == pytest.approx(1.0 / 17.0)  # 2 x 8 ohm of electrode and 1 ohm of shunt
    assert found.temperature == pytest.approx(22.0)
    told = {one.channel.name: one for one in found.channels}
    assert told["force"].reading == pytest.approx(4.48e-3, abs=3e-5)
    assert told["force"].noise == pytest.approx(1e-4, rel=0.3)
    assert told["displacement"].reading == pytest.approx(12.3e-3, abs=1e-6)
    assert told["current"].expected == pytest.approx(2.0 / 17.0)
    assert told["current"].channel.resolution == pytest.approx(0.4 / 2**16)


def test_200_mA_over_1_ohm_need_a_range_of_1_volt() -> None:
    finding = only(looked_at(amplitude=1.6))
    assert (finding.code, finding.severity, finding.channel) == ("range-too-small", "warning", "current")
    assert "188 mA at a polarity reversal, twice the 94.1 mA of an edge of 1.6 V, give 0.188 V" in finding.message
    assert finding.repair.startswith('write range = ["-1 V", "1 V"]')
    assert only(looked_at(amplitude=3.0)).severity == "error"
    wide = Converter(-1.0, 1.0, 26e-6)
    assert looked_at(changed("current", converter=wide), amplitude=3.0).findings == ()
    # Where no range is wide enough it is the amplitude or the shunt that must be smaller.
    finding = next(one for one in looked_at(changed("current", gain=0.01)).findings if one.code == "range-too-small")
    assert (finding.severity, finding.repair) == ("error", "take a smaller amplitude, or a smaller shunt")


def test_a_voltage_beyond_its_input_is_told() -> None:
    codes = {(one.code, one.channel, one.severity) for one in looked_at(amplitude=6.0).findings}
    assert ("range-too-small", "voltage", "error") in codes
    assert ("output-range", None, "error") in {
        (one.code, one.channel, one.severity) for one in looked_at(amplitude=11.0).findings
    }


def test_what_the_amplifier_delivers_is_held_against_the_expected_current() -> None:
    wide = changed("current", converter=Converter(-1.0, 1.0, 26e-6))
    limited = replace(wide, output=THESIS_RIG.output)
    assert THESIS_RIG.output.current_limit == 0.3
    assert looked_at(limited, amplitude=2.5).findings == ()  # 294 mA at a reversal
    finding = only(looked_at(limited, amplitude=3.0))
    assert (finding.code, finding.severity) == ("amplifier-limit", "warning")
    assert "a polarity reversal draws 353 mA, the amplifier delivers 300 mA" in finding.message
    weak = replace(wide, output=replace(THESIS_RIG.output, current_limit=0.05))
    assert (only(looked_at(weak)).severity, only(looked_at(weak)).values["expected"]) == (
        "error",
        pytest.approx(1 / 17),
    )


def test_the_resolution_is_the_coarser_of_sensor_and_converter() -> None:
    laser = THESIS_RIG["displacement"]
    assert laser.resolution == 1.25e-6 > laser.gain * laser.converter.step
    assert replace(laser, sensor_resolution=0.1e-6).resolution == laser.gain * laser.converter.step


@pytest.mark.parametrize(
    ("rig", "operate", "code", "severity", "words"),
    [
        (CALIBRATED, ["laser blocked"], "nothing-seen", "error", "the sensor gives 1.5 V"),
        (CALIBRATED, ["tip clear"], "no-preload", "warning", "the tip does not lie on it"),
        (changed("force", rest=90e-3), [], "large-preload", "warning", "the load cell reads 90 mN already"),
        (changed("displacement", rest=3e-3), [], "not-in-the-middle", "warning", "rests at 3 mm of 0 mm to 25 mm"),
        (CALIBRATED, ["humidity 0 percent", "wait"], "implausible-humidity", "warning", "transmitter reads"),
        (CALIBRATED, ["temperature 149 degC", "wait"], "implausible-temperature", "error", "reads 149 degC"),
        (
            changed("displacement", converter=Converter(-5.0, 5.0, 116e-6), rest=6.5e-3),
            [],
            "range-too-small",
            "warning",
            "the sensor gives up to 10 V, its input reads up to 5 V",
        ),
        (changed("current", calibrated="2025-10-01"), [], "old-calibration", "warning", "416 days ago, on 2025-10-01"),
        (changed("current", calibrated=None), [], "no-calibration", "info", "no date of calibration is stated for cur"),
        (changed("current", gain=1.1), [], "scale-differs-from-shunt", "warning", "1.1 A for 1 V, the shunt of 1 ohm"),
        (changed("force", sensor_noise=0.0), [], None, "", ""),
    ],
)
def test_what_is_wrong_is_told(rig: Rig, operate: list[str], code: str | None, severity: str, words: str) -> None:
    bench = VirtualBench(rig=rig)
    for word in operate:
        if word == "wait":
            bench.plant.advance([1e5], {})
        else:
            bench.operate(word)
    found = check_rig(bench, STRIP, today=TODAY)
    if code is None:
        assert found.findings == ()
        return
    finding = only(found)
    assert (finding.code, finding.severity) == (code, severity)
    assert words in finding.message
    assert finding.repair


class Faulty(VirtualBench):
    """A bench whose readings are off, or that lacks a channel."""

    def __init__(self, *, add: dict[str, float] | None = None, missing: str = "", noise: float = 0.0) -> None:
        super().__init__(rig=CALIBRATED)
        self.add, self.missing, self.noise = add or {}, missing, noise
        self.given = 0.0

    def open(self, measured: Collection[str], rate: float) -> None:
        if self.missing in measured:
            raise BenchError("there is no such channel", code="daq-200170", where=self.missing, repair="correct it")
        super().open(measured, rate)

    def apply(self, signal: Signal, rows: int) -> Iterator[Block]:
        rng = np.random.default_rng(20261121)
        for block in super().apply(signal, rows):
            self.given = max(self.given, float(np.abs(block.output).max()))
            readings = {
                name: CALIBRATED[name].converter.convert(
                    values + self.add.get(name, 0.0) + self.noise * rng.standard_normal(len(values))
                )
                for name, values in block.readings.items()
            }
            yield replace(block, readings=readings)


@pytest.mark.parametrize(
    ("bench", "code", "channel", "words"),
    [
        (Faulty(add={"voltage": 1.5}), "output-not-zero", "voltage", "the output was set to 0 V and gives 1.5 V"),
        (Faulty(add={"current": 0.01}), "current-offset", "current", "at 0 V it reads 10 mA"),
        (Faulty(add={"force": 20.0}), "at-limit", "force", "it reads 10 V, the end of its range"),
        (Faulty(missing="force"), "daq-200170", "force", "force: there is no such channel"),
    ],
)
def test_what_a_bench_reads_wrongly_is_told(bench: Faulty, code: str, channel: str, words: str) -> None:
    found = check_rig(bench, STRIP, today=TODAY)
    assert (code, channel) in {(one.code, one.channel) for one in found.findings}
    assert any(words in one.message for one in found.findings)
    assert bench.given == 0.0
    if bench.missing:
        told = {one.channel.name: one.reading for one in found.channels}
        assert [name for name, value in told.items() if value is None] == ["force"]


def test_noise_beyond_the_data_sheet_is_told() -> None:
    found = check_rig(Faulty(noise=0.1), STRIP, today=TODAY)
    noisy = {one.channel for one in found.findings if one.code == "noisy"}
    assert {"voltage", "current", "force"} <= noisy


def test_a_thermometer_that_is_not_read_is_told() -> None:
    class Without(VirtualBench):
        def apply(self, signal: Signal, rows: int) -> Iterator[Block]:
            for block in super().apply(signal, rows):
                yield replace(block, temperature=np.empty(0))

    rig = replace(CALIBRATED, thermometer=Thermometer("cDAQ1Mod3/ai1"))
    finding = only(check_rig(Without(rig=rig), STRIP, today=TODAY))
    assert (finding.code, finding.channel) == ("no-temperature", "temperature")


def test_a_bench_that_is_gone_stops_the_check() -> None:
    class Gone(VirtualBench):
        def open(self, measured: Collection[str], rate: float) -> None:
            raise BenchError("nobody answers", code="bench-lost", where="127.0.0.1:1", repair="start it")

    with pytest.raises(BenchError, match="nobody answers"):
        check_rig(Gone(rig=CALIBRATED), STRIP)


def test_one_fault_of_several_channels_is_told_once() -> None:
    class Without(VirtualBench):
        def open(self, measured: Collection[str], rate: float) -> None:
            for name in measured:
                if name in ("current", "force"):
                    raise BenchError("there is no module 'M'", code="no-device", where=name, repair="mend it")
            super().open(measured, rate)

    finding = only(check_rig(Without(rig=CALIBRATED), STRIP, today=TODAY))
    assert (finding.code, finding.channel) == ("no-device", None)
    assert finding.message == "current, force: there is no module 'M'"


@pytest.mark.parametrize("name", ["friend-2+clamp", "friend-2+line.modes=6", "friend-2+clamp+line.segments=5"])
def test_the_peak_of_a_strip_that_draws_past_its_electrodes_is_foreseen(name: str) -> None:
    """The first row of a step behind the rig's own resistances, which is far above V/2R_e."""
    behind = THESIS_RIG.shunt_resistance + THESIS_RIG.source_resistance
    strip = load_actuator(name)
    loaded = strip.replace(**{"circuit.contact_resistance": behind})
    run = simulate(loaded, "step 2 V", duration=1.0, rate=50.0)
    assert run.current is not None
    assert expected_peak(THESIS_RIG, strip, 2.0) == pytest.approx(run.current[0], rel=1e-3)
    assert run.current[0] > 2.0 * expected_peak(THESIS_RIG, STRIP, 2.0)
