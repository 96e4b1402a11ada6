"""What NI's own programs do with the client, each in a few lines of ours."""

import numpy as np
import pytest
from nidaqmx import DaqError
from nidaqmx.constants import AcquisitionType, Edge, ProductCategory, RegenerationMode, TaskMode
from nidaqmx.stream_readers import AnalogUnscaledReader
from nidaqmx.stream_writers import AnalogUnscaledWriter

from virtual_cdaq.model.buffers import OutputBuffer


def test_an_output_is_started_by_the_first_input_task_of_the_device_that_it_names(bench):
    """The chassis is among the devices of a task, and a lone input task has the engine ``ai``."""
    with bench.task() as reading, bench.task() as writing:
        reading.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3")
        reading.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
        (chassis,) = (each for each in reading.devices if each.product_category != ProductCategory.C_SERIES_MODULE)
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        writing.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=200)
        writing.triggers.start_trigger.cfg_dig_edge_start_trig(f"/{chassis.name}/ai/StartTrigger")
        writing.write(np.full(200, 2.0))
        writing.start()
        assert bench.chassis.levels["cDAQ1Mod2/ao0"] == 0.0
        reading.start()
        assert reading.read(100, timeout=1.0)[-1] == pytest.approx(2.0, abs=5e-3)
    with bench.task() as nothing:
        assert nothing.devices == []


@pytest.mark.parametrize(
    ("asked", "physical", "named"),
    [
        ("volts", "ai0", ["volts"]),
        ("volts", "ai0:1", ["volts0", "volts1"]),
        ("foo31", "ai0:1", ["foo31", "foo32"]),
        ("a0:3, b", "ai0:7", ["a0", "a1", "a2", "a3", "b0", "b1", "b2", "b3"]),
        ("a, b", "ai0:1", ["a", "b"]),
        ("", "ai0:1", ["cDAQ1Mod1/ai0", "cDAQ1Mod1/ai1"]),
    ],
)
def test_channels_are_named_and_counted_on(bench, asked, physical, named):
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan(f"cDAQ1Mod1/{physical}", asked)
        assert task.channel_names == named


def test_an_array_of_odd_size_ends_with_zeros(bench):
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai2:3")
        data = np.full(19, -32768, dtype=np.int16)
        assert task.in_stream.read_into(data) == 9
    assert (abs(data[:-1]) < 32768).all()
    assert data[-1] == 0


def test_codes_without_a_sign_have_the_bits_of_those_with_one(bench):
    codes = np.array([[0, 1, -2, 30_000]], dtype=np.int16)
    with bench.task() as writing, bench.task() as reading:
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        reading.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3", min_val=-10.0, max_val=10.0)
        writing.start()
        writer, reader = AnalogUnscaledWriter(writing.out_stream), AnalogUnscaledReader(reading.in_stream)
        for code in codes[0]:
            writer.write_uint16(np.array([[code]], dtype=np.int16).view(np.uint16))
            narrow, wide = np.zeros((1, 1), np.uint16), np.zeros((1, 1), np.uint32)
            reader.read_uint16(narrow, 1)
            reader.read_uint32(wide, 1)
            expected = code * 10.7 / (10.0 * 1.048576)
            assert narrow.view(np.int16)[0, 0] == pytest.approx(expected, abs=6)
            assert wide.view(np.int32)[0, 0] == pytest.approx(expected, abs=6)
        writer.write_uint32(np.array([[-3]], dtype=np.int32).view(np.uint32))
        assert bench.chassis.levels["cDAQ1Mod2/ao0"] == pytest.approx(-3 * 10.7 / 32768)


def test_the_conversion_clock_belongs_to_a_module(bench):
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0:1")
        module = bench.system.devices["cDAQ1Mod1"]
        timing = task.timing[module]
        assert (timing.ai_conv_timebase_div, timing.ai_conv_active_edge) == (1121, Edge.RISING)  # 10 us + 4 us
        timing.ai_conv_rate = 10_000.0
        assert (timing.ai_conv_rate, timing.ai_conv_timebase_div) == (10_000.0, 8000)
        del timing.ai_conv_rate
        assert timing.ai_conv_timebase_div == 1121
        assert timing.ai_conv_max_rate == 250_000.0
        with pytest.raises(DaqError, match="at most 250000"):
            timing.ai_conv_rate = 300_000.0
        task.timing.cfg_samp_clk_timing(100_000.0)
        assert task.timing.ai_conv_rate == 200_000.0  # no room for more than the samples need
        with pytest.raises(DaqError) as refused:
            del timing.samp_clk_rate
        assert refused.value.error_code == -201118


def test_a_signal_goes_nowhere_where_there_is_no_terminal(bench):
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0")
        task.export_signals.start_trig_output_term = "RTSI"
        with pytest.raises(DaqError, match="Destination: RTSI") as refused:
            task.control(TaskMode.TASK_VERIFY)
        assert refused.value.error_code == -89121
        del task.export_signals.start_trig_output_term
        task.triggers.start_trigger.cfg_dig_edge_start_trig("/cDAQ1/te1/StartTrigger")
        with pytest.raises(DaqError) as on_demand:
            task.start()
        assert on_demand.value.error_code == -200262


def test_limits_that_are_reset_are_the_widest(bench):
    with bench.task() as task:
        channel = task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0", min_val=-0.1, max_val=0.1)
        assert (channel.ai_min, channel.ai_max) == (-0.2, 0.2)
        del channel.ai_max
        assert (channel.ai_min, channel.ai_max) == (-10.0, 10.0)


def test_the_texts_that_programs_look_for(bench):
    errors = {code: bench.system._interpreter.get_error_string(code) for code in (-200077, -200284, -200524)}
    assert errors[-200077].startswith("Requested value is not a supported value for this property.")
    assert errors[-200284].startswith("Some or all of the samples requested have not yet been acquired.\n\nTo wait for")
    assert errors[-200524].startswith("Write cannot be performed, because the number of channels in the data does not")
    with pytest.raises(DaqError, match="Device Specified: Gerät\n"):
        bench.system.devices["Gerät"].reset_device()


def test_a_write_as_large_as_the_buffer_never_lets_it_run_empty(bench, monkeypatch):
    """Programs write a buffer of samples again and again while the output runs."""
    left = []
    put = OutputBuffer.put

    def noting(buffer, codes):
        left.append(buffer.written - buffer.generated)
        put(buffer, codes)

    with bench.task() as task:
        task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        task.out_stream.regen_mode = RegenerationMode.DONT_ALLOW_REGENERATION
        task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
        task.write(np.zeros(1000))
        task.start()
        monkeypatch.setattr(OutputBuffer, "put", noting)
        for _ in range(3):
            assert task.write(np.ones(1000)) == 1000
        assert task.out_stream.curr_write_pos == 4000
    assert min(left) >= 900
