"""``rig check`` reads a chamber and leaves it as it is; ``rig prove`` brings it to standby."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from typer.testing import CliRunner

from ipmclab.cli.app import app
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.checks.chamber import chamber_findings, chamber_items
from ipmclab.rig.checks.proof import rig_fingerprint
from ipmclab.rig.files.rig_file import load_rig, rig_from_text
from ipmclab.rig.files.text import rig_to_text
from tests.rig.chambers.benches_of_chambers import KINDS, WANTED, Quick, paired
from tests.rig.chambers.devices import EspecDevice
from tests.rig.chambers.wire import at_socket

CHAMBER = """
[chamber]
driver = "espec-p300"
address = "127.0.0.1:{port}"
temperature = ["0 degC", "60 degC"]
relative_humidity = ["20 percent", "95 percent"]
patience = "0.3 s"
"""


def test_a_check_leaves_the_chamber_as_it_is(tmp_path: Path) -> None:
    with paired(KINDS[0], tmp_path) as pair:
        pair.chamber.set(*WANTED)
        read, findings = chamber_findings(pair.chamber, 25.5, 58.0)
        assert read is not None
        assert (read.mode, findings, pair.room.mode) == ("constant", (), "CONSTANT")
        pair.room.alarms = [7]
        pair.room.mode = "RUN"
        _, findings = chamber_findings(pair.chamber, 40.0, 45.0)
        assert [one.code for one in findings] == ["chamber-alarm", "chamber-in-use", "chamber-differs"]
        assert all(one.repair for one in findings)
    read, (finding,) = chamber_findings(pair.chamber, None, None)
    assert (read, finding.code, finding.severity) == (None, "chamber-unreachable", "error")


def test_a_proof_brings_the_chamber_to_standby(tmp_path: Path, quick: Quick) -> None:
    with paired(KINDS[0], tmp_path) as pair:
        pair.chamber.set(*WANTED)
        assert [one.status for one in chamber_items(pair.chamber)] == ["passed", "passed"]
        assert pair.room.mode == "STANDBY"
        pair.room.mode = "RUN"
        assert [one.status for one in chamber_items(pair.chamber)] == ["passed", "not done"]
        pair.room.mode, pair.room.deaf = "CONSTANT", True
        with quick():
            assert [one.status for one in chamber_items(pair.chamber)] == ["passed", "failed"]
    (item,) = chamber_items(pair.chamber)
    assert (item.status, item.name) == ("failed", "chamber")


def test_the_command_says_whether_the_chamber_answers(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    with at_socket(EspecDevice()) as emulator:
        rig.write_text(rig_to_text(THESIS_RIG) + CHAMBER.format(port=emulator.port), encoding="utf-8")
        told = CliRunner().invoke(app, ["rig", "check", str(rig)])
        assert told.exit_code == 0
        assert "chamber (espec-p300): 22.0 degC, 45.0 %RH, standby" in told.output
    told = CliRunner().invoke(app, ["rig", "check", str(rig), "--json", "--fail-on", "error"])
    document = json.loads(told.stdout)
    assert (told.exit_code, document["chamber"]) == (1, None)
    assert "chamber-unreachable" in [one["code"] for one in document["findings"]]
    assert load_rig(rig).chamber is not None


def test_a_proof_is_of_this_kind_of_chamber_and_not_of_its_address() -> None:
    def fingerprint(text: str) -> str:
        return rig_fingerprint(rig_from_text(rig_to_text(THESIS_RIG) + text))

    one = CHAMBER.format(port=1)
    assert fingerprint(one) == fingerprint(CHAMBER.format(port=2))
    assert fingerprint(one) != fingerprint(one.replace("60 degC", "70 degC"))
    assert fingerprint(one) != fingerprint("")
    assert rig_fingerprint(replace(THESIS_RIG, chamber=None)) == fingerprint("")
