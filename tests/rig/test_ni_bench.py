"""The NI bench where others have no counterpart: clocks, failures of every kind, what a rig file gets wrong."""

from __future__ import annotations

import signal
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import nidaqmx
import numpy as np
import pytest

from ipmclab import signals
from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.bench import BenchError, Block
from ipmclab.rig.channels import Converter, Output, Rig, Thermometer
from ipmclab.rig.daqmx.driver import Driver
from ipmclab.rig.daqmx.link import Link
from ipmclab.rig.daqmx.reset import Resetter, reset
from ipmclab.rig.ni import NiBench
from tests.rig.conformance import joined
from tests.rig.stand_in import Process, StandIn, happen, serve
from virtual_cdaq.model.chassis import Chassis

pytestmark = pytest.mark.real_time

NAMES = ("voltage", "current")
RATE = 50.0
REPORTED = 3.0
"""No block for 1 s, and 2 s to report it [s]."""


@pytest.fixture
def chassis() -> Iterator[StandIn]:
    """A stand-in in real time."""
    with serve("real") as stand_in:
        yield stand_in


@pytest.fixture(scope="module")
def still() -> Iterator[StandIn]:
    """A stand-in whose time passes only when it is read."""
    with serve("lock-step") as stand_in:
        yield stand_in


@pytest.fixture
def opened(chassis: StandIn) -> Iterator[NiBench]:
    """A bench on the stand-in in real time, at 50 Hz."""
    bench = NiBench(chassis.rig)
    bench.open(NAMES, RATE)
    yield bench
    bench.close()


def run_into(
    blocks: Iterator[Block], do: Callable[[], None], after: int = 5
) -> tuple[IpmclabError, float, list[Block]]:
    """Do something after some blocks, and go on until it fails: with what, how long [s] after the last block."""
    got: list[Block] = []
    last = time.monotonic()
    try:
        for block in blocks:
            got.append(block)
            last = time.monotonic()
            if len(got) == after:
                do()
    except IpmclabError as error:
        return error, time.monotonic() - last, got
    pytest.fail("it did not fail")


# Clocks


def record_40_s(address: str, rig: Rig, seconds: float = 40.0) -> dict[str, np.ndarray]:
    bench = NiBench(replace(rig, address=address))
    names = (*NAMES, "force")
    bench.open(names, RATE)
    blocks = list(bench.apply(signals.parse("step 1 V for 2 s then sine 1 V 0.5 Hz"), round(seconds * RATE)))
    bench.close()
    return {name: joined(blocks, name) for name in (*names, "output")}


def test_the_experiment_of_the_thesis_gives_the_same_data_at_every_speed() -> None:
    got = {}
    for clock, seconds in (("lock-step", 40.0), ("x10", 10.0), ("real", 2.0)):
        with serve(clock) as stand_in:
            got[clock] = record_40_s(stand_in.address, stand_in.rig, seconds)
    for name in (*NAMES, "force", "output"):
        assert len(got["lock-step"][name]) == 2000
        assert np.array_equal(got["x10"][name], got["lock-step"][name][:500])
        assert np.array_equal(got["real"][name], got["lock-step"][name][:100])


def test_a_broken_wire_of_the_thermometer_is_no_temperature(still: StandIn) -> None:
    bench = NiBench(still.rig)
    bench.open(NAMES, RATE)
    seen: list[float] = []
    for block in bench.apply(signals.Step(0.0), 400):
        seen.extend(block.temperature)
        if block.first_row == 200:
            happen(still, "open", channel="cDAQ1Mod3/ai1", duration=2.0)
    bench.close()
    assert np.isnan(seen).sum() in (1, 2, 3)
    assert np.array(seen)[~np.isnan(seen)] == pytest.approx(22.0, abs=0.1)


# Failures


