"""What ``ipmclab record`` refuses, each before the strip has seen a volt and with a message that says what to do."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ipmclab.cli import recorder
from ipmclab.cli.app import run
from ipmclab.cli.record import _answers
from ipmclab.cli.recorder import answers_of, plan_of, read_experiment, rig_of, session_of
from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.rig.experiments.plan import make_plan
from ipmclab.rig.experiments.steps import Question
from ipmclab.rig.process import hub
from ipmclab.rig.process.messages import Message
from ipmclab.rig.virtual import VirtualBench
from ipmclab.store.journal.laboratory import Laboratory
from tests.rig.stand_in import StandIn, serve

GOOD = """
sample = "friend-2"
rig = "rig.toml"
folder = "laboratory"
signal = "step 1 V"
rate = "50 Hz"
duration = "2 s"
measured = ["current"]
steps = ["apply"]
fingerprint = false
zero_time = "1 s"
"""


class Desk:
    """Answers with the default."""

    def tell(self, message: Message) -> None:
        """Nothing is remembered."""

    def ask(self, question: Question, ended: Callable[[], bool]) -> str:
        return question.default


@pytest.fixture(scope="module")
def stand_in() -> Iterator[StandIn]:
    with serve("lock-step") as served:
        yield served


def rig_text(address: str, change: Callable[[str], str] = lambda text: text) -> str:
    library = Path(__file__).parents[2] / "src" / "ipmclab" / "rig" / "files" / "library" / "thesis.toml"
    text = library.read_text(encoding="utf-8").replace('bench = "virtual"', f'bench = "ni"\naddress = "{address}"')
    return change(text)


def attempt(folder: Path, experiment: str, **job: Any) -> None:
    """What a recorder's process does, in this one."""
    (folder / "experiment.toml").write_text(experiment, encoding="utf-8")
    whole = {"experiment": str(folder / "experiment.toml"), "answers": {}, "yes": True, "interactive": False, **job}
    read = read_experiment(whole)
    rig = rig_of(read)
    laboratory = Laboratory.open(read.folder)
    plan = plan_of(read, rig, laboratory)
    answers_of(whole, plan)
    session_of(plan, laboratory, Desk(), None).run()


@pytest.mark.parametrize(
    ("experiment", "rig", "code", "words"),
    [
        # the list of bad input, one by one
        ("", lambda t: t.replace('["-5 V", "5 V"]', '["5 V", "-5 V"]'), None, "range"),
        ("", lambda t: t.replace('["-5 V", "5 V"]', '["-20 V", "20 V"]'), None, "range"),
        ('signal = "step 12 V"\n[limits]\nvoltage = "10 V"', None, "out-of-range", "the output gives -10 V to 10 V"),
        ('signal = "step 35 V"', None, "voltage-limit", "the limit is 3.5 V"),
        ('signal = "step 5 V"', None, "voltage-limit", "the limit is 3.5 V"),
        ("", lambda t: t.replace("Mod1/ai3", "Mod1/ai0"), "duplicate-channel", "ai0"),
        ("", lambda t: t.replace("cDAQ1", "cDAQ7"), None, "cDAQ7"),
        ('rate = "2e6 Hz"\nduration = "0.1 s"', None, "bad-rate", "experiment.toml: rate"),
        ('rig = "nowhere.toml"', None, "no-rig", "nowhere.toml"),
        ('sample = ""', None, "missing-key", "sample"),
        ('measured = ["curent"]', None, "unknown-channel", "did you mean 'current'"),
    ],
)
def test_refused_before_a_volt(
    tmp_path: Path, stand_in: StandIn, experiment: str, rig: Any, code: str | None, words: str
) -> None:
    changes = dict(line.split(" = ", 1) for line in experiment.splitlines() if " = " in line and "limits" not in line)
    kept = [line for line in GOOD.splitlines() if line.split(" = ")[0] not in changes]
    (tmp_path / "rig.toml").write_text(rig_text(stand_in.address, rig or (lambda text: text)), encoding="utf-8")
    with pytest.raises(IpmclabError) as caught:
        attempt(tmp_path, "\n".join([*kept, experiment]))
    assert words in str(caught.value)
    assert caught.value.repair
    assert code in (None, caught.value.code)
    with stand_in.chassis.lock:
        assert not stand_in.chassis.levels["cDAQ1Mod2/ao0"]
    assert not list(tmp_path.rglob("*.runj"))


def test_a_server_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(rig_text("127.0.0.1:9"), encoding="utf-8")
    with pytest.raises(IpmclabError) as caught:
        attempt(tmp_path, GOOD)
    assert "127.0.0.1:9" in str(caught.value)


def test_a_driver_that_is_not_installed(tmp_path: Path, stand_in: StandIn) -> None:
    """Without an address the chassis is behind NI's driver, which a computer without NI's software has not."""
    # A name that no chassis has: on a computer with the driver this must not find a rig to drive.
    without = rig_text("", lambda text: text.replace('address = ""\n', "").replace("cDAQ1", "NoSuchChassis"))
    (tmp_path / "rig.toml").write_text(without, encoding="utf-8")
    with pytest.raises(IpmclabError) as caught:
        attempt(tmp_path, GOOD)
    assert "NI-DAQmx" in str(caught.value) or "NoSuchChassis" in str(caught.value)
    assert caught.value.repair


