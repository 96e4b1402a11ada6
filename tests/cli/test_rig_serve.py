"""``ipmclab rig serve`` as a program of its own, read through NI's own client, and the words that it refuses."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from ipmclab import InputError
from ipmclab.cli.rig_serve import chassis_of
from ipmclab.rig.channels import THESIS_RIG, Rig
from ipmclab.rig.files.rig_file import load_rig
from ipmclab.rig.files.text import write_rig
from tests.cli.conftest import Command

pytest.importorskip("nidaqmx")


@dataclass
class Served:
    process: subprocess.Popen[str]
    line: str

    def operate(self, words: str) -> str:
        assert self.process.stdin is not None
        assert self.process.stderr is not None
        self.process.stdin.write(words + "\n")
        self.process.stdin.flush()
        return self.process.stderr.readline().strip()


def serve(*words: object) -> Served:
    command = [sys.executable, "-m", "ipmclab", "rig", "serve", *map(str, words)]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stderr is not None
    line = process.stdout.readline().strip()
    process.stderr.readline()
    return Served(process, line)


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    one = serve("--clock", "lock-step", "--hands")
    yield one
    one.process.send_signal(signal.SIGINT)
    out, _ = one.process.communicate(timeout=300)
    assert one.process.returncode == 0
    assert out == "", "stdout carries the one line"


def test_the_stand_in_is_checked_through_the_official_client(served: Served, tmp_path: Path, command: Command) -> None:
    host, _, port = served.line.partition(":")
    assert host == "127.0.0.1"
    assert int(port) > 0
    write_rig(replace(load_rig("thesis"), bench="ni", address=served.line), tmp_path / "rig.toml")
    found = command("rig", "check", "rig.toml", "--json").document
    assert found["bench"].startswith("simulated chassis")
    told = {one["channel"]: one["reading"] for one in found["channels"]}
    assert told["force"] == pytest.approx(4.48e-3, abs=5e-5)
    assert told["displacement"] == pytest.approx(12.3e-3, abs=1e-5)
    assert told["relative_humidity"] == pytest.approx(45.0, abs=0.05)
    assert found["temperature"]["value"] == pytest.approx(22.0, abs=0.1)
    assert {one["code"] for one in found["findings"]} == {"no-calibration"}

    assert served.operate("tip clear") == "done: tip clear"
    assert served.operate("tip clar").startswith("error: hands: unknown words 'tip clar'; did you mean 'tip clear'?")
    assert served.operate("laser blocked") == "done: laser blocked"
    found = command("rig", "check", "rig.toml", "--json").document
    assert {"no-preload", "nothing-seen"} <= {one["code"] for one in found["findings"]}


def test_a_dummy_load_is_served_from_a_rig_file(tmp_path: Path) -> None:
    rig = load_rig("thesis")
    write_rig(replace(rig, virtual=replace(rig.virtual, load="dummy")), tmp_path / "rig.toml")
    one = serve(tmp_path / "rig.toml", "--clock", "x10", "--levels", tmp_path / "levels", "--json")
    assert '"address": "127.0.0.1:' in one.line
    one.process.terminate()
    one.process.communicate(timeout=300)
    assert one.process.returncode in (0, 1)  # Windows ends it without asking


def test_a_taken_port_is_refused(served: Served, command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ipmclab.platform.go_first", lambda: None)  # it would be this process that does
    outcome = command("rig", "serve", "--port", served.line.rpartition(":")[2])
    assert outcome.status == 2
    assert "--port" in outcome.err
    assert "give another port, or 0 for a free one" in outcome.err
    assert outcome.out == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--clock", "slow"], "error: --clock: unknown clock 'slow'; give real, x10 or lock-step"),
        (["--fault", "explode"], "error: --fault: fault 'explode'"),
        (["nowhere.toml"], "error: rig: there is no rig 'nowhere.toml'"),
        (["--port", "99999"], "error: --port: there is no port 99999, they go from 0 to 65535"),
        (["--port", "http"], "Input should be a valid integer"),
    ],
)
def test_wrong_words_are_refused(command: Command, words: list[str], message: str) -> None:
    outcome = command("rig", "serve", *words)
    assert outcome.status == 2
    assert message in outcome.err
    assert outcome.out == ""


def wired(**physical: str) -> Rig:
    return replace(
        THESIS_RIG,
        channels=tuple(replace(one, physical=physical.get(one.name, one.physical)) for one in THESIS_RIG.channels),
    )


def test_the_chassis_is_that_of_the_rig() -> None:
    assert chassis_of(THESIS_RIG) == ("cDAQ1", ("NI 9205", "NI 9263", "NI 9217"))
    assert chassis_of(replace(THESIS_RIG, thermometer=None, four_probe=None))[1] == ("NI 9205", "NI 9263")
    other = replace(THESIS_RIG, output=replace(THESIS_RIG.output, physical="cDAQ1Mod4/ao1"))
    assert chassis_of(other)[1] == ("NI 9205", "NI 9205", "NI 9217", "NI 9263")
    for rig, message in (
        (wired(force="Dev1/ai0"), "channels.force.physical: 'Dev1/ai0' is at no module of a cDAQ-9174"),
        (wired(force="cDAQ1Mod2/ai0"), "slot 2 would need an NI 9263 and an NI 9205"),
        (wired(force="cDAQ2Mod1/ai0"), "the rig is wired to 2 chassis: cDAQ1, cDAQ2"),
    ):
        with pytest.raises(InputError) as caught:
            chassis_of(rig)
        assert message in str(caught.value)
