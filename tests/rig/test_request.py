"""What every bench refuses, and the signal that is fed to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
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


@pytest.mark.parametrize("voltage", [10.5, -10.5, np.nan, np.inf])
def test_a_voltage_beyond_the_output_is_refused(voltage: float) -> None:
    request.check_voltage(THESIS_RIG, -10.0)
    with pytest.raises(InputError, match=r"voltage: .* V is asked for, the output gives -10 V to 10 V"):
        request.check_voltage(THESIS_RIG, voltage)


def test_a_row_beyond_the_output_is_found_in_any_piece_of_a_long_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request, "_CHUNK", 7)
    rig = replace(THESIS_RIG, output=Output(-2.0, 2.0))
    signal = signals.parse("step 1 V for 0.5 s then step 3 V")
    request.check_signal(rig, signal, 25, 50.0)
    with pytest.raises(InputError, match=r"signal: the signal asks for 3 V at 0.5 s, the output gives -2 V to 2 V"):
        request.check_signal(rig, signal, 26, 50.0)


def test_pieces_of_a_signal_are_the_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "_AT_ONCE", 7)
    signal = signals.parse("random 1 V 0.1 s")
    whole = signal.voltage(np.arange(100) / 50.0)
    for sizes in ([100], [1] * 100, [13, 0, 27, 60], [3] * 33 + [1]):
        feed = rows.Feed(rows.SignalRows(signal, 100), 50.0)
        assert np.array_equal(np.concatenate([feed.take(size) for size in sizes]), whole)
        assert feed.take(5).tolist() == [whole[-1]] * 5


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
