"""Figures from the command line: a run is called by its file."""

from __future__ import annotations

from pathlib import Path

from ipmclab.cli.files import labels


def test_runs_of_one_signal_are_told_apart_by_their_files(command, tmp_path: Path) -> None:
    for actuator, out in (("friend-2", "linear.nc"), ("friend-2+leak.cubic", "leaky.nc")):
        words = ("--signal", "step 1 V", "--duration", "2 s", "--rate", "20 Hz", "--out", out)
        assert command("simulate", actuator, *words).status == 0
    assert command("plot", "linear.nc", "leaky.nc", "--out", "both.svg").status == 0
    drawn = (tmp_path / "both.svg").read_text(encoding="utf-8")
    assert "linear.nc" in drawn
    assert "leaky.nc" in drawn


def test_files_called_alike_are_named_with_their_folder() -> None:
    assert labels([Path("a") / "step.nc", Path("b") / "step.nc", Path("c") / "sine.nc"]) == [
        "a/step.nc",
        "b/step.nc",
        "sine.nc",
    ]


def test_what_does_not_go_together_is_refused(command, tmp_path: Path) -> None:
    words = ("--signal", "sine 1 V 0.1 Hz", "--duration", "10 s", "--rate", "20 Hz", "--out", "run.nc")
    assert command("simulate", "friend-2", *words).status == 0
    for wrong, repair in (
        (("--before", "friend-2"), "add --after ACTUATOR, or draw it alone: --after friend-2"),
        (("--characteristic", "--before", "friend-2"), "leave --before and --after out"),
        (("--characteristic", "--after", "friend-2"), "leave --before and --after out"),
    ):
        refused = command("plot", "run.nc", *wrong, "--out", "figure.svg")
        assert refused.status == 2
        assert repair in refused.err
        assert not (tmp_path / "figure.svg").exists()
    assert command("plot", "run.nc", "--characteristic", "--out", "v_i.svg").status == 0
    assert "voltage (V)" in (tmp_path / "v_i.svg").read_text(encoding="utf-8")
    both = ("--before", "friend-2+leak.cubic", "--after", "friend-2")
    assert command("plot", "run.nc", *both, "--out", "estimation.svg").status == 0
    assert "before: friend-2" in (tmp_path / "estimation.svg").read_text(encoding="utf-8")
    assert command("plot", "run.nc", "--after", "friend-2", "--out", "alone.svg").status == 0
    alone = (tmp_path / "alone.svg").read_text(encoding="utf-8")
    assert "after: friend-2" in alone
    assert "before" not in alone


def test_a_model_goes_by_its_file(command, tmp_path: Path) -> None:
    """Fits of one strip have one name in their files."""
    words = ("--signal", "step 1 V", "--duration", "20 s", "--rate", "20 Hz", "--out", "run.nc")
    assert command("simulate", "friend-2", *words).status == 0
    assert command("identify", "friend-2", "run.nc", "--free", "electrical", "--out", "mine.toml").status == 0
    assert "the fit of mine.toml did not identify the coupling" in command("validate", "mine.toml", "run.nc").out
    both = ("--before", "friend-2", "--after", "mine.toml")
    assert command("plot", "run.nc", *both, "--out", "estimation.svg").status == 0
    drawn = (tmp_path / "estimation.svg").read_text(encoding="utf-8")
    assert "before: friend-2" in drawn
    assert "after: mine.toml" in drawn
