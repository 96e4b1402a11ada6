"""The contract of the command line: documents on stdout, messages on stderr, exit statuses, nothing overwritten."""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ipmclab
from ipmclab.cli import app
from tests.independent.bounds import ELECTRICAL
from tests.independent.thesis import FRIEND_2

REPOSITORY = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Outcome:
    """What one command left behind."""

    returncode: int
    stdout: str
    stderr: str


def ipmclab_cli(*arguments: str | Path, cwd: Path | None = None) -> Outcome:
    """One command in this process; that the program does the same is looked at once, at the end."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(cwd or Path.cwd()), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = app.run([str(argument) for argument in arguments])
    return Outcome(status, out.getvalue(), err.getvalue())


def document(result: Outcome) -> Any:
    """The one JSON document on stdout, strictly read."""

    def refuse(text: str) -> None:
        raise AssertionError(f"{text} is no JSON number")

    value = json.loads(result.stdout, parse_constant=refuse)
    assert_finite(value)
    return value


def assert_finite(value: Any) -> None:
    if isinstance(value, dict):
        for item in value.values():
            assert_finite(item)
    elif isinstance(value, list):
        for item in value:
            assert_finite(item)
    elif isinstance(value, float):
        assert math.isfinite(value)


def succeeded(result: Outcome) -> Outcome:
    assert result.returncode == 0, result.stderr
    assert "Traceback" not in result.stderr
    return result


def refused(result: Outcome, *words: str) -> str:
    assert result.returncode == 2, (result.returncode, result.stdout, result.stderr)
    assert "Traceback" not in result.stderr
    message = result.stderr.strip()
    assert message
    for word in words:
        assert word in message, message
    return message


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three runs simulated by the command line, and the same with noise."""
    path = tmp_path_factory.mktemp("cli")
    for name, signal in (("step", "step 1 V"), ("sine", "sine 1 V 0.1 Hz"), ("square", "square 1 V 0.1 Hz")):
        succeeded(
            ipmclab_cli(
                "simulate", "friend-2", "--signal", signal, "--duration", "40 s", "--rate", "50 Hz",
                "--out", path / f"{name}.nc",
            )
        )  # fmt: skip
    generator = np.random.default_rng(20261121)
    for name in ("step", "sine", "square"):
        run = ipmclab.read_run(path / f"{name}.nc")
        noisy = ipmclab.Run.from_arrays(
            time=run.time,
            voltage=run.voltage,
            current=run.current + 1e-4 * generator.standard_normal(len(run)),
            force=run.force + 1e-4 * generator.standard_normal(len(run)),
            metadata=ipmclab.RunMetadata(starts_from_rest=True, signal=name),
        )
        ipmclab.write_run(noisy, path / f"noisy_{name}.nc")
        ipmclab.write_run(replace(noisy, force=None), path / f"current_{name}.nc")
    return path


@pytest.fixture(scope="module")
def folder(runs: Path) -> Path:
    """The same folder with a fit made from two of the runs by the command line."""
    succeeded(
        ipmclab_cli(
            "identify", "friend-2", runs / "noisy_step.nc", runs / "noisy_sine.nc",
            "--free", "electrical", "--out", runs / "fitted.toml",
        )
    )  # fmt: skip
    return runs


def test_help_names_every_verb() -> None:
    text = succeeded(ipmclab_cli("--help")).stdout
    for verb in ("demo", "simulate", "import", "export", "check", "plot", "identify", "validate", "report"):
        assert verb in text


def test_a_simulated_file_is_the_simulation(runs: Path) -> None:
    run = ipmclab.read_run(runs / "step.nc")
    assert len(run) == 2000
    assert run.hold == "zero"
    assert run.current is not None
    assert run.current[0] == pytest.approx(6.0348029019e-2, rel=1e-10)
    assert run.metadata.origin == "simulated"


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
def test_simulate_hold_and_json(hold: str, tmp_path: Path) -> None:
    out = tmp_path / "run.nc"
    result = succeeded(
        ipmclab_cli(
            "simulate", "friend-2", "--signal", "sine 1 V 0.1 Hz", "--duration", "10 s", "--rate", "50 Hz",
            "--hold", hold, "--out", out, "--json",
        )
    )  # fmt: skip
    assert isinstance(document(result), dict)
    assert ipmclab.read_run(out).hold == hold