def test_a_chassis_that_freezes_is_reported_in_time(chassis: StandIn, opened: NiBench) -> None:
    error, after, got = run_into(
        opened.apply(signals.Step(1.0), 1000), lambda: happen(chassis, "freeze", duration=20.0)
    )
    assert after < REPORTED
    assert error.code == "bench-frozen"
    assert str(error).startswith(f"{chassis.address}: the server of the chassis does not answer; its program or")
    assert joined(got, "voltage")[1:] == pytest.approx(1.0, abs=2e-3)
    begin = time.monotonic()
    with pytest.raises(BenchError) as caught:
        opened.zero()
    # The first failure, which now also says what its user must do at once.
    assert caught.value is error
    assert "the output could not be brought to 0 V (no gRPC server answers" in str(error) or (
        "the output could not be brought to 0 V (the server of the chassis does not answer)" in str(error)
    )
    assert "switch the amplifier off" in str(error)
    with chassis.chassis.lock:
        chassis.chassis.faults._frozen_until = time.monotonic()
        chassis.chassis.faults.thaw()
    opened.zero()
    assert chassis.level == 0.0
    opened.close()
    assert time.monotonic() - begin < 20.0


def test_a_server_that_hangs_is_reported_in_time(tmp_path: Path) -> None:
    server = Process(tmp_path)
    bench = NiBench(server.rig)
    try:
        bench.open(NAMES, RATE)
        error, after, _ = run_into(bench.apply(signals.Step(1.0), 1000), lambda: server.send("SIGSTOP"))
        assert after < REPORTED
        assert error.code == "bench-frozen"
        begin = time.monotonic()
        with pytest.raises(BenchError, match="the output could not be brought to 0 V"):
            bench.close()
        assert time.monotonic() - begin < 3.0
        bench.close()
        assert server.level == pytest.approx(1.0, abs=1e-3)
        # It wakes up: whoever comes next brings the output to 0 V, whatever is still reserved.
        server.send("SIGCONT")
        bench.open(NAMES, RATE)
        assert server.level == 0.0
        assert bench.exchange(0.0)["voltage"] == pytest.approx(0.0, abs=2e-3)
        bench.close()
    finally:
        server.end()


def test_a_server_that_is_killed_and_restarted(tmp_path: Path) -> None:
    server = Process(tmp_path)
    bench = NiBench(server.rig)
    try:
        bench.open(NAMES, RATE)
        error, after, _ = run_into(bench.apply(signals.Step(1.0), 1000), server.end)
        assert after < 1.0
        assert (error.code, str(error)) == (
            "bench-lost",
            f"{server.address}: the connection to the server of the chassis is gone; look whether the server still "
            "runs and the network is up; start it, then start again",
        )
        server = Process(tmp_path, port=server.port)
        # The old bench brings the new server's output to 0 V, and addresses no task of it.
        bench.zero()
        assert server.level == 0.0
        with pytest.raises(BenchError, match="is gone"):
            bench.exchange(1.0)
        assert server.level == 0.0
        bench.close()
        bench.open(NAMES, RATE)
        assert len(list(bench.apply(signals.Step(1.0), 10))) == 5
        bench.close()
        assert server.level == 0.0
    finally:
        server.end()


@pytest.mark.parametrize(
    ("kind", "code", "message"),
    [
        ("overrun", "daq-200279", "readings were overwritten before they were fetched: this computer did not keep up"),
        ("unplug", "bench-lost", "the module was unplugged, or lost its power (NI-DAQmx error -201003); switch the"),
    ],
)
def test_a_failure_of_the_chassis_is_told_and_the_output_brought_to_zero(
    chassis: StandIn, opened: NiBench, kind: str, code: str, message: str
) -> None:
    error, after, _ = run_into(opened.apply(signals.Step(1.0), 1000), lambda: happen(chassis, kind, duration=0.5))
    assert after < 1.0
    assert error.code == code
    assert message in str(error)
    time.sleep(0.6)  # plugged in again
    opened.zero()
    assert chassis.level == 0.0
    # And the bench can go on.
    assert len(list(opened.apply(signals.Step(1.0), 10))) == 5


def test_an_output_that_is_not_fed_holds_and_is_told(chassis: StandIn) -> None:
    bench = NiBench(chassis.rig, ahead=0.2)
    bench.open(NAMES, RATE)
    error, _, _ = run_into(bench.apply(signals.parse("sine 1 V 1 Hz offset=0.5 V"), 1000), lambda: time.sleep(0.6))
    assert error.code == "daq-200290"
    assert str(error) == (
        "the output ran out of samples and holds its last voltage: this computer did not feed it in time "
        "(NI-DAQmx error -200290); end other programs or lower the rate"
    )
    assert chassis.level != 0.0
    bench.zero()
    assert chassis.level == 0.0
    bench.close()