def test_answers_from_a_file_and_from_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "answers.toml").write_text('clamp = "done"\nhydrate = "done"\n', encoding="utf-8")
    found = _answers(["clamp=kept"], tmp_path / "answers.toml")
    assert found == {"clamp": "kept", "hydrate": "done"}


def test_a_disk_without_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Laboratory, "free_space", lambda _: 10_000_000)
    with pytest.raises(InputError, match=r"the disk has 10.0 MB left"):
        attempt(tmp_path, GOOD.replace("rig.toml", "virtual"))


def test_an_environment_that_never_settles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(VirtualBench, "operate", lambda *_: None)  # nobody sets the chamber
    text = GOOD.replace("rig.toml", "virtual").replace('["apply"]', '["chamber-on", "equilibrium", "apply"]')
    with pytest.raises(InputError, match=r"did not settle within 120 s: the temperature is 22.0 degC"):
        attempt(
            tmp_path,
            text + '[environment]\ntemperature = "40 degC"\nsettle = "1 min"\nlongest_wait = "2 min"\n',
        )


def test_yes_vouches_for_no_act_of_a_person(tmp_path: Path) -> None:
    """Neither that a strip was clamped, nor that it lay in its solvent, nor that the tip is clear of the load cell."""
    table = {"sample": "s", "signal": "step 1 V", "rate": "50 Hz", "duration": "4 s", "measured": ["current", "force"]}
    job = {"answers": {}, "yes": True, "interactive": False}
    real = make_plan(experiment_from_table(table), replace(THESIS_RIG, bench="ni"), bytes_free=10**10)
    said = answers_of(job, real)
    assert {said[step.name] for step in real.steps if step.question is not None} == {"unknown", "skip"}
    assert (said["clamp"], said["hydrate"], said["zero"], said["preload"]) == ("unknown", "unknown", "skip", "unknown")
    assert answers_of({**job, "answers": {"clamp": "done"}}, real)["clamp"] == "done"
    # Nobody ever takes the strip of the virtual rig out of its clamp.
    virtual = make_plan(experiment_from_table(table), THESIS_RIG, bytes_free=10**10)
    for yes in (True, False):
        assert answers_of({**job, "yes": yes}, virtual)["clamp"] == "kept"


def test_a_question_that_nobody_would_answer(tmp_path: Path, stand_in: StandIn) -> None:
    (tmp_path / "rig.toml").write_text(rig_text(stand_in.address), encoding="utf-8")
    with pytest.raises(InputError, match=r"clamp ask.*--answer clamp=done"):
        attempt(tmp_path, GOOD.replace('["apply"]', '["clamp", "apply"]'), yes=False)


def test_a_folder_that_may_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its recorder says so and ends, before it has a client."""
    (tmp_path / "experiment.toml").write_text(GOOD.replace("rig.toml", "virtual"), encoding="utf-8")
    job = {"experiment": str(tmp_path / "experiment.toml"), "answers": {}, "yes": True, "interactive": False}

    def refuse(path: Path, text: str) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(hub, "write_for_owner_only", refuse)
    monkeypatch.setattr("sys.stdin", io.StringIO(json.dumps(job)))
    monkeypatch.setattr(recorder.os, "dup2", lambda *_: None)
    monkeypatch.setattr("ipmclab.platform.go_first", lambda: None)  # it would be this process that does
    assert recorder.main() == 2
    error = json.loads(capfd.readouterr().out)["error"]
    assert error["message"] == "the laboratory folder cannot be written: Permission denied"
    assert error["where"].startswith(str(tmp_path / "laboratory" / "recording"))
    assert "another folder" in error["repair"]


def test_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """One message on stderr, one document on stdout, exit status 2, no traceback: also from the recorder's process."""
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text(GOOD.replace("rig.toml", "virtual").replace("step 1 V", "step 35 V"), encoding="utf-8")
    Path("answers.toml").write_text("clamp = 1", encoding="utf-8")
    for words, code in (
        (["bad.toml"], "voltage-limit"),
        (["nothing.toml"], "no-such-file"),
        ([], "usage"),
        (["bad.toml", "--answer", "clamp"], "usage"),
        (["bad.toml", "--answers", "answers.toml"], "bad-value"),
        (["bad.toml", "--repeats", "0"], "out-of-range"),
        (["--attach", "."], "no-recorder"),
        (["bad.toml", "--attach", "."], "usage"),
        (["--attach", ".", "--plan"], "usage"),
    ):
        assert run(["record", *words, "--json"]) == 2, words
        told = capsys.readouterr()
        assert json.loads(told.out)["error"]["code"] == code
        assert told.err.startswith("error: ")
        assert "Traceback" not in told.err


def test_more_repeats_than_can_be_planned(command, tmp_path: Path) -> None:
    """Found among drawn bad inputs: a thousand million runs were planned, until the memory was full."""
    (tmp_path / "experiment.toml").write_text("", encoding="utf-8")
    refused = command("record", "experiment.toml", "--plan", "--repeats", "999999999")
    assert refused.status == 2
    assert "--repeats: 999999999 repeats; give 1 to 1000" in refused.err