def test_check_says_ok_and_fails_on_request(runs: Path, tmp_path: Path) -> None:
    result = succeeded(ipmclab_cli("check", runs / "noisy_step.nc", "--json"))
    document(result)
    run = ipmclab.read_run(runs / "noisy_step.nc")
    lost = run.force.copy()
    lost[800:1200] = np.nan
    flags = np.zeros(len(run), dtype=np.uint8)
    flags[800:1200] = 2
    bad = ipmclab.Run.from_arrays(
        time=run.time, voltage=run.voltage, current=-run.current, force=lost, quality={"force": flags}
    )
    ipmclab.write_run(bad, tmp_path / "bad.nc")
    assert succeeded(ipmclab_cli("check", tmp_path / "bad.nc")).returncode == 0
    failed = ipmclab_cli("check", tmp_path / "bad.nc", "--fail-on", "warning", "--json")
    assert failed.returncode == 1
    findings = json.dumps(document(failed))
    assert "code" in findings
    assert "Traceback" not in failed.stderr
    refused(ipmclab_cli("check", runs / "step.nc", "--fail-on", "catastrophe"), "catastrophe")


def test_identify_document_and_file(folder: Path, tmp_path: Path) -> None:
    result = succeeded(
        ipmclab_cli(
            "identify", "friend-2", folder / "noisy_step.nc", folder / "noisy_sine.nc",
            "--free", "circuit.dc_resistivity,circuit.branches.0.resistivity",
            "--free", "circuit.branches.0.permittivity,circuit.branches.1.resistivity,circuit.branches.1.permittivity",
            "--out", tmp_path / "again.toml", "--json",
        )
    )  # fmt: skip
    parameters = document(result)["fit"]["parameters"]
    for name in ELECTRICAL:
        entry = parameters[name]
        assert entry["value"] == pytest.approx(FRIEND_2.dotted()[name], rel=0.06)
        assert entry["standard_error"] > 0
        assert entry["determined"] is True
        low, high = entry["interval"]
        assert low < entry["value"] < high
    group = ipmclab.load_actuator(folder / "fitted.toml").parameters()
    names = ipmclab.load_actuator(tmp_path / "again.toml").parameters()
    for name in ELECTRICAL:
        assert names[name].value == pytest.approx(group[name].value, rel=1e-6)


def test_an_undetermined_fit_prints_null_not_infinity(runs: Path) -> None:
    result = succeeded(
        ipmclab_cli(
            "identify", "friend-2", runs / "current_step.nc", runs / "current_sine.nc",
            "--free", "electrical,circuit.sheet_resistance", "--out", runs / "six.toml", "--json",
        )
    )  # fmt: skip
    value = document(result)["fit"]
    assert value["undetermined"]
    assert not value["parameters"]["circuit.branches.0.resistivity"]["determined"]
    assert ipmclab.load_actuator(runs / "six.toml").name


def test_a_fitted_file_is_an_actuator_for_simulate_and_validate(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "predicted.nc"
    succeeded(
        ipmclab_cli(
            "simulate", folder / "fitted.toml", "--signal", "square 1 V 0.1 Hz", "--duration", "40 s",
            "--rate", "50 Hz", "--out", out,
        )
    )  # fmt: skip
    truth = ipmclab.read_run(folder / "square.nc")
    difference = ipmclab.read_run(out).current - truth.current
    assert np.sqrt(np.mean(difference**2)) < 1e-4
    value = document(
        succeeded(
            ipmclab_cli("validate", folder / "fitted.toml", folder / "noisy_square.nc", "--also", "friend-2", "--json")
        )
    )
    text = json.dumps(value)
    for word in ("fit_percent", "rmse", "rmse_percent_of_range", "max_error", "friend-2"):
        assert word in text


def test_validate_names_runs_that_the_fit_had_used(folder: Path) -> None:
    result = succeeded(ipmclab_cli("validate", folder / "fitted.toml", folder / "noisy_step.nc"))
    assert "noisy_step" in result.stdout + result.stderr
    assert "used" in (result.stdout + result.stderr).lower()
    fresh = succeeded(ipmclab_cli("validate", folder / "fitted.toml", folder / "noisy_square.nc"))
    assert "was used" not in (fresh.stdout + fresh.stderr).lower()


def test_scores_are_matlabs(folder: Path) -> None:
    fitted = ipmclab.load_actuator(folder / "fitted.toml")
    run = ipmclab.read_run(folder / "noisy_square.nc")
    score = ipmclab.validate(fitted, [run]).runs[0].scores["current"]
    predicted = ipmclab.simulate(fitted, run)
    error = run.current - predicted.current
    assert score.fit_percent == pytest.approx(
        100 * (1 - np.linalg.norm(error) / np.linalg.norm(run.current - run.current.mean())), abs=1e-6
    )
    assert score.rmse == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-6)
    assert score.rmse_percent_of_range == pytest.approx(100 * score.rmse / np.ptp(run.current), rel=1e-6)
    assert score.max_error == pytest.approx(np.max(np.abs(error)), rel=1e-6)


