"""What every bench refuses, and the signal that is fed to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import signals
from ipmclab.errors import InputError
from ipmclab.rig import request, rows
from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import THESIS_RIG, Output
from ipmclab.rig.daqmx.in_use import Hold


def test_two_channels_on_one_input_are_refused() -> None:
    channels = tuple(
        replace(channel, physical="cDAQ1Mod1/ai0") if channel.name == "force" else channel
        for channel in THESIS_RIG.channels
    )
    twice = replace(THESIS_RIG, channels=channels)
    request.check_measured(twice, ["voltage", "current"])
    with pytest.raises(InputError, match=r"channels.force.physical: current and force are both on cDAQ1Mod1/ai0"):
        request.check_measured(twice, ["voltage", "current", "force"])


def test_the_tip_is_measured_free_or_held() -> None:
    request.check_measured(THESIS_RIG, ["voltage", "displacement"])
    request.check_measured(THESIS_RIG, ["voltage", "force", "force"])
    with pytest.raises(InputError, match="displacement and force cannot be measured in one run"):
        request.check_measured(THESIS_RIG, ["displacement", "force"])
    nowhere = replace(THESIS_RIG, channels=tuple(replace(channel, physical="") for channel in THESIS_RIG.channels))
    request.check_measured(nowhere, ["voltage", "current", "force"])


@pytest.mark.parametrize("voltage", [10.5, -10.5, np.nan, np.inf])
def test_a_voltage_beyond_the_output_is_refused(voltage: float) -> None:
    request.check_voltage(THESIS_RIG, -10.0)
    request.check_voltage(THESIS_RIG, 10.0)
    with pytest.raises(InputError, match=r"voltage: .* V is asked for, the output gives -10 V to 10 V"):
        request.check_voltage(THESIS_RIG, voltage)


def test_a_row_beyond_the_output_is_found_in_any_piece_of_a_long_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request, "_CHUNK", 7)
    rig = replace(THESIS_RIG, output=Output(-2.0, 2.0))
    signal = signals.parse("step 1 V for 0.5 s then step 3 V")
    request.check_signal(rig, signal, 25, 50.0)
    with pytest.raises(InputError, match=r"signal: the signal needs 3 V at 0.5 s, the output gives -2 V to 2 V"):
        request.check_signal(rig, signal, 26, 50.0)
    with pytest.raises(InputError, match=r"needs 3 V at 0.5 s"):  # the first of many
        request.check_signal(rig, signal, 40, 50.0)
    with pytest.raises(InputError, match=r"needs 3 V at 0 s"):
        request.check_signal(rig, signals.Step(3.0), 1, 50.0)
    request.check_signal(rig, signals.Square(amplitude=2.0, frequency=1.0), 100, 50.0)


class Measured:
    """A source that says nothing beforehand."""

    length = None
    voltages = look = None


@pytest.mark.parametrize(("low", "high", "taken"), [(-2, 2, True), (-1, 1, True), (-2.1, 2, False), (-2, 2.1, False)])
def test_a_source_that_is_not_known_beforehand_is_held_within_what_the_output_gives(
    low: float, high: float, taken: bool
) -> None:
    rig = replace(THESIS_RIG, output=Output(-2.0, 2.0))
    source = rows.ClampedRows(Measured(), low, high)  # type: ignore[arg-type]
    if taken:
        request.check_rows(rig, source, 50.0)
    else:
        with pytest.raises(InputError, match="nothing holds them within a limit"):
            request.check_rows(rig, source, 50.0)
    # A signal is known.
    request.check_rows(rig, rows.SignalRows(signals.Step(2.0), 10), 50.0)
    with pytest.raises(InputError, match=r"the signal needs 2\.5 V at 0 s"):
        request.check_rows(rig, rows.SignalRows(signals.Step(2.5), 10), 50.0)


def test_pieces_of_a_signal_are_the_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "_AT_ONCE", 7)
    signal = signals.parse("random 1 V 0.1 s")
    whole = signal.voltage(np.arange(100) / 50.0)
    for sizes in ([100], [1] * 100, [13, 0, 27, 60], [3] * 33 + [1]):
        feed = rows.Feed(rows.SignalRows(signal, 100), 50.0)
        assert np.array_equal(np.concatenate([feed.take(size) for size in sizes]), whole)
        assert feed.take(5).tolist() == [whole[-1]] * 5


def test_rows_that_were_taken_are_told_once_more_in_other_pieces() -> None:
    signal = signals.parse("sine 1 V 1 Hz phase=30 deg")
    whole = signal.voltage(np.arange(60) / 50.0)
    feed = rows.Feed(rows.SignalRows(signal, 60), 50.0)
    assert feed.again(2).tolist() == [0.0, 0.0]  # nothing was given out
    told = []
    for taken, wanted in ((10, 4), (10, 6), (0, 3), (7, 7), (33, 40)):
        assert len(feed.take(taken)) == taken
        told.append(feed.again(wanted))
    assert np.array_equal(np.concatenate(told), whole)
    assert feed.again(0).tolist() == []
    assert feed.again(2).tolist() == [whole[-1]] * 2


def test_a_signal_is_computed_in_large_pieces_in_any_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "_AT_ONCE", 100)
    computed: list[int] = []

    class Counted(signals.Step):
        def voltage(self, time: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
            computed.append(len(time))
            return np.asarray(time) * 50.0

    source = rows.SignalRows(Counted(1.0), 300)
    assert [float(source.voltages(row, 1, 50.0)[0]) for row in range(300)] == pytest.approx(np.arange(300.0))
    assert computed == [100, 100, 100]
    assert source.voltages(200, 100, 50.0) == pytest.approx(np.arange(200.0, 300.0))
    assert len(computed) == 3
    # Back, at another rate, and more than a piece.
    assert source.voltages(0, 2, 50.0) == pytest.approx([0.0, 1.0])
    assert source.voltages(1, 2, 25.0) == pytest.approx([2.0, 4.0])
    assert source.voltages(50, 250, 50.0) == pytest.approx(np.arange(50.0, 300.0))
    assert computed == [100, 100, 100, 100, 100, 250]


def test_a_chassis_is_recorded_at_25_hz_or_more() -> None:
    request.check_rate(replace(THESIS_RIG, bench="ni"), 25.0)
    request.check_rate(replace(THESIS_RIG, bench="virtual"), 1.0)
    with pytest.raises(InputError, match="rate: 10 Hz is asked for, on a chassis it is 25 Hz at least") as told:
        request.check_rate(replace(THESIS_RIG, bench="ni"), 10.0)
    assert (told.value.code, told.value.repair) == ("bad-rate", "record at 25 Hz or more")


def test_a_chassis_under_two_names_is_one() -> None:
    held = Hold("127.0.0.1:31799", ["test module"])
    with pytest.raises(BenchError, match="another run is being recorded on it"):
        Hold("localhost:31799", ["test module"])
    Hold("localhost:31798", ["test module"]).release()
    held.release()
    Hold("localhost:31799", ["test module"]).release()
