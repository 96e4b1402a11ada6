"""``ipmclab choose``: one document, a table for people, files."""

from __future__ import annotations

import importlib
import json
import signal
from pathlib import Path

import numpy as np
import pytest

import ipmclab
from tests.cli.conftest import Command

NAME = "step & one.nc"


@pytest.fixture
def step(tmp_path: Path) -> Path:
    """A step of friend-2, 10 s, in a file whose name HTML must not take for its own."""
    clean = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V delay=1 s", duration=10.0, rate=25.0)
    noise = 1e-4 * np.random.default_rng(20261121).standard_normal(len(clean))
    run = ipmclab.Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + noise,
        metadata=ipmclab.RunMetadata(signal="step 1 V", starts_from_rest=True),
    )
    return ipmclab.write_run(run, tmp_path / NAME) or tmp_path / NAME


def test_one_document_and_every_file(command: Command, step: Path, tmp_path: Path) -> None:
    files = ("--out", "best.toml", "--report", "choice.html", "--plot", "choice.svg")
    models = ("--actuator", "friend-2", "--models", "branches=1,2", "--folds", "3", "--free", "electrical")
    outcome = command("choose", NAME, *models, *files, "--json")
    assert outcome.status == 0, outcome.err
    assert outcome.err == ""
    document = outcome.document
    assert document["preferred"] == "branches=2"
    assert [one["name"] for one in document["models"]] == ["branches=2", "branches=1"]
    assert document["models"][1]["to_best"]["told"] is True
    assert document["out"] == "best.toml"
    fit = ipmclab.read_fit(tmp_path / "best.toml")
    assert fit.actuator.structure.branches == 2
    page = (tmp_path / "choice.html").read_text("utf-8")
    assert "branches=2 predicts best" in page
    assert "step &amp; one.nc" in page
    assert "--free electrical" in page  # the command is the one that was given
    assert "--folds 3" in page
    assert "http" not in page.replace("http://www.w3.org", "")
    assert (tmp_path / "choice.svg").stat().st_size > 1000


def test_a_table_for_people(command: Command, step: Path) -> None:
    models = ("--models", "branches=1", "--models", "branches=2", "--models", "line.modes+leak.cubic", "--folds", "3")
    outcome = command("choose", NAME, "--actuator", "friend-2", *models)
    assert outcome.status == 0
    assert "preferred" in outcome.out
    assert "independent ones" in outcome.out
    said = " ".join(outcome.out.split())
    assert "branches=1 predicts worse than branches=2" in said
    assert "line.modes+leak.cubic could not be compared" in said


def interrupted_at(monkeypatch: pytest.MonkeyPatch, branches: int) -> None:
    """Ctrl-C comes when the model of so many branches is fitted without a part."""
    module = importlib.import_module("ipmclab.choosing.choose")
    hold_out = module.hold_out

    def pressed(actuator: ipmclab.Actuator, *given: object) -> object:
        if actuator.structure.branches == branches:
            signal.raise_signal(signal.SIGINT)
        return hold_out(actuator, *given)

    monkeypatch.setattr(module, "hold_out", pressed)


MODELS = ("--actuator", "friend-2", "--models", "branches=1,2,3", "--folds", "2", "--blocks", "8")
MODELS += ("--free", "circuit.dc_resistivity")  # what is kept of a choice does not hang on what is fitted


@pytest.mark.parametrize("as_json", [False, True])
def test_ctrl_c_keeps_what_stands(
    command: Command, step: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, as_json: bool, capsys
) -> None:
    """Two finished models are shown, files are written, and the status is that of an interrupted command."""
    interrupted_at(monkeypatch, 3)
    with pytest.raises(SystemExit) as ended:
        command("choose", NAME, *MODELS, "--out", "best.toml", *(["--json"] if as_json else []))
    assert ended.value.code == 130
    out = capsys.readouterr().out
    assert ipmclab.read_fit(tmp_path / "best.toml").actuator.structure.branches in (1, 2)
    if as_json:
        document = json.loads(out)
        assert document["unfinished"] == ["branches=3"]
        assert document["preferred"] in ("branches=1", "branches=2")
    else:
        assert "Interrupted: branches=3 was not finished, and was not compared." in " ".join(out.split())
        assert "preferred" in out


def test_ctrl_c_before_two_models_are_finished_says_so(command: Command, step: Path, monkeypatch) -> None:
    interrupted_at(monkeypatch, 2)
    outcome = command("choose", NAME, *MODELS)
    assert outcome.status == 130
    assert outcome.err.startswith("error: stopped before two models were finished: nothing can be compared; ")
    assert outcome.out == ""


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--models", "branches=1,2"), "it does not say of which actuator"),
        (("--models", "friend-2"), "1 model was given"),
        (("--models", "friend-2,friend-2+leak.cubik"), "models: friend-2+leak.cubik: no stage is called 'leak.cubik'"),
        (("--models", "branches=1,2", "--actuator", "friend-2", "--hold-out", "all"), "--hold-out"),
        (("--models", "branches=1,2", "--actuator", "friend-2", "--report", "x.pdf"), "must end in .html"),
        (("--models", "branches=1,2", "--actuator", "friend-2", "--folds", "0"), "blocks in 0 folds"),
    ],
)
def test_bad_input_ends_with_2_and_says_what(command: Command, step: Path, words: tuple[str, ...], told: str) -> None:
    outcome = command("choose", NAME, *words)
    assert outcome.status == 2
    assert told in outcome.err
    assert "Traceback" not in outcome.err
