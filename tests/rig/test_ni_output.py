"""What the NI bench does and tells of its output where 0 V comes twice, slowly, or half-way through a failure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ipmclab import signals
from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import Channel
from ipmclab.rig.daqmx.client import client
from ipmclab.rig.daqmx.driver import Driver
from ipmclab.rig.daqmx.look import Watcher
from ipmclab.rig.daqmx.look_back import read_output
from ipmclab.rig.daqmx.reset import Resetter, reset
from ipmclab.rig.daqmx.tasks import OnDemand, TimedTasks
from ipmclab.rig.ni import NiBench
from tests.rig.conformance import joined
from tests.rig.stand_in import StandIn, serve
from virtual_cdaq.model.faults import Fault

NAMES = ("voltage", "current")
RATE = 50.0


@pytest.fixture(scope="module")
def chassis() -> Iterator[StandIn]:
    """A stand-in whose time passes only when it is read."""
    with serve("lock-step") as stand_in:
        yield stand_in


@pytest.fixture
def opened(chassis: StandIn) -> Iterator[NiBench]:
    """A bench on it, at 50 Hz."""
    chassis.rest()
    bench = NiBench(chassis.rig)
    bench.open(NAMES, RATE)
    yield bench
    bench.close()


def stick(chassis: StandIn) -> None:
    """Let the output stay where it is, whatever it is told."""
    with chassis.chassis.lock:
        chassis.chassis.suffer(Fault("stuck"), chassis.chassis.clock.now())


def test_a_second_zero_does_not_take_back_what_the_first_did(opened: NiBench, monkeypatch: pytest.MonkeyPatch) -> None:
    sampled = TimedTasks.sampled
    # 10 rows lie in the chassis that were not fetched yet.
    monkeypatch.setattr(TimedTasks, "sampled", lambda self: sampled(self) + 10)
    blocks = []
    for block in opened.apply(signals.Step(2.0), 60):
        blocks.append(block)
        if block.first_row in (20, 30):
            opened.zero()
    assert joined(blocks, "output").tolist() == [0.0] + [2.0] * 31 + [0.0] * 28


def test_an_output_that_is_told_0_v_again_and_again_is_found_stuck() -> None:
    with serve("lock-step") as chassis:
        # A divider of 10 V to 1 V in front of the input: what is told is what the output gives.
        channels = tuple(replace(one, gain=10.0) if one.name == "voltage" else one for one in chassis.rig.channels)
        bench = NiBench(replace(chassis.rig, channels=channels))
        bench.open(NAMES, RATE)
        blocks = bench.apply(signals.Step(1.0), 200)
        seen = [next(blocks) for _ in range(10)]
        stick(chassis)

        def zero_at_every_block() -> None:
            for block in blocks:
                seen.append(block)
                bench.zero()

        with pytest.raises(BenchError, match="the output was set to 0 V, but 10 V are still read"):
            zero_at_every_block()
        # 0.1 s, in which it may settle, and two blocks.
        assert [block.first_row for block in seen[10:]] == list(range(20, 30, 2))
        with pytest.raises(BenchError, match="the output could not be brought to 0 V"):
            bench.close()


def test_an_output_that_settles_slowly_is_not_stuck(
    chassis: StandIn, opened: NiBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ipmclab.rig.daqmx.look_back.SETTLED", 0.0)
    opened.exchange(1.0)
    read, still = OnDemand.read, [0.6]

    def slowly(self: OnDemand) -> dict[str, float]:
        readings = read(self)
        return {**readings, "voltage": still.pop() if still else readings["voltage"]}

    monkeypatch.setattr(OnDemand, "read", slowly)
    opened.zero()
    assert not still
    assert not any("_ai_" in name for name in chassis.reserved)  # others may read meanwhile
    assert opened.exchange(0.0)["voltage"] == pytest.approx(0.0, abs=2e-3)


def test_inputs_that_were_made_by_half_are_made_anew(
    chassis: StandIn, opened: NiBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    add, failed = Driver.add_input, []

    def fail_once(self: Driver, task: object, channel: Channel) -> None:
        if channel.name == "current" and not failed:
            failed.append(channel.name)
            raise BenchError("the module is gone", code="gone")
        add(self, task, channel)

    monkeypatch.setattr(Driver, "add_input", fail_once)
    with pytest.raises(BenchError, match="the module is gone"):
        opened.exchange(1.0)
    assert not any("_ai_" in name for name in chassis.reserved)
    assert set(opened.exchange(1.0)) == set(NAMES)
    assert opened.exchange(0.0)["voltage"] == pytest.approx(1.0, abs=2e-3)


def test_an_output_that_was_made_by_half_is_made_anew(chassis: StandIn, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = Driver(client(), chassis.rig, wait=5.0)
    add, failed = Driver.add_output, []

    def fail_once(self: Driver, task: object) -> None:
        if not failed:
            failed.append(task)
            raise BenchError("the module is gone", code="gone")
        add(self, task)

    monkeypatch.setattr(Driver, "add_output", fail_once)
    demand = OnDemand(driver, NAMES)
    with pytest.raises(BenchError, match="the module is gone"):
        demand.write(1.0)
    demand.write(1.0)
    assert chassis.level == pytest.approx(1.0, abs=1e-3)
    demand.write(0.0)
    demand.close()
    driver.close()


@pytest.mark.parametrize("unread", [0, 1, 10])
def test_a_signal_that_was_left_early_is_told_to_its_last_row_that_was_given_out(
    opened: NiBench, monkeypatch: pytest.MonkeyPatch, unread: int
) -> None:
    signal = signals.parse("sine 1 V 1 Hz")
    sampled = TimedTasks.sampled
    monkeypatch.setattr(TimedTasks, "sampled", lambda self: sampled(self) + unread)
    blocks = opened.apply(signal, 100)
    next(blocks)
    blocks.close()  # type: ignore[attr-defined]
    # The next record begins with the voltage that the output has.
    (block,) = opened.apply(signals.Step(0.0), 2)
    assert block.output[0] == signal.voltage(np.array([(2 + unread - 1) / RATE]))[0]


def test_a_guardian_resets_the_output_and_leaves_the_inputs_until_it_must_read(
    chassis: StandIn, opened: NiBench
) -> None:
    opened.exchange(1.0)
    held = [name for name in chassis.reserved if "_ai_" in name]
    assert len(held) == 1
    guardian = Resetter(chassis.rig)
    guardian.reset()
    assert chassis.level == 0.0
    assert held[0] in chassis.reserved
    assert abs(guardian.read()) < 0.01
    assert not any("_ai_" in name for name in chassis.reserved)
    guardian.close()


def fail_to_write_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the output not be written to, the next time."""
    write, failed = OnDemand.write, []

    def fail_once(self: OnDemand, voltage: float) -> None:
        if not failed:
            failed.append(voltage)
            raise BenchError("the module is busy", code="busy")
        write(self, voltage)

    monkeypatch.setattr(OnDemand, "write", fail_once)


