"""Faults, as a program under test meets them."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from nidaqmx import DaqError, DaqReadError
from nidaqmx.constants import AcquisitionType, ExcitationSource, ResistanceConfiguration, RTDType, TaskMode
from nidaqmx.errors import RpcError

from virtual_cdaq.model.faults import FOREVER, Fault, parse_fault

HANGS = 180.0
"""After so long [s] something is taken to hang, on whatever machine."""


def clocked(task, channel="cDAQ1Mod1/ai3", rate=1000.0):
    task.ai_channels.add_ai_voltage_chan(channel)
    task.timing.cfg_samp_clk_timing(rate, sample_mode=AcquisitionType.CONTINUOUS)
    task.start()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("freeze at 2 s", Fault("freeze", at=2.0)),
        ("freeze at 2 s of serving for 1.5 s", Fault("freeze", at=2.0, duration=1.5, of_serving=True)),
        ("drop at 0.5 s for 1 s", Fault("drop", at=0.5, duration=1.0)),
        ("open cDAQ1Mod3/ai1 at 3 s", Fault("open", at=3.0, channel="cDAQ1Mod3/ai1")),
        ("noise 0.5 V on cDAQ1Mod1/ai0 at 1 s for 2 s", Fault("noise", 1.0, 2.0, "cDAQ1Mod1/ai0", 0.5)),
        ("unplug at 1 s", Fault("unplug", 1.0, FOREVER)),
    ],
)
def test_a_fault_is_read_from_a_line(text, fault):
    assert parse_fault(text) == fault


@pytest.mark.parametrize("text", ["", "explode at 2 s", "freeze", "freeze at two s", "freeze at 2", "noise 1 A at 2 s"])
def test_what_is_no_fault_is_refused_with_those_that_are(text):
    with pytest.raises(ValueError, match=r"freeze, drop, overrun, stuck, open, noise, unplug"):
        parse_fault(text)


def test_an_overrun(make_bench):
    bench = make_bench("lock-step", "overrun at 0.5 s")
    with bench.task() as task:
        clocked(task)
        assert len(task.read(500, timeout=5.0)) == 500
        with pytest.raises(DaqReadError) as caught:
            task.read(500, timeout=5.0)
    assert caught.value.error_code == -200279


@pytest.mark.real_time
def test_a_frozen_chassis_answers_nobody_and_then_goes_on(make_bench):
    bench = make_bench("real", "freeze at 0.05 s for 0.5 s")
    with bench.task() as task:
        clocked(task)
        begin = time.monotonic()
        task.read(200, timeout=5.0)
        assert time.monotonic() - begin > 0.5
        assert len(task.read(300, timeout=5.0)) == 300


@pytest.mark.real_time
def test_a_dropped_connection_fails_what_waits_and_keeps_the_tasks(make_bench):
    bench = make_bench("real", "drop at 0.1 s for 0.2 s")
    with bench.task("kept") as task:
        clocked(task)
        with pytest.raises(RpcError):
            task.read(1000, timeout=5.0)
        deadline = time.monotonic() + 20.0
        while True:
            try:
                assert len(task.read(100, timeout=5.0)) == 100
                break
            except RpcError:
                assert time.monotonic() < deadline
                time.sleep(0.1)


def test_an_unplugged_chassis_is_gone_and_comes_back(make_bench, monkeypatch):
    wall = SimpleNamespace(monotonic=lambda: 0.0)
    monkeypatch.setattr("virtual_cdaq.model.faults.time", wall)
    bench = make_bench("lock-step", "unplug at 0.1 s for 3 s")  # of the wall
    with bench.task() as task:
        clocked(task)
        with pytest.raises(DaqError) as caught:
            task.read(500, timeout=5.0)
        with bench.task() as other:
            other.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai0")
            with pytest.raises(DaqError) as absent:
                other.read()
        with pytest.raises(DaqError) as ill:
            bench.system.devices["cDAQ1"].self_test_device()
        assert {one.value.error_code for one in (caught, absent, ill)} == {-201003}
    wall.monotonic = lambda: 3.1
    bench.system.devices["cDAQ1"].self_test_device()
    with bench.task() as task:
        clocked(task)
        task.read(10)


def test_a_stuck_output_stays_where_it_is_even_through_a_reset(make_bench):
    bench = make_bench("lock-step", "stuck at 0.1 s")
    with bench.task() as writing, bench.task() as task:
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        writing.write(2.0)
        clocked(task)
        task.read(200)
        writing.write(0.0)
        assert task.read() == pytest.approx(2.0, abs=3e-3)
        bench.system.devices["cDAQ1"].reset_device()
    assert bench.chassis.levels["cDAQ1Mod2/ao0"] == pytest.approx(2.0, abs=2e-4)


def test_a_stuck_output_comes_loose_again(make_bench):
    bench = make_bench("lock-step", "stuck at 0.1 s for 0.2 s")
    with bench.task() as writing, bench.task() as task:
        writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0")
        clocked(task)
        task.read(200)
        writing.write(1.0)
        assert bench.chassis.levels["cDAQ1Mod2/ao0"] == 0.0
        task.read(200)
        writing.write(1.0)
        assert bench.chassis.levels["cDAQ1Mod2/ao0"] == pytest.approx(1.0, abs=2e-4)


def test_an_open_rtd_reads_the_end_of_its_range(make_bench):
    bench = make_bench("lock-step", "open cDAQ1Mod3/ai1 at 0.5 s")
    with bench.task() as task:
        task.ai_channels.add_ai_rtd_chan(
            "cDAQ1Mod3/ai1",
            rtd_type=RTDType.PT_3851,
            resistance_config=ResistanceConfiguration.FOUR_WIRE,
            current_excit_source=ExcitationSource.INTERNAL,
            current_excit_val=1e-3,
        )
        task.timing.cfg_samp_clk_timing(100.0, samps_per_chan=100)
        celsius = np.array(task.read(100, timeout=5.0))
    assert celsius[:50] == pytest.approx(22.0, abs=0.15)
    assert (celsius[51:] > 850.0).all()


def test_a_burst_of_noise_has_its_size_its_time_and_its_channel(make_bench):
    bench = make_bench("lock-step", "noise 0.5 V on cDAQ1Mod1/ai3 at 1 s for 1 s")
    with bench.task() as task:
        task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai2:3")
        task.timing.cfg_samp_clk_timing(1000.0, samps_per_chan=3000)
        other, burst = np.array(task.read(3000, timeout=5.0))
    assert np.std(burst[1000:2000]) == pytest.approx(0.5, abs=0.05)
    for quiet in (other, burst[:1000], burst[2000:]):
        assert np.std(quiet) < 1e-3


def test_a_fault_from_within_a_test(bench):
    with bench.task() as task:
        clocked(task)
        task.read(10)
        with bench.chassis.lock:
            bench.chassis.suffer(Fault("overrun"), bench.chassis.tick)
        with pytest.raises(DaqReadError):
            task.read(10)


def test_a_closing_server_lets_waiting_calls_go(make_bench):
    bench = make_bench("real")
    failures: list[BaseException] = []
    task = bench.task()
    task.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3")
    task.timing.cfg_samp_clk_timing(1.0, samps_per_chan=1000)
    task.control(TaskMode.TASK_RESERVE)
    task.start()

    def read():
        try:
            task.read(1000, timeout=-1)
        except RpcError as error:
            failures.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    time.sleep(0.2)
    bench.server.stop()
    thread.join(HANGS)
    assert len(failures) == 1
