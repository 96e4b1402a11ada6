"""``ipmclab rig``: what a newcomer sees, and what a script reads."""

from __future__ import annotations

from pathlib import Path

import pytest

from ipmclab.rig.files.rig_file import load_rig
from ipmclab.rig.files.text import rig_to_text
from tests.cli.conftest import Command


def test_a_rig_is_checked(command: Command) -> None:
    outcome = command("rig", "check", "thesis")
    assert outcome.status == 0
    assert "at most 58.82 mA at an edge, 117.6 mA at a polarity reversal" in outcome.out
    assert "-200 to 200 mA" in outcome.out
    assert "info no-calibration" in outcome.out
    assert outcome.err == ""


def test_the_check_is_one_document(command: Command) -> None:
    outcome = command("rig", "check", "thesis", "--amplitude", "3 V", "--fail-on", "error", "--json")
    assert outcome.status == 1
    document = outcome.document
    assert document["worst"] == "error"
    assert document["peak_current_at_reversal"] == {"value": pytest.approx(6.0 / 17.0), "unit": "A"}
    current = next(one for one in document["channels"] if one["channel"] == "current")
    assert current["range"] == pytest.approx([-0.2, 0.2], abs=1e-4)
    assert {one["code"] for one in document["findings"]} == {
        "range-too-small",
        "no-calibration",
        "amplifier-limit",  # 353 mA of 300 mA
    }
    assert command("rig", "check", "thesis", "--amplitude", "3 V").status == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["rig", "check", "nowhere.toml"], "error: rig: there is no rig 'nowhere.toml'"),
        (["rig", "check", "thesis", "--amplitude", "3"], "error: --amplitude: '3' has no unit"),
        (["rig", "check", "thesis", "--amplitude", "-3 V"], "it must be above 0"),
        (["rig", "check", "thesis", "--actuator", "freind-2"], "did you mean 'friend-2'?"),
        (["rig", "check", "thesis", "--fail-on", "eror"], "did you mean 'error'?"),
        (["rig", "chek", "thesis"], "No such command 'chek'"),
        (["rig", "check"], "Missing argument 'RIG'"),
    ],
)
def test_wrong_words_are_refused(command: Command, words: list[str], message: str) -> None:
    outcome = command(*words)
    assert outcome.status == 2
    assert message in outcome.err
    assert outcome.out == ""
    assert "Traceback" not in outcome.err


def test_a_rig_file_that_cannot_be_is_refused(command: Command, tmp_path: Path) -> None:
    text = rig_to_text(load_rig("thesis"))
    (tmp_path / "rig.toml").write_text(text.replace('"-0.2 V"', '"-0.3 V"').replace('"0.2 V"', '"0.3 V"'), "utf-8")
    outcome = command("rig", "check", "rig.toml", "--json")
    assert outcome.status == 2
    assert outcome.document["error"]["where"] == "rig.toml: channels.current.range"
    assert outcome.document["error"]["repair"] == 'write ["-1 V", "1 V"]'


def test_without_more_words_it_tells_what_there_is(command: Command) -> None:
    outcome = command("rig")
    assert outcome.status == 0
    assert "check" in outcome.out