@pytest.mark.parametrize("looks", [1, 3])
def test_a_reset_waits_for_the_guardian_of_another_program_to_read_the_output(
    chassis: StandIn, monkeypatch: pytest.MonkeyPatch, looks: int
) -> None:
    """It holds the inputs meanwhile, for one look or for ever."""
    chassis.rest()
    guardian = Driver(client(), chassis.rig, wait=10.0, patience=10.0)
    inputs = OnDemand(guardian, NAMES)
    asked: list[Driver] = []

    def read(driver: Driver) -> float:
        if not asked:
            inputs.read()
        asked.append(driver)
        return read_output(driver)

    def sleep(_: float) -> None:
        if len(asked) == looks:
            inputs.release_inputs()

    times = iter([0.0, 0.5, 1.0])
    clock = SimpleNamespace(monotonic=lambda: next(times) if looks > 1 else 0.0, sleep=sleep)
    monkeypatch.setattr("ipmclab.rig.daqmx.reset.read_output", read)
    monkeypatch.setattr("ipmclab.rig.daqmx.reset.time", clock)
    try:
        if looks == 1:
            reset(chassis.rig)
            assert len(asked) == 2
        else:
            with pytest.raises(BenchError, match="could not be read back: another program holds it"):
                reset(chassis.rig)
    finally:
        inputs.close()
        guardian.close()


@pytest.mark.parametrize("is_kept", [False, True])
def test_whoever_looks_on_takes_the_inputs_back_as_often_as_a_guardian_takes_them(
    chassis: StandIn, monkeypatch: pytest.MonkeyPatch, is_kept: bool
) -> None:
    """It reads the output again and again until it is at 0 V; what holds them for ever is told."""
    chassis.rest()
    guardian = Driver(client(), chassis.rig, wait=10.0, patience=10.0)
    inputs = OnDemand(guardian, NAMES)
    watcher = Watcher(chassis.rig)
    take, taken = Watcher.take, []

    def taken_again(self: Watcher) -> None:
        take(self)
        taken.append(self)
        if is_kept or len(taken) < 4:
            inputs.release_inputs()  # a reset ended this task: the next reading makes another
            inputs.read()

    times = iter(float(second) for second in range(100))
    monkeypatch.setattr(Watcher, "take", taken_again)
    monkeypatch.setattr("ipmclab.rig.daqmx.look.time", SimpleNamespace(monotonic=lambda: next(times)))
    try:
        if is_kept:
            with pytest.raises(BenchError, match="another program holds it"):
                watcher.output()
        else:
            assert watcher.output() == 0.0
            assert len(taken) == 4
    finally:
        watcher.close()
        inputs.close()
        guardian.close()


def test_an_output_that_cannot_be_written_to_is_reset(
    chassis: StandIn, opened: NiBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened.exchange(1.0)
    fail_to_write_once(monkeypatch)
    opened.zero()
    assert chassis.level == 0.0
    assert opened.exchange(1.0)["voltage"] == pytest.approx(0.0, abs=2e-3)
    assert opened.exchange(0.0)["voltage"] == pytest.approx(1.0, abs=2e-3)


def test_a_record_goes_on_while_its_output_is_reset(opened: NiBench, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = []
    for block in opened.apply(signals.Step(1.0), 60):
        blocks.append(block)
        if block.first_row == 20:
            fail_to_write_once(monkeypatch)
            opened.zero()
    assert joined(blocks, "output").tolist() == [0.0] + [1.0] * 21 + [0.0] * 38
    assert joined(blocks, "voltage")[22:] == pytest.approx(np.zeros(38), abs=2e-3)


def test_a_reset_that_leaves_a_voltage_is_no_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    with serve("lock-step") as chassis:
        bench = NiBench(chassis.rig)
        bench.open(NAMES, RATE)
        bench.exchange(1.0)
        stick(chassis)
        fail_to_write_once(monkeypatch)
        with pytest.raises(
            BenchError, match="the output could not be brought to 0 V: the output was set to 0 V, but 1"
        ):
            bench.zero()
        bench.close()  # which was told, and is not told twice
        with pytest.raises(BenchError, match="the output was set to 0 V, but 1 V are still read"):
            reset(chassis.rig)
