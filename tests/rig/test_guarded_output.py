"""What a guardian brings to 0 V: it gets to its process whole, and is reached through a connection of its own."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path

import pytest

from ipmclab import InputError, IpmclabError
from ipmclab.rig.channels import THESIS_RIG, Output, Rig
from ipmclab.rig.daqmx import reset
from ipmclab.rig.safety.guarded_output import Target, connect
from ipmclab.rig.safety.readback import at_output, channels_at_output

REMOTE = replace(THESIS_RIG, address="127.0.0.1:1")
BEHIND = replace(REMOTE, voltage_sensed="electrodes", source_resistance=0.5)


@pytest.fixture
def guarded(monkeypatch: pytest.MonkeyPatch) -> None:
    """What NI's client would be asked to reach is handed back instead."""
    monkeypatch.setattr(reset, "Resetter", lambda rig: rig)


def reached(target: Target) -> Rig:
    """What a guardian's process reaches, that gets its target as a text."""
    rig = connect(Target.from_json(target.to_json()))
    assert isinstance(rig, Rig)
    return rig


@pytest.mark.usefixtures("guarded")
@pytest.mark.parametrize("rig", [THESIS_RIG, REMOTE, BEHIND, replace(THESIS_RIG, source_resistance=2.0)])
def test_a_guardian_resets_the_output_of_the_rig_and_reads_it_back_as_the_rig_does(rig: Rig) -> None:
    same = reached(Target.of(rig))
    assert same.output == Output(rig.output.low, rig.output.high, rig.output.physical)
    assert (same.bench, same.address) == ("ni", rig.address)
    assert channels_at_output(same) == channels_at_output(rig)
    readings = {"voltage": 1.25, "current": 0.1}
    assert at_output(same, readings) == at_output(rig, readings)


@pytest.mark.usefixtures("guarded")
def test_a_guardian_that_is_told_of_a_voltage_alone_takes_it_for_that_of_the_output() -> None:
    rig = reached(Target("ni", "cDAQ1Mod2/ao0", channels=(THESIS_RIG["voltage"],)))
    assert channels_at_output(rig) == ("voltage",)
    assert at_output(rig, {"voltage": 1.25}) == 1.25


def test_a_file_stands_for_an_output_and_gets_a_line_for_each_reset(tmp_path: Path) -> None:
    path = tmp_path / "output.txt"
    connection = connect(Target("file", str(path)))
    path.write_text("3 V at 1.0\n2 V at 2.0\n", encoding="utf-8")
    assert connection.read() == 2.0
    began = time.time()
    connection.reset()
    connection.reset()
    connection.close()
    said = [re.fullmatch(r"0 V at (\d+\.\d{6})", line) for line in path.read_text(encoding="utf-8").splitlines()[2:]]
    assert [one is not None and float(one[1]) >= began - 1e-3 for one in said] == [True, True]
    assert connection.read() == 0.0


def test_a_file_that_cannot_be_written_or_read_is_told(tmp_path: Path) -> None:
    missing, other = tmp_path / "none" / "output.txt", tmp_path / "other.txt"
    with pytest.raises(IpmclabError, match="make its folder"):
        connect(Target("file", str(missing))).reset()
    other.write_text("a word\n", encoding="utf-8")
    empty = tmp_path / "empty.txt"
    empty.touch()
    for path in (missing, other, empty):
        with pytest.raises(IpmclabError, match="see what it is") as told:
            connect(Target("file", str(path))).read()
        assert (told.value.code, told.value.where) == ("unreadable", str(path))


def test_an_unknown_kind_of_output_is_refused() -> None:
    with pytest.raises(InputError, match="guardian: unknown target 'kiosk'; use ni or file"):
        connect(Target("kiosk", "x"))  # type: ignore[arg-type]
