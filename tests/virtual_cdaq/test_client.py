"""NI's client on the stand-in: the call patterns of a voltage, clocked and RTD program."""

import threading
import time

import numpy as np
import pytest
from nidaqmx.constants import (
    AcquisitionType,
    ExcitationSource,
    RegenerationMode,
    ResistanceConfiguration,
    RTDType,
    TaskMode,
    TerminalConfiguration,
)
from nidaqmx.stream_readers import AnalogMultiChannelReader, AnalogSingleChannelReader, AnalogUnscaledReader
from nidaqmx.stream_writers import AnalogSingleChannelWriter

from virtual_cdaq.model.chassis import Chassis

RATE = 50.0
FOUR_WIRES = {
    "resistance_config": ResistanceConfiguration.FOUR_WIRE,
    "current_excit_source": ExcitationSource.INTERNAL,
    "current_excit_val": 1e-3,
}
INPUTS = "cDAQ1Mod1/ai0:1, cDAQ1Mod1/ai3"


HANGS = 180.0
"""After so long [s] something is taken to hang, on whatever machine."""


def experiment(bench, volts, rate=RATE, trigger=False):
    """The experiment of the thesis: an output and three inputs on one clock, finite."""
    rows = volts.size
    with bench.task() as reading, bench.task() as writing:
        reading.ai_channels.add_ai_voltage_chan(INPUTS, min_val=-5.0, max_val=5.0)
        reading.timing.cfg_samp_clk_timing(rate, sample_mode=AcquisitionType.FINITE, samps_per_chan=rows)
        reading.control(TaskMode.TASK_RESERVE)
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        source = "" if trigger else reading.timing.samp_clk_term
        writing.timing.cfg_samp_clk_timing(rate, source, sample_mode=AcquisitionType.FINITE, samps_per_chan=rows)
        if trigger:
            start = reading.timing.samp_clk_term.replace("SampleClock", "StartTrigger")
            writing.triggers.start_trigger.cfg_dig_edge_start_trig(start)
        AnalogSingleChannelWriter(writing.out_stream).write_many_sample(volts)
        writing.start()
        reading.start()
        data = np.empty((3, rows))
        reader = AnalogMultiChannelReader(reading.in_stream)
        reader.verify_array_shape = False
        assert reader.read_many_sample(data, rows, timeout=rows / rate + 10.0) == rows
        reading.wait_until_done(5.0)
        if trigger:
            writing.wait_until_done(5.0)
        return data


def test_the_data_of_a_40_s_experiment_are_the_same_at_every_speed(make_bench):
    volts = np.sin(2 * np.pi * 0.1 * np.arange(2000) / RATE)
    stepped = experiment(make_bench("lock-step"), volts)
    assert stepped[2, 1:] == pytest.approx(volts[:-1], abs=1e-3)
    fast = experiment(make_bench("x100"), volts)
    assert fast.tobytes() == stepped.tobytes()
    real = experiment(make_bench("real"), volts[:20])
    assert real.tobytes() == stepped[:, :20].tobytes()


def test_a_start_trigger_does_what_a_shared_clock_does(make_bench):
    volts = np.linspace(0.0, 1.0, 50)
    assert experiment(make_bench(), volts, trigger=True).tobytes() == experiment(make_bench(), volts).tobytes()


def test_a_continuous_run_is_fed_in_step_and_loses_nothing(bench):
    volts = np.sin(np.arange(3000) / 50.0)
    with bench.task() as reading, bench.task() as writing:
        reading.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3")
        reading.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
        reading.control(TaskMode.TASK_RESERVE)
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        writing.timing.cfg_samp_clk_timing(1000.0, reading.timing.samp_clk_term, sample_mode=AcquisitionType.CONTINUOUS)
        writing.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
        writing.out_stream.output_buf_size = 1000
        writer = AnalogSingleChannelWriter(writing.out_stream)
        writer.write_many_sample(volts[:500])
        writing.start()
        reading.start()
        blocks = []
        for begin in range(0, 2500, 100):
            blocks.append(reading.read(100, timeout=5.0))
            writer.write_many_sample(volts[500 + begin : 600 + begin])
        assert np.concatenate(blocks)[1:] == pytest.approx(volts[:2499], abs=2e-3)
        assert reading.in_stream.total_samp_per_chan_acquired >= 2500
        assert writing.out_stream.curr_write_pos == 3000


def test_on_demand_a_written_level_is_read_back(bench):
    with bench.task() as writing, bench.task() as reading:
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        reading.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3")
        for level in (1.5, -3.0, 0.0):
            writing.write(level)
            assert reading.read() == pytest.approx(level, abs=3e-3)
        reader = AnalogSingleChannelReader(reading.in_stream)
        AnalogSingleChannelWriter(writing.out_stream, auto_start=True).write_one_sample(2.0)
        assert reader.read_one_sample() == pytest.approx(2.0, abs=3e-3)


