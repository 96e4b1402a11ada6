"""The virtual bench against the model behind it, Kirchhoff's law, and the statistics of its noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import InputError, IpmclabError, Run, RunMetadata, Sample, load_actuator, signals, simulate
from ipmclab.model import Actuator
from ipmclab.rig.channels import THESIS_RIG, Channel, Converter, Rig
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.virtual import VirtualBench
from ipmclab.run import QUALITY_FLAGS

SEED = 20261121


@pytest.fixture(scope="module")
def strip() -> Actuator:
    return load_actuator("friend-2")


def changed(rig: Rig, channel: str, **values: object) -> Rig:
    """The rig with another value in one channel."""
    return replace(rig, channels=tuple(replace(one, **values) if one.name == channel else one for one in rig.channels))


def quiet(rig: Rig = THESIS_RIG) -> Rig:
    """The rig without noise."""
    channels = [replace(one, sensor_noise=0.0, converter=replace(one.converter, noise=0.0)) for one in rig.channels]
    return replace(rig, channels=tuple(channels))


def in_series(strip: Actuator, resistance: float) -> Actuator:
    return strip.replace(**{"circuit.contact_resistance": strip["circuit.contact_resistance"] + resistance})


def given_out(signal: str, rows: int, rate: float) -> np.ndarray:
    """The output since the row before each row: nothing before row 0."""
    return np.concatenate([[0.0], signals.parse(signal).voltage(np.arange(rows - 1) / rate)])


@pytest.mark.parametrize("text", ["step 1 V", "sine 1 V 0.1 Hz", "prbs 1.5 V 0.3 s"])
@pytest.mark.parametrize("channel", ["displacement", "force"])
def test_without_noise_a_record_is_the_simulation_to_half_a_step(strip: Actuator, text: str, channel: str) -> None:
    run = record(VirtualBench(strip, rig=quiet()), text, duration=30.0, rate=50.0, measured=("current", channel))
    exact = simulate(in_series(strip, 1.0), given_out(text, 1500, 50.0), duration=30.0, rate=50.0, hold="zero-before")
    assert run.hold == "zero-before"
    assert np.array_equal(run.time, exact.time)
    for name in ("voltage", "current", channel):
        # The zero is rounded too.
        steps = 1.0 if THESIS_RIG[name].zeroed else 0.5
        error = np.abs(run.channels[name] - exact.channels[name]).max()
        assert error <= steps * THESIS_RIG[name].resolution * (1.0 + 1e-9)
        assert np.ptp(run.channels[name]) > 50 * THESIS_RIG[name].resolution


def test_a_step_shows_one_row_after_it_is_given(strip: Actuator) -> None:
    run = record(VirtualBench(strip, rig=quiet()), "step 1 V", duration=2.0, rate=50.0)
    assert run.voltage[:3] == pytest.approx([0.0, 1.0, 1.0], abs=1e-4)
    assert run.current is not None
    assert run.current[0] == 0.0
    # Row 1 is read one period after the edge: the peak at the edge itself is not seen.
    peak_at_edge = 1.0 / in_series(strip, 1.0).circuit_elements().electrode
    assert 0.02 < run.current[1] < peak_at_edge


@pytest.mark.parametrize("resistance", [1.0, 5.0])
def test_the_shunt_takes_its_share(strip: Actuator, resistance: float) -> None:
    text, rows = "square 1 V 0.5 Hz", 500
    upstream = replace(quiet(), shunt_resistance=resistance, voltage_sensed="upstream of shunt")
    electrodes = replace(upstream, voltage_sensed="electrodes")
    above = record(VirtualBench(strip, rig=upstream), text, duration=10.0, rate=50.0, measured=["current"])
    below = record(VirtualBench(strip, rig=electrodes), text, duration=10.0, rate=50.0, measured=["current"])
    expected = simulate(
        in_series(strip, resistance), given_out(text, rows, 50.0), duration=10.0, rate=50.0, hold="zero-before"
    )
    assert above.current is not None
    assert below.current is not None
    assert above.current == pytest.approx(expected.current, abs=4e-6)
    assert below.current == pytest.approx(expected.current, abs=4e-6)
    assert above.voltage == pytest.approx(given_out(text, rows, 50.0), abs=1e-4)
    assert below.voltage == pytest.approx(above.voltage - resistance * above.current, abs=2e-4)
    assert np.abs(below.voltage - above.voltage).max() > 0.03 * resistance
    assert (above.metadata.voltage_sensed, below.metadata.voltage_sensed) == ("upstream of shunt", "electrodes")
    assert above.metadata.shunt_resistance == below.metadata.shunt_resistance == resistance


def test_noise_is_that_of_the_data_sheets(strip: Actuator) -> None:
    # At 0 V nothing but noise is left; the converter's rounding adds step / sqrt(12).
    rest = {
        name: record(
            VirtualBench(strip), "step 0 V", duration=20.0, rate=1e3, zero_time=0.5, measured=["current", name]
        )
        for name in ("force", "displacement")
    }
    stated = {
        "voltage": 116e-6,
        "current": 10e-6,
        "displacement": 240e-6 * 3.125e-3,
        "force": np.hypot(0.1e-3, 240e-6 * 98.0665e-3 / 10.0),
    }
    for name, noise in stated.items():
        values = rest["displacement" if name == "displacement" else "force"].channels[name]
        step = abs(THESIS_RIG[name].gain) * THESIS_RIG[name].converter.step
        expected = np.hypot(noise, step / np.sqrt(12.0))
        n = len(values)
        assert np.std(values) == pytest.approx(expected, rel=4.0 / np.sqrt(2 * n))
        # The zero is the mean of 500 readings.
        assert abs(np.mean(values)) < 4.0 * expected * np.sqrt(1.0 / n + 1.0 / 500)
        assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 4.0 / np.sqrt(n)
    voltage, current = rest["force"].channels["voltage"], rest["force"].channels["current"]
    assert abs(np.corrcoef(voltage, current)[0, 1]) < 4.0 / np.sqrt(len(voltage))


def test_a_reading_stays_within_the_range_of_its_converter(strip: Actuator) -> None:
    narrow = changed(quiet(), "current", converter=Converter(-0.05, 0.05, noise=0.0))
    wide = record(VirtualBench(strip, rig=quiet()), "square 1 V 0.5 Hz", duration=4.0, rate=50.0)
    run = record(VirtualBench(strip, rig=narrow), "square 1 V 0.5 Hz", duration=4.0, rate=50.0)
    assert run.current is not None
    assert wide.current is not None
    step = 0.1 / 2**16
    clipped = (wide.current > 0.05) | (wide.current < -0.05)
    assert clipped.sum() > 4
    assert np.array_equal(np.unique(run.current[clipped]), np.array([-0.05, 0.05 - step]))
    assert run.metadata.ranges["current"] == pytest.approx((-0.05, 0.05 - step))
    assert np.array_equal(run.quality["current"] == QUALITY_FLAGS["clipped"], clipped)
    assert "current" not in wide.quality


def test_the_laser_loses_a_tip_that_leaves_its_range(strip: Actuator) -> None:
    # 40 times the coupling: the tip of the simulated strip, 0.6 mm, goes far beyond 12 mm.
    lively = strip.replace(**{"coupling.gain": 40 * strip["coupling.gain"]})
    run = record(
        VirtualBench(lively), "sine 1 V 0.1 Hz", duration=10.0, rate=50.0, measured=["current", "displacement"]
    )
    exact = simulate(
        in_series(lively, 1.0), given_out("sine 1 V 0.1 Hz", 500, 50.0), duration=10.0, rate=50.0, hold="zero-before"
    )
    assert run.displacement is not None
    assert exact.displacement is not None
    # At rest the tip is at 12.3 mm of 25 mm (appendix A.2).
    low, high = run.metadata.ranges["displacement"]
    assert (low, high) == pytest.approx((-12.3e-3, 12.7e-3), abs=2e-6)
    seen = (exact.displacement > low) & (exact.displacement < high)
    near = (np.abs(exact.displacement - low) < 1e-5) | (np.abs(exact.displacement - high) < 1e-5)
    assert 50 < seen.sum() < 450
    assert np.array_equal(np.isfinite(run.displacement)[~near], seen[~near])
    assert run.displacement[seen & ~near] == pytest.approx(exact.displacement[seen & ~near], abs=1e-5)
    assert run.quality["displacement"][~seen & ~near].tolist() == [3] * int((~seen & ~near).sum())


@pytest.mark.parametrize(
    ("gain", "lost", "side"), [(0.01, 0.5, -1), (0.01, 11.0, 1), (-0.01, -11.0, -1), (-0.01, 0.5, 1)]
)
def test_a_reading_is_lost_beyond_the_range_on_the_side_of_its_error_value(gain: float, lost: float, side: int) -> None:
    # A sensor that gives 2 V to 10 V, or -10 V to -2 V, over its range; the limit is halfway to the error value.
    ends = (2.0, 10.0) if gain > 0 else (-10.0, -2.0)
    sensor_range = tuple(sorted(gain * volts for volts in ends))
    channel = Channel("displacement", Converter(-12.0, 12.0, 0.0), gain=gain, sensor_range=sensor_range, lost=lost)
    limit = (lost + ends[0 if side < 0 else 1]) / 2
    readings = np.array([lost, limit + side * 0.01, limit - side * 0.01, ends[0], -6.0 if gain < 0 else 6.0, ends[1]])
    assert channel.is_lost(readings).tolist() == [True, True, False, False, False, False]


def test_the_load_cell_is_pushed_only_and_has_its_limit(strip: Actuator) -> None:
    # Forces beyond the preload of 4.48 mN pull the tip off the cell; 10 gf, 98.07 mN, is its limit.
    strong = strip.replace(**{"coupling.gain": 100 * strip["coupling.gain"]})
    run = record(VirtualBench(strong, rig=quiet()), "sine 1 V 0.1 Hz", duration=10.0, rate=50.0)
    assert run.force is not None
    step = 10 * 9.80665e-3 / 10.0 * 20.0 / 2**16
    assert run.force.min() == pytest.approx(-4.48e-3, abs=step)
    assert run.force.max() == pytest.approx(10 * 9.80665e-3 - 4.48e-3, abs=2 * step)
    assert run.metadata.ranges["force"] == pytest.approx((-4.48e-3, 93.5865e-3), abs=2 * step)


def test_the_seed_decides_the_noise(strip: Actuator) -> None:
    def recorded(seed: int) -> Run:
        return record(VirtualBench(strip, seed=seed), "step 1 V", duration=2.0, rate=50.0)

    assert recorded(SEED).content_sha256 == recorded(SEED).content_sha256
    assert recorded(SEED).content_sha256 != recorded(SEED + 1).content_sha256
    bench = VirtualBench(strip, seed=SEED)
    first = record(bench, "step 1 V", duration=2.0, rate=50.0)
    bench.operate("rest")
    second = record(bench, "step 1 V", duration=2.0, rate=50.0)
    assert first.content_sha256 == recorded(SEED).content_sha256
    assert first.content_sha256 != second.content_sha256
    # The second record starts from rest as well, for the strip was left alone: it differs by noise alone.
    assert first.current == pytest.approx(second.current, abs=1e-4)


def test_a_strip_that_was_just_driven_does_not_start_from_rest(strip: Actuator) -> None:
    bench = VirtualBench(strip)

    def recorded(text: str, zero_time: float = 10.0) -> Run:
        return record(bench, text, duration=20.0, rate=50.0, zero_time=zero_time, measured=["current"])

    assert recorded("step 1 V").metadata.starts_from_rest is True
    driven = recorded("step -1 V", zero_time=1.0)
    assert driven.current is not None
    assert driven.current[0] < -2e-3
    assert driven.metadata.starts_from_rest is False
    bench.operate("rest")
    assert recorded("step 1 V").metadata.starts_from_rest is True


def test_a_current_that_stands_still_may_be_an_offset_or_a_charge(strip: Actuator) -> None:
    # 0.1 mA are 16 steps of the converter.
    current = replace(THESIS_RIG["current"], rest=1e-4)
    channels = tuple(current if one.name == "current" else one for one in THESIS_RIG.channels)
    bench = VirtualBench(strip, rig=replace(THESIS_RIG, channels=channels))
    run = record(bench, "step 1 V", duration=1.0, rate=50.0)
    assert run.metadata.starts_from_rest is None


def test_a_discharge_that_is_nothing_beside_the_run_leaves_its_start_in_doubt(strip: Actuator) -> None:
    """A minute after a step 0.2 mA still fall: much before a run of 1 mA, not half a percent of one of 56 mA."""
    bench = VirtualBench(strip)

    def started(text: str) -> bool | None:
        bench.operate("rest")
        record(bench, "step -1 V", duration=20.0, rate=50.0, zero_time=1.0, measured=["current"])
        run = record(bench, text, duration=1.0, rate=50.0, zero_time=60.0, measured=["current"])
        return run.metadata.starts_from_rest

    assert started("step 0.02 V") is False
    assert started("step 1 V") is None


@pytest.mark.parametrize(("rate", "rows"), [(10.0, 1), (50.0, 2), (1000.0, 40)])
def test_a_block_lasts_40_ms(strip: Actuator, rate: float, rows: int) -> None:
    bench = VirtualBench(strip)
    bench.open(["voltage", "current"], rate)
    blocks = list(bench.apply(signals.Step(1.0), 101))
    assert [block.first_row for block in blocks] == list(range(0, 101, rows))
    assert sum(len(block) for block in blocks) == 101
    assert {len(block) for block in blocks[:-1]} == {rows}
    assert np.concatenate([block.output for block in blocks]).tolist() == [0.0] + [1.0] * 100
    bench.close()


def test_steps_of_a_control_loop_read_what_blocks_read(strip: Actuator) -> None:
    voltage = signals.parse("prbs 1 V 0.1 s").voltage(np.arange(200) / 50.0)
    bench = VirtualBench(strip)
    bench.open(["voltage", "current", "force"], 50.0)
    stepped = [bench.exchange(float(volts)) for volts in voltage]
    bench.close()
    again = VirtualBench(strip)
    again.open(["voltage", "current", "force"], 50.0)
    for block in again.apply(signals.Samples(time=np.arange(200) / 50.0, voltage=voltage), 200):
        for name, values in block.readings.items():
            rows = range(block.first_row, block.first_row + len(block))
            assert [stepped[row][name] for row in rows] == values.tolist()
    again.close()


def test_zero_between_blocks_brings_the_output_to_0_and_blocks_go_on(strip: Actuator) -> None:
    bench = VirtualBench(strip, rig=quiet())
    bench.open(["voltage", "current"], 50.0)
    blocks = []
    for block in bench.apply(signals.Step(1.0), 100):
        blocks.append(block)
        if block.first_row == 48:
            bench.zero()
            bench.zero()
    assert len(blocks) == 50
    output = np.concatenate([block.output for block in blocks])
    assert output.tolist() == [0.0] + [1.0] * 49 + [0.0] * 50
    read = np.concatenate([block.readings["voltage"] for block in blocks])
    assert read == pytest.approx(output, abs=1e-4)
    # The strip is short-circuited now: it discharges through the shunt.
    assert blocks[25].readings["current"][0] < -0.01
    # The next signal is given out again.
    assert list(bench.apply(signals.Step(1.0), 3))[-1].output.tolist() == [1.0]
    bench.close()
    bench.close()


def test_rest_is_recorded_around_the_signal(strip: Actuator) -> None:
    bench = VirtualBench(strip, rig=quiet())
    run = record(bench, "sine 1 V 1 Hz", duration=2.0, rate=50.0, rest_before=1.0, rest_after=0.5)
    assert len(run) == 175
    assert run.metadata.signal == "step 0 V for 1 s then sine 1 V 1 Hz for 2 s"
    shown = signals.parse(run.metadata.signal).voltage(run.time)
    assert run.voltage[1:] == pytest.approx(shown[:-1], abs=1e-4)
    assert np.all(run.voltage[:51] == 0.0)
    pulse = record(bench, "step 1 V", duration=0.02, rate=50.0, rest_after=0.1)
    assert pulse.voltage == pytest.approx([0.0, 1.0, 0.0, 0.0, 0.0, 0.0], abs=1e-4)
    joined = record(bench, "step 1 V for 1 s then step 2 V", duration=2.0, rate=50.0, rest_after=1.0)
    assert joined.metadata.signal == "step 1 V for 1 s then step 2 V for 1 s"
    assert joined.voltage[[1, 50, 51, 100, 101, 149]] == pytest.approx([1.0, 1.0, 2.0, 2.0, 0.0, 0.0], abs=1e-4)


def test_a_run_says_how_it_was_recorded(strip: Actuator) -> None:
    held = RunMetadata(sample=Sample(id="strip-7"), mounting_id="m-1", operator="NN", run_number=3)
    run = record(VirtualBench(strip), "step 1 V", duration=1.0, rate=50.0, metadata=held)
    about = run.metadata
    assert (about.sample, about.mounting_id, about.operator, about.run_number) == (held.sample, "m-1", "NN", 3)
    assert about.origin == "virtual bench"
    assert about.signal == "step 1 V"
    assert about.starts_from_rest
    assert about.temperature == pytest.approx(22.0, abs=0.1)
    assert about.relative_humidity == pytest.approx(45.0, abs=0.5)
    assert about.bench == "virtual bench, actuator friend-2, rig of Friend's thesis, chapter 3, seed 20261121"
    assert about.calibrations["current"] == "raw [V] x 1 A/V"
    assert about.calibrations["force"].startswith("raw [V] x 0.00980665 N/V, zeroed at 0.0044")
    laser = record(VirtualBench(strip), "step 1 V", duration=1.0, rate=50.0, measured=["displacement"]).metadata
    assert laser.calibrations["displacement"].startswith("raw [V] x 0.003125 m/V - 0.00625 m, zeroed at 0.012")
    # 4 mA over 500 ohm is 0 mm, 20 mA is 25 mm; 10 V of the amplifier is 10 gf.
    assert THESIS_RIG["displacement"].to_quantity(0.004 * 500) == pytest.approx(0.0, abs=1e-15)
    assert THESIS_RIG["displacement"].to_quantity(0.020 * 500) == pytest.approx(25e-3)
    assert THESIS_RIG["force"].to_quantity(10.0) == pytest.approx(98.0665e-3)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"measured": ("displacement", "force")}, "measured: displacement and force cannot be measured in one run"),
        ({"measured": ("curent",)}, "measured: the bench has no channel 'curent'; did you mean 'current'?"),
        (
            {"signal": "sine 11 V 1 Hz"},
            "signal: it commands 4.04937 V at 0.06 s, the limit is 3.5 V",
        ),
        (
            {"signal": "step 1 V for 5 s"},
            "signal 'step 1 V for 5 s': it reaches to 5 s, the record to 2 s; record longer",
        ),
        ({"signal": "stp 1 V"}, "unknown waveform 'stp'"),
        ({"rate": 0.0}, "rate: the rate is 0.0, it must be a number above 0; give it in Hz"),
        ({"rate": "50 s"}, "rate: '50 s' is not a frequency"),
        ({"rate": float("nan")}, "rate: the rate is nan"),
        ({"duration": -1.0}, "duration: the duration is -1.0, it must be a number above 0"),
        ({"duration": 1e308, "rate": 1e308}, "duration: 1e+308 s at 1e+308 Hz are inf rows, allowed are 2 to 20000000"),
        ({"rest_after": 1e9}, "duration: 1e+09 s at 50 Hz are 50000000100 rows, allowed are 2 to 20000000"),
        ({"rest_before": -1.0}, "rest_before: rest_before is -1; give 0 s or more"),
        ({"duration": 0.02}, "duration: 0.02 s at 50 Hz are 1 rows, allowed are 2 to 20000000"),
    ],
)
def test_what_cannot_be_recorded_is_refused(strip: Actuator, values: dict[str, object], message: str) -> None:
    asked = {"signal": "step 1 V", "duration": 2.0, "rate": 50.0, **values}
    bench = VirtualBench(strip)
    with pytest.raises(InputError) as caught:
        record(bench, asked.pop("signal"), **asked)  # type: ignore[arg-type]
    assert message in str(caught.value)
    with pytest.raises(InputError, match="the bench is not open"):
        bench.apply(signals.Step(0.0), 2)


def test_a_laser_that_sees_no_strip_at_rest_stops_the_record(strip: Actuator) -> None:
    away = changed(THESIS_RIG, "displacement", rest=26e-3)
    with pytest.raises(IpmclabError, match="displacement: the strip at rest is not in the range of the sensor"):
        record(VirtualBench(strip, rig=away), "step 1 V", duration=1.0, rate=50.0, measured=["displacement"])
