"""What verbs say beside their tables: warnings of the model, findings in brief, and a first answer."""

from __future__ import annotations

import io
import re

import pytest

from ipmclab import Finding, identify, load_actuator, simulate
from ipmclab.cli.output import print_briefly, progress
from ipmclab.model.variants import stage_names
from ipmclab.run import Severity


def simulated(command, signal: str, rate: str = "50 Hz"):
    return command(
        "simulate", "friend-2", "--signal", signal, "--duration", "4 s", "--rate", rate, "--out", "a.nc", "--force"
    )


@pytest.mark.parametrize(
    ("signal", "rate", "words"),
    [
        ("step 1 V", "50 Hz", []),
        ("step 1.3 V", "50 Hz", ["water decomposes above 1.23 V"]),
        ("step 1000 V", "50 Hz", ["reaches 1000 V", "more than 0.2 of the free length of 25 mm"]),
        # Friend, eq. 4.7 with table 4.2: the first mode of sample 2 lies near 38 Hz, a third of it near 12.8 Hz.
        ("sine 1 V 12 Hz", "500 Hz", []),
        ("sine 1 V 14 Hz", "500 Hz", ["goes up to 14 Hz, more than a third of the first resonance"]),
        ("step 1 V for 1 s then sine 1 V 14 Hz", "500 Hz", ["goes up to 14 Hz"]),
    ],
)
def test_what_the_model_does_not_hold_for_is_said(command, signal: str, rate: str, words: list[str]) -> None:
    done = simulated(command, signal, rate)
    assert done.status == 0
    told = " ".join(done.err.split())
    assert told.count("warning:") == len(words)
    assert "remark" not in told
    assert all(word in told for word in words)


def test_warnings_of_a_validation_stand_in_json_too(command) -> None:
    simulated(command, "step 2 V")
    done = command("validate", "friend-2", "a.nc", "--json")
    assert done.err == ""
    (validation,) = done.document["validations"]
    (text,) = validation["warnings"]
    assert text.startswith("a.nc: the voltage reaches 2 V")


def test_a_perfect_prediction_is_not_judged_by_its_rounding(command) -> None:
    simulated(command, "step 1 V")
    (validation,) = command("validate", "friend-2", "a.nc", "--json").document["validations"]
    assert all(score["autocorrelation_outside_band"] is None for score in validation["runs"][0]["scores"].values())


def test_infos_in_brief_are_grouped_and_the_worst_comes_first(capsys: pytest.CaptureFixture[str]) -> None:
    long = "a long story " * 40
    print_briefly([Finding("small", "info", long), Finding("bad", "error", "it broke"), Finding("small", "info", long)])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "  error bad"
    assert lines[2] == "  info small (2 times)"
    assert len(lines) == 5
    assert all(len(line) <= 200 for line in lines)


@pytest.mark.parametrize("severity", ["warning", "error"])
def test_warnings_and_errors_are_told_in_full_each_with_its_repair(
    severity: Severity, capsys: pytest.CaptureFixture[str]
) -> None:
    long = " ".join(f"word{k}" for k in range(80))
    first = Finding("at-bound", severity, f"first {long} end", f"mend {long} so", channel="current")
    print_briefly([first, Finding("at-bound", severity, "another one", "mend it otherwise")])
    out = capsys.readouterr().out
    told = " ".join(out.split())
    for text in (f"first {long} end", f"-> mend {long} so", "another one", "-> mend it otherwise"):
        assert text in told
    assert "..." not in told
    assert "(current)" in told
    assert all(len(line) <= 100 for line in out.splitlines())


@pytest.mark.parametrize("code", ["exact-fixed-value", "fixed-uncertainty", "undetermined"])
def test_the_number_that_decides_is_never_cut(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    long = "a value that nobody knows well " * 10
    print_briefly([Finding(code, "info", f"{long} 1 % of it moves another by {k}.5 %") for k in (29, 66)])
    out = capsys.readouterr().out
    told = " ".join(out.split())
    assert "29.5 %" in told
    assert "66.5 %" in told
    assert "..." not in told
    assert all(len(line) <= 100 for line in out.splitlines())


def test_warnings_that_ask_for_the_same_stand_together(capsys: pytest.CaptureFixture[str]) -> None:
    print_briefly([Finding("odd", "warning", f"run {k} is odd", "look at it") for k in range(3)])
    out = capsys.readouterr().out
    assert out.splitlines()[0] == "  warning odd (3 times)"
    assert out.count("-> look at it") == 1
    assert all(f"run {k} is odd" in out for k in range(3))


class Terminal(io.StringIO):
    """What is written to it, as to a terminal."""

    def isatty(self) -> bool:
        return True


def test_a_first_answer_is_shown_while_the_rest_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V", duration=10, rate=20)
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with progress("identifying", answering=True) as on_progress:
        fit = identify(strip, run, free=["circuit.dc_resistivity"], progress=on_progress)
    shown = terminal.getvalue()
    assert "First answer" in shown
    value = re.search(r"circuit.dc_resistivity +([\d.]+) ohm m", shown)
    assert value is not None
    assert float(value[1]) == pytest.approx(fit.parameters["circuit.dc_resistivity"].value, rel=1e-3)


def test_a_fit_on_the_way_to_another_answer_shows_none_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V", duration=10, rate=20)
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with progress("sampling") as on_progress:
        identify(strip, run, free=["circuit.dc_resistivity"], progress=on_progress)
    assert "sampling" in terminal.getvalue()
    assert "First answer" not in terminal.getvalue()


def test_how_much_is_done_is_seen_on_a_narrow_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setenv("COLUMNS", "40")
    with progress(f"identifying {'+'.join(['friend-2', *stage_names()])}") as tell:
        tell("looking for other answers", 0.62)
    assert "62 % identifying" in terminal.getvalue()


def test_where_nobody_looks_there_is_no_first_answer(capsys: pytest.CaptureFixture[str]) -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V", duration=10, rate=20)
    with progress("identifying", answering=True) as on_progress:
        identify(strip, run, free=["circuit.dc_resistivity"], progress=on_progress)
    assert capsys.readouterr() == ("", "")
