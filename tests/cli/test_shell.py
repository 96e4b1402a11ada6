"""The shell around the verbs: exit status, streams, errors, JSON, and a light start."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import pytest
import typer

from ipmclab import InputError, Run, read_run, write_run
from ipmclab.cli import expand_patterns, main, output
from ipmclab.cli.options import SpreadCommand, matching_files

VERBS = ("demo", "simulate", "import", "export", "check", "plot", "identify", "validate", "report")


def program(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ipmclab", *words],
        check=False,
        capture_output=True,
        encoding="utf-8",
        timeout=300,
        **options,
    )


def test_help_names_every_verb_and_imports_nothing_heavy() -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "ipmclab", "--help"],
        check=False,
        capture_output=True,
        encoding="utf-8",
    )
    assert done.returncode == 0
    listed = [line.split()[0] for line in done.stdout.splitlines() if line.startswith("  ") and line.strip()]
    assert set(VERBS) <= set(listed)
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert not imported & {"numpy", "scipy", "numba", "xarray", "matplotlib", "pydantic", "pandas", "rich"}


@pytest.mark.parametrize("verb", VERBS)
def test_each_verb_has_help_with_an_example(command, verb: str) -> None:
    done = command(verb, "--help")
    assert done.status == 0
    assert f"ipmclab {verb}" in done.out.partition("\n")[2]


@pytest.mark.parametrize(
    "words", [(verb,) for verb in VERBS] + [("rig", one) for one in ("check", "prove", "serve", "sheet")]
)
def test_help_is_written_for_people(command, words: tuple[str, ...]) -> None:
    """It had "{RUN...}... <list[Path]>", "--count <int>", and the mark of a paragraph in the one of the page."""
    text = command(*words, "--help").out
    assert not re.search(r"<[a-z]|\\b|\{", text), text


@pytest.mark.parametrize("words", [(), ("rig",)])
def test_the_list_of_verbs_has_whole_sentences(command, words: tuple[str, ...]) -> None:
    listed = command(*words, "--help").out.partition("Commands:")[2].split("\n  ")
    assert not [line for line in listed if "..." in line]


def test_no_word_at_all_shows_the_help(command) -> None:
    assert command().out == command("--help").out


def test_a_usage_error_is_one_message_with_status_2() -> None:
    done = program("simulat")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "did you mean 'simulate'" in done.stderr.lower()


@pytest.mark.parametrize(
    ("words", "lacking", "example"),
    [
        (["identify", "friend-2", "step.nc"], "--out", "ipmclab identify friend-2 step.nc"),
        (["validate"], "ACTUATOR", "ipmclab validate fitted.toml"),
        (["rig", "check"], "RIG", "ipmclab rig check rig.toml"),
    ],
)
def test_what_a_command_lacks_is_named_with_a_whole_command(command, words, lacking, example) -> None:
    done = command(*words, "--json")
    assert done.status == 2
    error = done.document["error"]
    assert lacking in error["message"]
    assert error["repair"].startswith(f"write for example: {example}")


def test_a_usage_error_with_json_is_a_document_on_stdout_and_the_message_on_stderr() -> None:
    done = program("simulate", "--json", "--rat", "5")
    assert done.returncode == 2
    error = json.loads(done.stdout)["error"]
    assert set(error) == {"code", "message", "where", "repair"}
    assert error["code"] == "usage"
    assert "--rate" in error["message"]
    assert error["message"] in done.stderr


def test_what_is_stopped_while_it_loads_says_so_in_one_line(monkeypatch, capsys) -> None:
    class Loading:
        def __getattr__(self, name: str) -> object:
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "ipmclab.cli.app", Loading())
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 130
    assert capsys.readouterr().err == "error: stopped before it began; run the command again\n"


@pytest.mark.parametrize(
    ("failure", "status", "code"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (typer.Abort(), 130, "interrupted"),
        (RuntimeError("odd"), 1, "fault"),
        (MemoryError(), 1, "fault"),
        (PermissionError(13, "Permission denied", "a.nc"), 2, "file"),
        (IsADirectoryError(21, "Is a directory", "a.nc"), 2, "file"),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), 2, "not-utf-8"),
    ],
)
def test_what_nobody_foresaw_is_one_message_too(command, monkeypatch, failure, status: int, code: str) -> None:
    def fail(*_: object) -> None:
        raise failure

    monkeypatch.setattr("ipmclab.cli.check.read_runs", fail)
    done = command("check", "a.nc", "--json")
    assert (done.status, done.document["error"]["code"]) == (status, code)
    assert done.err.count("\n") == 1


def test_the_end_of_what_is_typed_at_a_question_is_no_fault(command, monkeypatch) -> None:
    """Ctrl-D: nobody has to report it."""

    def ask(*_: object) -> None:
        raise EOFError

    monkeypatch.setattr("ipmclab.cli.check.read_runs", ask)
    done = command("check", "a.nc")
    assert (done.status, done.err.strip()) == (130, "error: stopped before the end; run the command again")


def test_a_fault_names_the_way_to_its_traceback_which_shows_it_and_nothing_else_does(command, monkeypatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("odd")

    monkeypatch.setattr("ipmclab.cli.check.read_runs", fail)
    monkeypatch.delenv("IPMCLAB_TRACEBACK", raising=False)
    usual = command("check", "a.nc")
    assert "the same command once more with the environment variable IPMCLAB_TRACEBACK set to 1" in usual.err
    assert "Traceback" not in usual.err
    monkeypatch.setenv("IPMCLAB_TRACEBACK", "1")
    shown = command("check", "a.nc", "--json")
    assert (shown.status, shown.document["error"]["code"]) == (1, "fault")  # the rest is as it was
    assert "Traceback (most recent call last)" in shown.err
    assert "in fail" in shown.err
    assert shown.err.endswith(usual.err)
    assert "Traceback" not in command("check").err  # a wrong use is no fault


def test_stdout_that_cannot_write_greek_does_not_fail(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from ipmclab.cli.app import run; run(['--version']); print('δ')"],
        check=False,
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "cp1252"},
    )
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1] == b"?"


def test_a_reader_that_leaves_early_is_no_error() -> None:
    writer = subprocess.Popen(
        [sys.executable, "-m", "ipmclab", "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert writer.stdout is not None
    writer.stdout.close()
    _, err = writer.communicate(timeout=300)
    assert err == b""


def test_json_has_no_number_that_is_not_finite(capsys) -> None:
    output.print_json({"a": float("nan"), "b": [float("inf"), 1.5], "c": {"d": -float("inf")}, "e": (1, "µ")})
    printed = capsys.readouterr().out
    assert printed.isascii()
    assert json.loads(printed) == {"a": None, "b": [None, 1.5], "c": {"d": None}, "e": [1, "µ"]}


def test_patterns_are_expanded_where_the_shell_does_not(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("b.nc", "a.nc", "c.csv"):
        (tmp_path / name).touch()
    assert expand_patterns(["check", "*.nc", "*.mat", "--json"]) == ["check", "a.nc", "b.nc", "*.mat", "--json"]


def test_a_pattern_names_all_runs_of_a_laboratory_folder(tmp_path: Path, monkeypatch) -> None:
    """A shell that knows no ``**`` leaves it to the program, on every system; the message on a folder names it."""
    monkeypatch.chdir(tmp_path)
    deep = tmp_path / "runs" / "runs" / "2026" / "11"
    deep.mkdir(parents=True)
    run = Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[0.0, 0.0, 0.0], current=[0.0, 0.0, 0.0])
    for name in ("b.nc", "a.nc"):
        write_run(run, deep / name)
    with pytest.raises(InputError) as refused:
        read_run("runs")
    (pattern,) = (word for word in refused.value.repair.split() if "*" in word)
    found = [os.path.join("runs", "runs", "2026", "11", name) for name in ("a.nc", "b.nc")]
    assert matching_files(pattern) == expand_patterns([pattern]) == found


@pytest.mark.parametrize(
    "words",
    [
        ["fit.toml", "--runs", "a.nc", "b.nc", "--validation", "c.nc", "d.nc", "--json"],
        ["--json", "fit.toml", "--runs=a.nc", "b.nc", "--validation=c.nc", "--validation", "d.nc"],
        ["--runs", "a.nc", "--json", "fit.toml", "--runs", "b.nc", "--validation", "c.nc", "d.nc"],
    ],
)
def test_an_option_may_be_followed_by_several_files(words: list[str]) -> None:
    seen = []
    app = typer.Typer()

    @app.command(cls=SpreadCommand)
    def report(
        fitted: str,
        runs: Annotated[list[str], typer.Option()],
        validation: Annotated[list[str], typer.Option()],
        as_json: Annotated[bool, typer.Option("--json")] = False,
    ) -> None:
        seen.append((fitted, runs, validation, as_json))

    typer.main.get_command(app).main(args=words, standalone_mode=False)
    assert seen == [("fit.toml", ["a.nc", "b.nc"], ["c.nc", "d.nc"], True)]