def test_an_output_that_does_not_obey_is_found_out(chassis: StandIn, opened: NiBench) -> None:
    def stick_and_zero() -> None:
        happen(chassis, "stuck")
        opened.zero()

    error, _, got = run_into(opened.apply(signals.Step(1.0), 1000), stick_and_zero)
    assert error.code == "output-stuck"
    assert str(error).startswith("voltage: the output was set to 0 V, but 1 V are still read; switch the amplifier off")
    # The record goes on until it is sure.
    assert 5 < len(got) < 20
    with pytest.raises(BenchError, match=r"1 V are still read; the output could not be brought to 0 V .* switch the"):
        opened.zero()


def test_a_guardian_ends_a_run_from_outside(chassis: StandIn, opened: NiBench) -> None:
    # It is told nothing but the output, the address and the channel that reads the output back.
    output = Output(-10.0, 10.0, chassis.rig.output.physical)
    known = Rig("", (chassis.rig["voltage"],), 0.0, "electrodes", output, address=chassis.address)
    guardian = Resetter(known)
    took: list[float] = []

    def act() -> None:
        begin = time.monotonic()
        guardian.reset()
        took.append(time.monotonic() - begin)
        assert chassis.level == 0.0
        assert abs(guardian.read()) < 0.01  # although the run that it ended still held the inputs

    error, _, _ = run_into(opened.apply(signals.parse("sine 1 V 1 Hz"), 1000), act)
    assert took[0] < 0.4
    assert error.code == "bench-lost"
    assert "another program reset the chassis, or the guardian did" in str(error)
    opened.zero()
    guardian.reset()
    guardian.close()
    guardian.close()


def test_nobody_calls_an_output_0_v_that_was_only_reset(chassis: StandIn, opened: NiBench) -> None:
    opened.exchange(1.0)
    happen(chassis, "stuck")
    guardian = Resetter(chassis.rig)
    guardian.reset()
    assert guardian.read() == pytest.approx(1.0, abs=0.01)
    guardian.close()
    with pytest.raises(BenchError, match="the output was set to 0 V, but 1 V are still read"):
        reset(chassis.rig)
    blind = replace(chassis.rig, channels=tuple(one for one in chassis.rig.channels if one.name != "voltage"))
    guardian = Resetter(blind)
    guardian.reset()
    with pytest.raises(BenchError, match="no channels of this rig show what the output gives"):
        guardian.read()
    guardian.close()
    with pytest.raises(BenchError, match="1 V are still read"):
        opened.zero()