def test_report_is_one_file_without_a_network(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "report.html"
    result = succeeded(
        ipmclab_cli(
            "report", folder / "fitted.toml", "--runs", folder / "noisy_step.nc", "--runs", folder / "noisy_sine.nc",
            "--validation", folder / "noisy_square.nc", "--out", out, "--json",
        )
    )  # fmt: skip
    document(result)
    page = out.read_text(encoding="utf-8")
    assert "<svg" in page
    for loading in ('src="http', 'href="http://', 'rel="stylesheet" href', "<script src", "@import", "url(http"):
        assert loading not in page
    runs = [ipmclab.read_run(folder / f"noisy_{name}.nc") for name in ("step", "sine", "square")]
    for word in ("friend-2", ipmclab.__version__, *(run.content_sha256 for run in runs)):
        assert word in page
    before = page
    refused(
        ipmclab_cli("report", folder / "fitted.toml", "--runs", folder / "noisy_step.nc", "--out", out), "report.html"
    )
    assert out.read_text(encoding="utf-8") == before


@pytest.mark.parametrize("suffix", ["csv", "xlsx", "mat"])
def test_export(suffix: str, runs: Path, tmp_path: Path) -> None:
    out = tmp_path / f"run.{suffix}"
    succeeded(ipmclab_cli("export", runs / "step.nc", "--out", out))
    run = ipmclab.read_run(runs / "step.nc")
    if suffix == "csv":
        lines = [line for line in out.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
        header = lines[0].split(",")
        column = next(i for i, name in enumerate(header) if "current" in name.lower())
        values = np.array([float(line.split(",")[column]) for line in lines[1:]])
    elif suffix == "mat":
        import scipy.io

        values = np.squeeze(scipy.io.loadmat(out)["current"])
    else:
        import openpyxl

        sheet = openpyxl.load_workbook(out, read_only=False).worksheets[0]
        rows = list(sheet.iter_rows(values_only=True))
        header, column = next(
            (i, j)
            for i, row in enumerate(rows)
            for j, x in enumerate(row)
            if isinstance(x, str) and "current" in x.lower()
        )
        values = np.array([row[column] for row in rows[header + 1 :] if isinstance(row[column], (int, float))])
    assert len(values) == 2000
    scale = 1.0 if abs(values[0]) < 1 else 1e-3
    np.testing.assert_allclose(values * scale, run.current, rtol=1e-12)


def test_nothing_is_overwritten_without_force(runs: Path) -> None:
    target = runs / "step.nc"
    before = target.read_bytes()
    arguments = ["simulate", "friend-2", "--signal", "step 2 V", "--duration", "1 s", "--rate", "50 Hz", "--out"]
    refused(ipmclab_cli(*arguments, target), "step.nc", "--force")
    assert target.read_bytes() == before
    copy = runs / "copy.nc"
    copy.write_bytes(before)
    succeeded(ipmclab_cli(*arguments, copy, "--force"))
    assert len(ipmclab.read_run(copy)) == 50


BAD_INPUT: dict[str, tuple[list[str], tuple[str, ...]]] = {
    "unknown actuator": (
        ["simulate", "freind-2", "--signal", "step 1 V", "--duration", "1 s", "--rate", "50 Hz", "--out", "x.nc"],
        ("freind-2", "friend-2"),
    ),
    "wrong unit": (
        ["simulate", "friend-2", "--signal", "step 1 V", "--duration", "1 V", "--rate", "50 Hz", "--out", "x.nc"],
        ("duration", "V"),
    ),
    "no unit": (
        ["simulate", "friend-2", "--signal", "step 1 V", "--duration", "40", "--rate", "50 Hz", "--out", "x.nc"],
        ("duration", "unit"),
    ),
    "decimal comma": (
        ["simulate", "friend-2", "--signal", "step 1,5 V", "--duration", "1 s", "--rate", "50 Hz", "--out", "x.nc"],
        ("1,5",),
    ),
    "negative number as an option value": (
        ["simulate", "friend-2", "--signal", "step 1 V", "--duration", "-1 s", "--rate", "50 Hz", "--out", "x.nc"],
        ("duration", "-1"),
    ),
    "zero rate": (
        ["simulate", "friend-2", "--signal", "step 1 V", "--duration", "1 s", "--rate", "0 Hz", "--out", "x.nc"],
        ("rate", "0"),
    ),
    "unknown signal": (
        ["simulate", "friend-2", "--signal", "stpe 1 V", "--duration", "1 s", "--rate", "50 Hz", "--out", "x.nc"],
        ("stpe", "step"),
    ),
    "unknown hold": (
        ["simulate", "friend-2", "--signal", "step 1 V", "--duration", "1 s", "--rate", "50 Hz", "--hold", "second",
         "--out", "x.nc"],
        ("second", "zero"),
    ),
    "a folder that is not there": (
        ["simulate", "friend-2", "--signal", "step 1 V", "--duration", "1 s", "--rate", "50 Hz", "--out", "no/x.nc"],
        ("no",),
    ),
    "missing run": (["check", "nowhere.nc"], ("nowhere.nc",)),
    "missing option": (["simulate", "friend-2", "--duration", "1 s", "--rate", "50 Hz", "--out", "x.nc"], ("signal",)),
    "unknown option": (["simulate", "friend-2", "--sginal", "step 1 V"], ("sginal",)),
    "unknown verb": (["simulte", "friend-2"], ("simulte",)),
    "unknown export format": (["export", "EMPTY", "--out", "x.docx"], ()),
    "an empty run": (["check", "EMPTY"], ("empty.nc",)),
    "unknown parameter": (
        ["identify", "friend-2", "STEP", "--free", "circuit.dc_resistivty", "--out", "x.toml"],
        ("dc_resistivty", "circuit.dc_resistivity"),
    ),
    "unknown group": (["identify", "friend-2", "STEP", "--free", "electricl", "--out", "x.toml"], ("electrical",)),
    "nothing free": (["identify", "friend-2", "STEP", "--free", "", "--out", "x.toml"], ("free",)),
    "a report of an actuator that is no fit": (
        ["report", "friend-2", "--runs", "STEP", "--out", "x.html"],
        ("friend-2",),
    ),
    "a signal file longer than the record": (
        ["simulate", "friend-2", "--signal", "file long.csv", "--duration", "1 s", "--rate", "50 Hz", "--out", "x.nc"],
        ("long.csv",),
    ),
    "import without a map": (["import", "long.csv", "--map", "nomap.toml", "--out", "x.nc"], ("nomap.toml",)),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_exits_2_with_one_message(case: str, runs: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.nc").write_bytes(b"")
    rows = "\n".join(f"{t / 10},{0.5}" for t in range(200))
    (tmp_path / "long.csv").write_text(f"time [s],voltage [V]\n{rows}\n", encoding="utf-8")
    places = {"STEP": str(runs / "noisy_step.nc"), "EMPTY": "empty.nc"}
    arguments, words = BAD_INPUT[case]
    arguments = [places.get(argument, argument) for argument in arguments]
    result = ipmclab_cli(*arguments, "--json", cwd=tmp_path)
    message = refused(result, *words)
    error = document(result)["error"]
    assert set(error) == {"code", "message", "where", "repair"}
    assert error["code"]
    assert "".join(error["message"].split()) in "".join(message.split()), "the message on stderr is the document's"
    assert not (tmp_path / "x.nc").exists()
    assert not (tmp_path / "x.toml").exists()
    assert not (tmp_path / "no").exists()


def test_without_json_nothing_stands_on_stdout(tmp_path: Path) -> None:
    result = ipmclab_cli("check", "nowhere.nc", cwd=tmp_path)
    refused(result, "nowhere.nc")
    assert result.stdout == ""


def test_the_python_module_does_what_its_verbs_do_here(runs: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ipmclab", "check", str(runs / "noisy_step.nc"), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path, check=False)
    here = ipmclab_cli("check", runs / "noisy_step.nc", "--json")
    assert (done.returncode, done.stdout, done.stderr) == (here.returncode, here.stdout, here.stderr)
    command[3:] = ["check", "nowhere.nc", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path, check=False)
    here = ipmclab_cli("check", "nowhere.nc", "--json", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (here.returncode, here.stdout, here.stderr)


def test_the_console_script_is_there() -> None:
    script = Path(sys.executable).with_name("ipmclab.exe" if os.name == "nt" else "ipmclab")
    if not script.exists():
        pytest.skip("the console script is not beside this interpreter")
    version = subprocess.run([script, "--help"], capture_output=True, text=True, timeout=300, check=True)
    assert "simulate" in version.stdout
