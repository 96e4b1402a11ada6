"""The hardware check list on the stand-in: by the books with its dummy load, and stopped by anything else."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from ipmclab import InputError
from ipmclab.rig.channels import THESIS_RIG, Converter
from ipmclab.rig.checks.from_outside import unplugged
from ipmclab.rig.checks.proof import WITHIN, proof_of, proof_path, read_proof
from ipmclab.rig.checks.prove import prove
from ipmclab.rig.files.rig_file import load_rig
from ipmclab.rig.files.text import write_rig
from tests.cli.conftest import Command

pytest.importorskip("nidaqmx")


@contextmanager
def served(path: Path, *, load: str, clock: str = "real") -> Iterator[None]:
    """A stand-in, and a rig file that leads to it."""
    rig = replace(load_rig("thesis"), bench="ni", virtual=replace(THESIS_RIG.virtual, load=load))
    write_rig(rig, path)
    command = [sys.executable, "-m", "ipmclab", "rig", "serve", str(path), "--clock", clock]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    write_rig(replace(rig, address=process.stdout.readline().strip()), path, overwrite=True)
    try:
        yield
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=300)


@pytest.mark.real_time
def test_the_list_is_gone_through_with_the_dummy_load(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "rig.toml"
    with served(path, load="dummy"):
        outcome = command("rig", "prove", "rig.toml", "--yes", "--operator", "NN", "--json")
        answers = iter(["", "1,0 V", "1.0 V", ""])
        asked: list[str] = []

        def ask(question: str) -> str:
            asked.append(question)
            return next(answers)

        item = unplugged(load_rig(path), str(path), 1.0, simulated=False, ask=ask)
        assert unplugged(load_rig(path), str(path), 1.0, simulated=False, ask=None).status == "not done"
    assert (item.status, item.found) == ("noted", "1 V by the voltmeter; the program had not noticed yet")
    assert "emergency stop" in item.repair
    assert "'1,0 V' has a comma" in asked[2]
    assert outcome.status == 0, outcome.out
    proof = read_proof(proof_path(path))
    assert (proof.passed, proof.simulated, proof.operator) == (True, True, "NN")
    seen = {item.name: item for item in proof.items}
    assert list(seen) == [
        *("clock", "noise-voltage", "noise-current", "load", "order", "stop", "end", "clock-terminal"),
        *("kill-alone", "kill", "hang", "reset", "unplugged"),
    ]
    assert seen["load"].found == "10 ohm and 100 mF"
    assert seen["clock-terminal"].found.endswith("/SampleClock")
    # Without the guardian the output would have stayed: the check sees a voltage where there is one.
    assert seen["kill-alone"].found == "it holds 1 V"
    for name in ("kill", "hang", "reset"):
        assert float(seen[name].found.split()[3]) <= WITHIN
    assert outcome.document["cited"] == proof_of(load_rig(path), path)
    assert "not proven on this hardware: proved against a stand-in on 20" in outcome.document["cited"]
    assert [item["name"] for item in outcome.document["items"]] == list(seen)
    assert {key for item in outcome.document["items"] for key in item} == {"name", "what", "status", "seen", "repair"}


@pytest.mark.real_time
def test_a_strip_is_not_put_through_it(tmp_path: Path, command: Command) -> None:
    path = tmp_path / "rig.toml"
    with served(path, load="strip"):
        outcome = command("rig", "prove", "rig.toml", "--yes")
    assert outcome.status == 1
    assert "take the strip out and clamp the dummy load" in outcome.out
    assert "NOT passed; the report is rig.proof.toml" in outcome.out
    proof = read_proof(proof_path(path))
    assert not proof.passed
    assert [item.name for item in proof.items if item.status == "failed"] == ["load"]
    assert proof.items[-1].name == "load", "nothing was tried after it"
    assert "it did not pass load" in proof_of(load_rig(path), path)


def test_a_chassis_without_real_time_cannot_be_timed(tmp_path: Path, command: Command) -> None:
    with served(tmp_path / "rig.toml", load="dummy", clock="lock-step"):
        outcome = command("rig", "prove", "rig.toml", "--yes")
    assert outcome.status == 2
    assert "serve it with --clock real" in outcome.err
    assert not proof_path(tmp_path / "rig.toml").exists()


def test_what_cannot_be_proved_is_refused(tmp_path: Path, command: Command) -> None:
    write_rig(load_rig("thesis"), tmp_path / "rig.toml")
    for words, message in (
        (["rig.toml", "--yes"], "a virtual bench has no hardware to prove"),
        (["thesis", "--yes"], "thesis is the rig in the library"),
        (["rig.toml"], "nobody can be asked whether the dummy load is in the clamp"),
    ):
        outcome = command("rig", "prove", *words)
        assert outcome.status == 2
        assert message in outcome.err
    hardware = replace(THESIS_RIG, bench="ni")
    with pytest.raises(InputError, match="there is no channel current"):
        prove(replace(hardware, channels=(hardware["voltage"],)), "rig.toml")
    small = replace(hardware, voltage_sensed="electrodes")
    channels = [
        replace(one, converter=Converter(-0.2, 0.2, 1e-5)) if one.name == "voltage" else one for one in small.channels
    ]
    with pytest.raises(InputError, match=r"hold 0\.16 V over the dummy load, 0\.3 V are needed"):
        prove(replace(small, channels=tuple(channels)), "rig.toml")