def test_a_guardian_gives_a_slow_server_more_time_with_each_attempt(
    chassis: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that needs longer for a reset than the first attempt allows was never known to be at 0 V."""
    guardian = Resetter(chassis.rig, within=0.2)
    guardian.reset()  # what is slow the first time is done
    at_once = type(chassis.chassis).reset

    def slowly(self: Chassis, devices: Iterable[str]) -> None:
        time.sleep(0.7)
        at_once(self, devices)

    monkeypatch.setattr(type(chassis.chassis), "reset", slowly)
    failed = 0
    while True:
        try:
            guardian.reset()
            break
        except BenchError as error:
            failed += 1
            assert error.code in ("bench-frozen", "bench-lost")  # noqa: PT017  # each of them
            assert failed < 12
    assert failed >= 1
    # The next alarm is again reacted to at once.
    monkeypatch.undo()
    guardian.reset()
    monkeypatch.setattr(type(chassis.chassis), "reset", slowly)
    began = time.monotonic()
    with pytest.raises(BenchError):
        guardian.reset()
    assert time.monotonic() - began < 0.6
    guardian.close()


def test_a_reset_frees_what_a_dead_program_left(chassis: StandIn) -> None:
    left = NiBench(chassis.rig)
    left.open(NAMES, RATE)
    blocks = left.apply(signals.Step(2.0), 10_000)
    next(blocks)
    next(blocks)
    assert chassis.level == pytest.approx(2.0, abs=1e-3)
    reset(chassis.rig)
    assert chassis.level == 0.0
    assert chassis.reserved == []
    with pytest.raises(BenchError):
        for _ in blocks:
            pass
    left.close()


def test_two_benches_are_kept_apart(chassis: StandIn, opened: NiBench) -> None:
    blocks = opened.apply(signals.Step(1.0), 1000)
    next(blocks)
    with pytest.raises(BenchError) as caught:
        NiBench(chassis.rig).open(NAMES, RATE)
    assert caught.value.code == "bench-in-use"
    assert str(caught.value).startswith("cDAQ1Mod2: another run is being recorded on it, by process ")
    # Which did not disturb it.
    assert joined([next(blocks), next(blocks)], "voltage") == pytest.approx(1.0, abs=2e-3)


def test_zero_may_come_from_another_thread(chassis: StandIn, opened: NiBench) -> None:
    blocks = []
    began: list[float] = []

    def zero() -> None:
        began.append(time.monotonic())
        opened.zero()
        began.append(time.monotonic())

    thread = threading.Timer(0.5, zero)
    thread.start()
    for block in opened.apply(signals.Step(1.0), 75):
        blocks.append(block)
    thread.join()
    assert began[1] - began[0] < 1.0
    output, voltage = joined(blocks, "output"), joined(blocks, "voltage")
    assert len(output) == 75
    # Row 0 is read before the step. The voltage ends once, and is told to end no earlier than it does.
    ended = int(np.flatnonzero(np.abs(voltage[1:]) < 0.01)[0]) + 1
    told = int(np.flatnonzero(output[1:] == 0.0)[0]) + 1
    assert voltage[1:ended] == pytest.approx(1.0, abs=2e-3)
    assert voltage[ended:] == pytest.approx(0.0, abs=2e-3)
    assert ended <= told <= ended + round((began[1] - began[0]) * RATE) + 1
    assert np.all(output[told:] == 0.0)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="this system has no timers that send a signal")
def test_zero_may_come_from_a_signal_handler(chassis: StandIn, opened: NiBench) -> None:
    zeroed: list[float] = []

    def handle(*_: object) -> None:
        if len(zeroed) == 3:
            opened.zero()
        zeroed.append(time.monotonic())

    blocks = []
    before = signal.signal(signal.SIGALRM, handle)
    try:
        for block in opened.apply(signals.Step(1.0), 300):
            blocks.append(block)
            if len(blocks) == 5:
                # Again and again, so that it also comes while the output is being fed.
                signal.setitimer(signal.ITIMER_REAL, 0.1, 0.05)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert len(zeroed) > 3
    assert chassis.level == 0.0
    assert joined(blocks, "output")[-20:].tolist() == [0.0] * 20
    assert joined(blocks, "voltage")[-20:] == pytest.approx(0.0, abs=2e-3)


def test_calls_that_make_no_sense_now(opened: NiBench) -> None:
    blocks = opened.apply(signals.Step(1.0), 1000)
    next(blocks)
    with pytest.raises(InputError, match="bench: a signal is being given out; let it end first"):
        opened.exchange(0.0)
    with pytest.raises(InputError, match="bench: a signal is being given out; let it end first"):
        next(opened.apply(signals.Step(1.0), 10))
    assert len(next(blocks)) == 2


# What a rig file or an experiment file gets wrong: refused before anything is given out


def altered(rig: Rig, name: str, **values: object) -> Rig:
    """The rig with one channel changed."""
    channels = tuple(replace(one, **values) if one.name == name else one for one in rig.channels)  # type: ignore[arg-type]
    return replace(rig, channels=channels)


@pytest.mark.parametrize(
    ("change", "rate", "code", "message"),
    [
        (
            lambda rig: altered(rig, "current", physical="cDAQ9Mod1/ai0"),
            RATE,
            "no-device",
            "(cDAQ9Mod1/ai0): there is no module 'cDAQ9Mod1'; there are cDAQ1 (cDAQ-9174), cDAQ1Mod1 (NI 9205)",
        ),
        (
            lambda rig: altered(rig, "current", physical=""),
            RATE,
            "missing-physical",
            "channels.current.physical: no physical channel is given; give the name",
        ),
        (
            lambda rig: altered(rig, "current", converter=Converter(-3.0, 3.0, 0.0)),
            RATE,
            "bad-range",
            "channels.current.range: NI 9205 has no range -3 V to 3 V; give one of: -0.2 V to 0.2 V, -1 V to 1 V, "
            "-5 V to 5 V, -10 V to 10 V",
        ),
        (
            lambda rig: altered(rig, "current", physical="cDAQ1Mod3/ai2"),
            RATE,
            "wrong-module",
            "channels.current.physical (cDAQ1Mod3/ai2): NI 9217 reads no voltages; use an input of an NI 9205",
        ),
        (
            lambda rig: altered(rig, "current", physical="cDAQ1Mod1/ai77"),
            RATE,
            "no-channel",
            "the module has no such input or output",
        ),
        (
            lambda rig: replace(rig, output=Output(-20.0, 20.0, "cDAQ1Mod2/ao0")),
            RATE,
            "bad-range",
            "output.range: NI 9263 does not reach -20 V to 20 V; give a range within -10 V to 10 V",
        ),
        (
            lambda rig: replace(rig, output=Output(-10.0, 10.0, "cDAQ1Mod1/ao0")),
            RATE,
            "wrong-module",
            "output.physical (cDAQ1Mod1/ao0): NI 9205 has no outputs; use an output of an NI 9263",
        ),
        (
            lambda rig: replace(rig, thermometer=Thermometer("cDAQ1Mod1/ai5")),
            RATE,
            "shared-module",
            "thermometer.physical: it is on the module of voltage, cDAQ1Mod1: a module has one sample clock; wire it",
        ),
        (
            lambda rig: rig,
            125e3,
            "bad-rate",
            "rate: 125000 Hz is asked for, the output is given out at 100000 Hz at most",
        ),
        (
            lambda rig: rig,
            200e3,
            "bad-rate",
            "rate: 200000 Hz is asked for, 2 channels are read at 125000 Hz at most; give",
        ),
        (
            lambda rig: rig,
            60e3,
            "bad-rate",
            "rate: 60000 Hz is asked for, the chassis can clock 60015.0038 Hz; give 60015.0037509 Hz, or a rate that",
        ),
    ],
)
def test_what_does_not_fit_is_refused(
    still: StandIn, change: Callable[[Rig], Rig], rate: float, code: str, message: str
) -> None:
    with pytest.raises(IpmclabError) as caught:
        NiBench(change(still.rig)).open(NAMES, rate)
    assert caught.value.code == code
    assert message in str(caught.value)
    assert still.reserved == []
    # Nothing stays reserved, nor held.
    bench = NiBench(still.rig)
    bench.open(NAMES, RATE)
    bench.close()


def test_a_rate_that_the_message_names_is_taken(still: StandIn) -> None:
    bench = NiBench(still.rig)
    bench.open(NAMES, 60015.0037509)
    assert sum(len(block) for block in bench.apply(signals.Step(0.1), 6000)) == 6000
    bench.close()


def test_nothing_answers(still: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ipmclab.rig.ni.ANSWER", 0.5)
    monkeypatch.setattr("ipmclab.rig.daqmx.reset.ANSWER", 0.5)
    monkeypatch.setattr("ipmclab.rig.daqmx.reset._ANSWER_AFTER_FAILURE", 0.5)
    with socket.socket() as taken:
        # Bound and not listened on: nobody else gets the port, and nobody answers.
        taken.bind(("127.0.0.1", 0))
        rig = replace(still.rig, address=f"127.0.0.1:{taken.getsockname()[1]}")
        for attempt in (lambda: NiBench(rig).open(NAMES, RATE), lambda: reset(rig), lambda: Resetter(rig)):
            with pytest.raises(BenchError) as caught:
                attempt()
            assert caught.value.code == "bench-unreachable"
            assert f"address: no gRPC server answers at {rig.address}" in str(caught.value)


def test_a_connection_whose_driver_fails_at_once_is_let_go(still: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = []

    class Noted(Link):
        def close(self) -> None:
            closed.append(self)
            super().close()

    def fail(_: object) -> object:
        raise nidaqmx.errors.DaqError("the device is gone", -88710)

    monkeypatch.setattr("ipmclab.rig.daqmx.driver.Link", Noted)
    monkeypatch.setattr(nidaqmx.system.System, "devices", property(fail))
    with pytest.raises(IpmclabError):
        Driver(nidaqmx, still.rig, wait=5.0)
    assert len(closed) == 1


def test_no_driver_on_this_computer(still: StandIn) -> None:
    import ctypes.util

    if ctypes.util.find_library("nidaqmx") or ctypes.util.find_library("nicaiu"):
        pytest.skip("NI-DAQmx is installed here")
    with pytest.raises(BenchError) as caught:
        NiBench(replace(still.rig, address=None)).open(NAMES, RATE)
    assert caught.value.code == "no-driver"
    assert str(caught.value).startswith(
        "driver: the NI-DAQmx driver is not installed on this computer; install it from"
    )
