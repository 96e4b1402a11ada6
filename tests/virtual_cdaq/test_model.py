"""The chassis without any server: time, edges, engines."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.profiles import costly
from virtual_cdaq.attributes.task import TIMING
from virtual_cdaq.model import transfer
from virtual_cdaq.model.channels import VOLTS, Channel
from virtual_cdaq.model.chassis import Chassis
from virtual_cdaq.model.clock import TICKS_PER_SECOND, LockStepClock, make_clock, sample_period, ticks
from virtual_cdaq.model.converters import choose_range
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.plant import RcPlant
from virtual_cdaq.model.task import CONTINUOUS, FINITE, ON_DEMAND, SAMPLE_CLOCK

RATE = 50.0


def new_chassis(**more):
    return Chassis(RcPlant(), LockStepClock(), **more)


def add(task, physical, limit=10.0):
    slot = next(slot for slot in task.chassis.slots if physical.startswith(slot.device))
    chosen = choose_range(slot.module, -limit, limit)
    task.add(
        Channel(physical, physical, slot.device, slot.module, "voltage", -limit, limit, chosen, VOLTS, terminal=10106)
    )


def pair(chassis, rows, rate=RATE, mode=FINITE, inputs=("cDAQ1Mod1/ai1", "cDAQ1Mod1/ai3")):
    """An input task and an output task on its clock."""
    reading = chassis.new_task("in")
    for physical in inputs:
        add(reading, physical, 5.0)
    reading.set_sample_clock(rate, "", mode, rows)
    reading.reserve()
    writing = chassis.new_task("out")
    add(writing, "cDAQ1Mod2/ao0")
    writing.set_sample_clock(rate, f"/cDAQ1/{reading.engine.name}/SampleClock", mode, rows)
    return reading, writing


def play(chassis, volts, rate=RATE):
    reading, writing = pair(chassis, volts.size, rate)
    transfer.write(writing, transfer.to_codes(writing, volts[None, :]), auto_start=False, timeout=1.0)
    writing.start()
    reading.start()
    codes, status = transfer.read(reading, volts.size, 1e6)
    assert status == 0
    return np.array([channel.scale(row) for channel, row in zip(reading.channels, codes, strict=True)])


def test_inputs_are_read_before_the_output_changes_on_their_edge():
    volts = np.array([1.0, 2.0, 3.0, 4.0])
    with (chassis := new_chassis()).lock:
        applied = play(chassis, volts)[1]
    assert applied == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=2e-3)


def test_a_capacitor_charges_as_its_equation_says():
    rows = 400
    volts = np.sin(2 * np.pi * 0.5 * np.arange(rows) / RATE)
    with (chassis := new_chassis()).lock:
        measured = play(chassis, volts)[0]
    # 10 ohm, 0.1 F: v[k + 1] = u[k] + (v[k] - u[k]) exp(-T / RC), the output held between edges.
    exact = np.zeros(rows)
    for k in range(rows - 1):
        exact[k + 1] = volts[k] + (exact[k] - volts[k]) * np.exp(-1 / RATE / 1.0)
    assert np.sqrt(np.mean((measured - exact) ** 2)) < 0.2e-3  # 116 uV of noise, steps of 160 uV, an offset


@costly()
@given(st.lists(st.integers(1, 200), min_size=1, max_size=8))
def test_data_do_not_depend_on_when_somebody_looks(looks):
    volts = np.linspace(-1.0, 1.0, 300)
    with (chassis := new_chassis()).lock:
        whole = play(chassis, volts)
    with (chassis := new_chassis()).lock:
        reading, writing = pair(chassis, volts.size)
        transfer.write(writing, transfer.to_codes(writing, volts[None, :]), auto_start=False, timeout=1.0)
        writing.start()
        reading.start()
        for look in looks:
            chassis.clock.step_to(chassis.clock.now() + look * 777_777)
            chassis.advance()
        codes, _ = transfer.read(reading, volts.size, 1e6)
    parts = np.array([channel.scale(row) for channel, row in zip(reading.channels, codes, strict=True)])
    assert parts.tolist() == whole.tolist()


def test_an_output_on_the_inputs_clock_needs_one_edge_more_to_be_done():
    with (chassis := new_chassis()).lock:
        reading, writing = pair(chassis, 10)
        transfer.write(writing, np.zeros((1, 10), dtype=np.int32), auto_start=False, timeout=1.0)
        writing.start()
        reading.start()
        transfer.wait_until_done(reading, 10.0)
        with pytest.raises(ChassisError) as caught:
            transfer.wait_until_done(writing, 0.05)
        assert caught.value.code == -200560
        reading.stop()
        reading.set_sample_clock(RATE, "", FINITE, 11)
        reading.start()
        writing.stop()
        reading.stop()
        reading.start()
        writing.start()
        transfer.wait_until_done(writing, 10.0)


def test_a_starved_output_stops_and_holds_its_last_sample():
    with (chassis := new_chassis()).lock:
        reading, writing = pair(chassis, 100, mode=CONTINUOUS)
        writing.regenerate = False
        codes = transfer.to_codes(writing, np.array([[0.5, 1.0, 1.5]]))
        transfer.write(writing, codes, auto_start=False, timeout=1.0)
        writing.start()
        reading.start()
        transfer.read(reading, 10, 10.0)
        with pytest.raises(ChassisError) as caught:
            transfer.write(writing, codes, auto_start=False, timeout=1.0)
    assert caught.value.code == -200290
    assert chassis.levels["cDAQ1Mod2/ao0"] == pytest.approx(1.5, abs=2e-4)


def test_a_fourth_input_engine_and_a_second_task_on_a_module_are_refused():
    modules = ("NI 9205", "NI 9205", "NI 9205", "NI 9205")
    with (chassis := new_chassis(modules=modules)).lock:
        tasks = []
        for slot in range(1, 5):
            task = chassis.new_task(f"t{slot}")
            add(task, f"cDAQ1Mod{slot}/ai0")
            task.set_sample_clock(RATE, "", CONTINUOUS, 100)
            tasks.append(task)
        for task in tasks[:3]:
            task.reserve()
        assert [task.engine.name for task in tasks[:3]] == ["ai", "te0", "te1"]
        with pytest.raises(ChassisError) as engines:
            tasks[3].reserve()
        second = chassis.new_task("second")
        add(second, "cDAQ1Mod1/ai1")
        second.set_sample_clock(RATE, "", CONTINUOUS, 100)
        tasks[2].unreserve()
        with pytest.raises(ChassisError) as module:
            second.reserve()
        tasks[3].reserve()
    assert (engines.value.code, module.value.code) == (-50103, -50103)


def test_a_reset_aborts_the_tasks_and_brings_the_outputs_to_zero():
    with (chassis := new_chassis()).lock:
        reading, writing = pair(chassis, 100, mode=CONTINUOUS)
        transfer.write(writing, transfer.to_codes(writing, np.full((1, 100), 2.0)), auto_start=False, timeout=1.0)
        writing.start()
        reading.start()
        transfer.read(reading, 10, 1.0)
        assert chassis.levels["cDAQ1Mod2/ao0"] == pytest.approx(2.0, abs=2e-4)
        chassis.reset(chassis.devices)
        assert set(chassis.levels.values()) == {0.0}
        with pytest.raises(ChassisError) as caught:
            transfer.read(reading, 10, 1.0)
        assert caught.value.code == -88709
        again = chassis.new_task("again")
        add(again, "cDAQ1Mod1/ai0")
        again.set_sample_clock(RATE, "", CONTINUOUS, 100)
        again.reserve()


def test_a_task_without_a_clock_has_the_timing_of_ni_daqmx_and_a_reset_brings_it_back():
    chassis = new_chassis()
    task = chassis.new_task("in")
    add(task, "cDAQ1Mod1/ai1", 5.0)
    defaults = {"SAMP_QUANT_SAMP_MODE": CONTINUOUS, "SAMP_QUANT_SAMP_PER_CHAN": 1000, "SAMP_TIMING_TYPE": ON_DEMAND}
    with chassis.lock:
        assert {name: TIMING[name].get(task) for name in defaults} == defaults
        task.set_sample_clock(RATE, "", FINITE, 20)
        assert {name: TIMING[name].get(task) for name in defaults} == dict(
            zip(defaults, (FINITE, 20, SAMPLE_CLOCK), strict=True)
        )
        for name in defaults:
            TIMING[name].reset(task)
        assert {name: TIMING[name].get(task) for name in defaults} == defaults
        TIMING["SAMP_CLK_RATE"].reset(task)
        assert TIMING["SAMP_CLK_RATE"].get(task) == 1000.0


@given(st.floats(0.02, 250_000.0))
def test_a_rate_is_raised_to_a_whole_divider_and_stays_there(rate):
    made = TICKS_PER_SECOND / sample_period(rate)
    assert made >= rate * (1 - 1e-9)
    assert sample_period(made) == sample_period(rate)
    assert ticks(1.0) == TICKS_PER_SECOND


@pytest.mark.parametrize("text", ["fast", "x", "x0", "x1e9", "lockstep", "10"])
def test_another_clock_is_refused_with_those_that_are(text):
    with pytest.raises(ValueError, match=r"'real', 'x10' .* 'lock-step'"):
        make_clock(text)


@pytest.mark.parametrize("volts", [-5.001, 5.001, np.nan])
def test_a_voltage_beyond_the_limits_of_its_channel_is_refused(volts):
    """Not only beyond what the converter can do, which is 10 V."""
    writing = new_chassis().new_task("out")
    add(writing, "cDAQ1Mod2/ao0", 5.0)
    with pytest.raises(ChassisError) as caught:
        transfer.to_codes(writing, np.array([[0.0, 5.0, volts]]))
    assert caught.value.code == -200561
    assert "sample 2" in str(caught.value)
    assert transfer.to_codes(writing, np.array([[-5.0, 5.0]])).shape == (1, 2)


@pytest.mark.real_time
def test_a_fast_clock_waits_for_who_feeds_an_output_as_long_as_life_would():
    """Half a second ahead is half a second on the wall, at a hundred times the speed too."""
    with (chassis := Chassis(RcPlant(), make_clock("x100"))).lock:
        reading, writing = pair(chassis, 1000, mode=CONTINUOUS)
        writing.regenerate = False
        ahead = transfer.to_codes(writing, np.ones((1, 25)))
        transfer.write(writing, ahead, auto_start=False, timeout=1.0)
        began = time.perf_counter()
        writing.start()
        reading.start()
        while writing.failure is None:
            time.sleep(0.02)
            chassis.advance()
        # 25 edges, the first one at once: the 26th has nothing to give.
        assert 0.2 < time.perf_counter() - began < 5.0
        assert writing.failure.code == -200290
        assert writing.output_buffer.generated == 25


@pytest.mark.real_time
def test_a_fast_clock_is_fast_where_an_output_is_fed():
    with (chassis := Chassis(RcPlant(), make_clock("x100"))).lock:
        reading, writing = pair(chassis, 2000, mode=CONTINUOUS)
        writing.regenerate = False
        transfer.write(writing, transfer.to_codes(writing, np.ones((1, 2000))), auto_start=False, timeout=1.0)
        began = time.perf_counter()
        writing.start()
        reading.start()
        while writing.output_buffer.generated < 1500:  # 30 s of the chassis
            time.sleep(0.01)
            chassis.advance()
        assert time.perf_counter() - began < 10.0