def test_a_9217_reads_an_rtd_and_a_resistance(bench):
    with bench.task() as task:
        task.ai_channels.add_ai_rtd_chan(
            "cDAQ1Mod3/ai1",
            rtd_type=RTDType.PT_3851,
            **FOUR_WIRES,
        )
        assert task.read() == pytest.approx(22.0, abs=0.15)
    with bench.task() as task:
        task.ai_channels.add_ai_resistance_chan(
            "cDAQ1Mod3/ai0",
            min_val=0.0,
            max_val=400.0,
            **FOUR_WIRES,
        )
        task.timing.cfg_samp_clk_timing(100.0, samps_per_chan=100)
        ohms = np.array(task.read(100, timeout=5.0))
    assert ohms.mean() == pytest.approx(100.0, abs=0.01)
    assert 0.004 < ohms.std() < 0.016


def test_beside_a_fast_module_a_slow_one_repeats_itself(bench):
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3")
        task.ai_channels.add_ai_rtd_chan("cDAQ1Mod3/ai1", **FOUR_WIRES)
        task.timing.cfg_samp_clk_timing(4000.0, samps_per_chan=400)
        _, celsius = task.read(400, timeout=5.0)
    # 2.5 ms a conversion: ten samples each.
    assert [len(set(celsius[k : k + 10])) for k in range(0, 400, 10)] == [1] * 40
    assert len(set(celsius)) > 30


def test_the_chassis_tells_what_it_is(bench):
    system = bench.system
    assert [device.product_type for device in system.devices] == ["cDAQ-9174", "NI 9205", "NI 9263", "NI 9217"]
    assert [device.product_num for device in system.devices] == [Chassis.number, 29360, 28958, 29338]
    assert len({device.serial_num for device in system.devices}) == 4
    module = system.devices["cDAQ1Mod1"]
    assert [system.devices[f"cDAQ1Mod{number}"].compact_daq_slot_num for number in (1, 2, 3)] == [1, 2, 3]
    assert module.compact_daq_chassis_device.name == "cDAQ1"
    assert module.is_simulated
    assert module.ai_voltage_rngs == [-0.2, 0.2, -1.0, 1.0, -5.0, 5.0, -10.0, 10.0]
    assert len(module.ai_physical_chans) == 32
    assert TerminalConfiguration.DIFF in module.ai_physical_chans[0].ai_term_cfgs
    assert TerminalConfiguration.DIFF not in module.ai_physical_chans[8].ai_term_cfgs
    assert system.devices["cDAQ1Mod2"].ao_max_rate == 100_000.0
    for device in system.devices:
        device.self_test_device()


def test_a_reset_of_the_device_brings_the_output_to_zero_and_frees_it(bench):
    held = bench.task()
    held.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
    held.start()
    held.write(3.0)
    bench.system.devices["cDAQ1Mod2"].reset_device()
    assert bench.chassis.levels["cDAQ1Mod2/ao0"] == 0.0
    with bench.task() as task:
        task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        task.write(1.0)
    held.close()


@pytest.mark.parametrize("clock", ["lock-step", "x100"])
def test_events_come_every_n_samples_and_at_the_end(make_bench, clock):
    bench = make_bench(clock)
    calls: list[int] = []
    ends: list[int] = []
    over = threading.Event()
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3")
        task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=1000)
        task.register_every_n_samples_acquired_into_buffer_event(100, lambda *a: calls.append(a[2]) or 0)
        task.register_done_event(lambda *a: ends.append(a[1]) or over.set() or 0)
        task.start()
        assert over.wait(HANGS)
        deadline = time.monotonic() + HANGS
        while len(calls) < 10 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert (calls, ends) == ([100] * 10, [0])
        assert len(task.read(-1)) == 1000
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("nidaqmx")]


def test_in_lock_step_time_waits_for_a_reader_that_is_called(bench):
    """A continuous acquisition driven by events must not run over, however slow the reader."""
    blocks: list[float] = []
    enough = threading.Event()

    def read(*_):
        time.sleep(0.002)
        blocks.extend(task.read(200, timeout=5.0))
        if len(blocks) >= 12_000:
            enough.set()
        return 0

    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3")
        task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=1000)
        task.in_stream.input_buf_size = 1000
        task.register_every_n_samples_acquired_into_buffer_event(200, read)
        task.start()
        assert enough.wait(HANGS)


def test_unscaled_and_waveform_reads_agree_with_scaled_ones(make_bench):
    def two(read):
        with make_bench().task() as task:
            task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai2:3", min_val=-5.0, max_val=5.0)
            task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=50)
            return read(task)

    def unscaled(task):
        data = np.zeros((2, 50), dtype=np.int16)
        AnalogUnscaledReader(task.in_stream).read_int16(data, 50)
        return data

    scaled = np.array(two(lambda task: task.read(50)))
    assert two(unscaled) * 160e-6 == pytest.approx(scaled, abs=1e-12)
    waveforms = two(lambda task: task.read_waveform(50))
    assert [each.channel_name for each in waveforms] == ["cDAQ1Mod1/ai2", "cDAQ1Mod1/ai3"]
    assert np.array([each.scaled_data for each in waveforms]) == pytest.approx(scaled, abs=1e-12)
    assert waveforms[0].timing.sample_interval.total_seconds() == pytest.approx(1e-3)


def test_a_read_may_be_larger_than_the_buffer(bench):
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3")
        task.timing.cfg_samp_clk_timing(50.0, sample_mode=AcquisitionType.CONTINUOUS)
        task.in_stream.input_buf_size = 100
        assert len(task.read(1234, timeout=100.0)) == 1234
