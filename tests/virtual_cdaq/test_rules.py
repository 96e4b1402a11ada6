"""What the chassis refuses, through NI's client: code, type and text of the error."""

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx import DaqError, DaqReadError, DaqWriteError
from nidaqmx.constants import AcquisitionType, ExcitationSource, ResistanceConfiguration, TaskMode
from nidaqmx.errors import RpcError
from nidaqmx.stream_readers import AnalogMultiChannelReader

FOUR_WIRES = {
    "resistance_config": ResistanceConfiguration.FOUR_WIRE,
    "current_excit_source": ExcitationSource.INTERNAL,
    "current_excit_val": 1e-3,
}


@pytest.fixture
def reading(bench):
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0")
        yield task


@pytest.fixture
def writing(bench):
    with bench.task() as task:
        task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        yield task


@pytest.mark.parametrize(
    ("code", "text", "do"),
    [
        (-200170, "cDAQ1Mod1/ai99", lambda t: t.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai99")),
        (-200170, "cDAQ1Mod1/ao0", lambda t: t.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ao0")),
        (-200220, "Dev7", lambda t: t.ai_channels.add_ai_voltage_chan("Dev7/ai0")),
        (-200431, "NI 9263", lambda t: t.ai_channels.add_ai_voltage_chan("cDAQ1Mod2/ao0")),
        (-200431, "NI 9205", lambda t: t.ai_channels.add_ai_rtd_chan("cDAQ1Mod1/ai1", current_excit_val=1e-3)),
        (-200431, "NI 9217", lambda t: t.ai_channels.add_ai_voltage_chan("cDAQ1Mod3/ai0")),
        (-200077, "AI.Max", lambda t: t.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai1", min_val=-5.0, max_val=12.0)),
        (-200077, "AO.Min", lambda t: t.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao1", min_val=-11.0, max_val=5.0)),
        (-200082, "Minimum", lambda t: t.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai1", min_val=1.0, max_val=1.0)),
        (
            -200077,
            "0.002 A",
            lambda t: t.ai_channels.add_ai_resistance_chan(
                "cDAQ1Mod3/ai0", "", 0.0, 400.0, **(FOUR_WIRES | {"current_excit_val": 2e-3})
            ),
        ),
        (
            -200077,
            "3 or 4 wires",
            lambda t: t.ai_channels.add_ai_rtd_chan(
                "cDAQ1Mod3/ai0", **(FOUR_WIRES | {"resistance_config": ResistanceConfiguration.TWO_WIRE})
            ),
        ),
        (
            -200077,
            "internal",
            lambda t: t.ai_channels.add_ai_rtd_chan(
                "cDAQ1Mod3/ai0", **(FOUR_WIRES | {"current_excit_source": ExcitationSource.EXTERNAL})
            ),
        ),
        (-200478, "Task", lambda t: t.start()),
        (-200478, "Task", lambda t: t.timing.cfg_samp_clk_timing(50.0)),
    ],
)
def test_a_channel_that_cannot_be_is_refused_when_it_is_made(bench, code, text, do):
    with bench.task() as task, pytest.raises(DaqError) as caught:
        do(task)
    assert caught.value.error_code == code
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("code", "text", "do"),
    [
        (-200489, "cDAQ1Mod1/ai0", lambda t: t.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0")),
        (-200559, "cDAQ1Mod2/ao0", lambda t: t.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")),
        (-200077, "at most 250000 S/s", lambda t: t.timing.cfg_samp_clk_timing(300_000.0)),
        (-200077, "above 0", lambda t: t.timing.cfg_samp_clk_timing(0.0)),
        (
            -200077,
            "single point",
            lambda t: t.timing.cfg_samp_clk_timing(50.0, sample_mode=AcquisitionType.HW_TIMED_SINGLE_POINT),
        ),
        (-89120, "Dev1", lambda t: t.timing.cfg_samp_clk_timing(50.0, "/Dev1/te0/SampleClock") or t.start()),
        (-200459, "Task", lambda t: t.write(1.0)),
        (-200452, "DIG_FLTR", lambda t: t.timing.samp_clk_dig_fltr_enable),
    ],
)
def test_a_task_that_cannot_be_is_refused(reading, code, text, do):
    with pytest.raises(DaqError) as caught:
        do(reading)
    assert caught.value.error_code == code
    assert text in str(caught.value)


def test_four_inputs_share_the_converter_of_their_module(reading):
    reading.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai1:3")
    reading.timing.cfg_samp_clk_timing(62_500.0)
    with pytest.raises(DaqError, match="at most 62500"):
        reading.timing.cfg_samp_clk_timing(62_600.0)


def test_a_sample_outside_the_range_is_named(writing):
    writing.timing.cfg_samp_clk_timing(50.0, samps_per_chan=4)
    with pytest.raises(DaqWriteError, match=r"11 V, sample 2(.|\n)*-10 V to 10 V") as caught:
        writing.write([0.0, 1.0, 11.0, 2.0])
    assert (caught.value.error_code, caught.value.samps_per_chan_written) == (-200561, 0)
    with pytest.raises(DaqError) as scalar:
        writing.write([0.0, np.nan])
    assert scalar.value.error_code == -200561


def test_an_output_without_samples_does_not_start(writing):
    writing.timing.cfg_samp_clk_timing(50.0, samps_per_chan=4)
    with pytest.raises(DaqError) as empty:
        writing.start()
    with pytest.raises(DaqError) as one:
        writing.write([0.0], auto_start=True)
    assert (empty.value.error_code, one.value.error_code) == (-200462, -200609)


def test_hardware_and_software_timing_exclude_each_other_on_an_output_module(bench, writing):
    writing.timing.cfg_samp_clk_timing(50.0, samps_per_chan=4)
    writing.write([0.0, 1.0, 1.0, 0.0])
    writing.control(TaskMode.TASK_RESERVE)
    with bench.task() as other:
        other.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao1")
        with pytest.raises(DaqError, match="software-timed") as caught:
            other.write(1.0)
        assert caught.value.error_code == -50103
        writing.control(TaskMode.TASK_UNRESERVE)
        other.write(1.0)


def test_a_held_module_cannot_be_read_on_demand(bench, reading):
    reading.timing.cfg_samp_clk_timing(50.0, sample_mode=AcquisitionType.CONTINUOUS)
    reading.start()
    with bench.task() as other:
        other.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai5")
        with pytest.raises(DaqError, match="Held by: _unnamedTask<0>"):
            other.read()


def test_unread_samples_are_lost_with_an_error(bench, reading):
    reading.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=100)
    reading.in_stream.input_buf_size = 100
    reading.start()
    with bench.chassis.lock:
        bench.chassis.clock.step_to(bench.chassis.clock.now() + 80_000_000)
    with pytest.raises(DaqReadError) as caught:
        reading.read(10)
    assert (caught.value.error_code, caught.value.samps_per_chan_read) == (-200279, 0)


def test_a_time_out_delivers_what_came_so_far(reading):
    reading.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=1000)
    reading.start()
    data = np.full((1, 500), np.nan)
    reader = AnalogMultiChannelReader(reading.in_stream)
    with pytest.raises(DaqReadError) as caught:
        reader.read_many_sample(data, 500, timeout=0.1)
    assert caught.value.error_code == -200284
    assert 95 <= caught.value.samps_per_chan_read <= 105


def test_a_finite_task_gives_what_it_has_and_then_no_more(reading):
    reading.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=20)
    reading.start()
    assert len(reading.read(50, timeout=1.0)) == 20
    with pytest.raises(DaqReadError) as caught:
        reading.read(1)
    assert caught.value.error_code == -200278


def test_waiting_for_a_task_that_does_not_end(reading):
    reading.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
    reading.start()
    with pytest.raises(DaqError) as caught:
        reading.wait_until_done(0.05)
    assert caught.value.error_code == -200560


def test_nothing_changes_while_a_task_runs(reading):
    reading.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
    reading.start()
    with pytest.raises(DaqError) as timing:
        reading.timing.cfg_samp_clk_timing(50.0)
    with pytest.raises(DaqError) as size:
        reading.in_stream.input_buf_size = 5000
    with pytest.raises(DaqError) as event:
        reading.register_done_event(lambda *a: 0)
    assert [each.value.error_code for each in (timing, size, event)] == [-200479, -200557, -200960]


def test_an_event_is_for_its_kind_of_task_and_registered_once(reading, writing):
    with pytest.raises(DaqError) as kind:
        reading.register_every_n_samples_transferred_from_buffer_event(10, lambda *a: 0)
    with pytest.raises(DaqError) as other_kind:
        writing.register_every_n_samples_acquired_into_buffer_event(10, lambda *a: 0)
    assert [each.value.error_code for each in (kind, other_kind)] == [-200980, -200981]


def test_a_cleared_task_is_gone_and_its_handle_never_finds_another(bench):
    first = bench.task()
    handle = first._handle
    first.close()
    with bench.task() as second:
        assert second._handle.name != handle.name
        with pytest.raises(DaqError) as caught:
            second._interpreter.start_task(handle)
    assert caught.value.error_code == -200088


def test_a_named_session_is_attached_to_or_refused(bench):
    channel = bench.options.grpc_channel
    new = nidaqmx.SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
    attach = nidaqmx.SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION
    with pytest.raises(RpcError) as nobody:
        nidaqmx.Task("out", grpc_options=nidaqmx.GrpcSessionOptions(channel, "out", initialization_behavior=attach))
    assert nobody.value.rpc_code == grpc.StatusCode.FAILED_PRECONDITION
    with bench.task("out") as task:
        task.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        task.start()
        task.write(3.0)
        with pytest.raises(RpcError) as exists:
            nidaqmx.Task("out", grpc_options=nidaqmx.GrpcSessionOptions(channel, "out", initialization_behavior=new))
        assert exists.value.rpc_code == grpc.StatusCode.ALREADY_EXISTS
        options = nidaqmx.GrpcSessionOptions(channel, "out", initialization_behavior=attach)
        with nidaqmx.Task("out", grpc_options=options) as attached:
            attached.write(0.0)
    assert bench.chassis.levels["cDAQ1Mod2/ao0"] == 0.0


def test_what_is_not_implemented_says_so(bench):
    with bench.task() as task, pytest.raises(RpcError) as caught:
        task.ai_channels.add_ai_thrmcpl_chan("cDAQ1Mod3/ai0")
    assert caught.value.rpc_code == grpc.StatusCode.UNIMPLEMENTED
