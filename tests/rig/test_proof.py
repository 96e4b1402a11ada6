"""What a run says of the hardware it was recorded on follows from the report beside the rig file alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ipmclab import InputError
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.checks.proof import Item, Proof, proof_of, proof_path, read_proof, rig_fingerprint, write_proof

RIG = replace(THESIS_RIG, bench="ni", address="127.0.0.1:1")
ITEMS = (
    Item("stop", "the output after a stop", "passed", "0.1 mV"),
    Item("unplugged", "the output without its cable", "noted", "holds 0.5 V"),
)
PROOF = Proof("bench 1", rig_fingerprint(RIG), "2026-11-21T12:00:00+01:00", "chassis", False, "NN", ITEMS, "0.1")


def said(folder: Path, proof: Proof, rig: object = RIG) -> str:
    write_proof(proof, proof_path(folder / "rig.toml"))
    return proof_of(rig, folder / "rig.toml")  # type: ignore[arg-type]


def test_a_report_is_written_and_read_again(tmp_path: Path) -> None:
    path = proof_path(tmp_path / "rig.toml")
    assert path == tmp_path / "rig.proof.toml"
    for _ in range(2):
        write_proof(PROOF, path)
        assert read_proof(path) == PROOF
    assert PROOF.passed


def test_only_a_proof_of_this_hardware_proves_it(tmp_path: Path) -> None:
    assert proof_of(THESIS_RIG, "thesis") == "virtual bench: no hardware to prove"
    assert proof_of(RIG, tmp_path / "rig.toml").startswith("not proven on this hardware: ipmclab rig prove has not")
    assert said(tmp_path, PROOF).startswith("proved on 2026-11-21 (rig.proof.toml, sha256 ")
    moved = replace(RIG, address="127.0.0.1:2", virtual=replace(RIG.virtual, seed=1))
    assert said(tmp_path, PROOF, moved).startswith("proved on")
    recalibrated = replace(RIG, channels=tuple(replace(one, calibrated="2026-11-01") for one in RIG.channels))
    assert said(tmp_path, PROOF, recalibrated).startswith("proved on")
    for other in (replace(RIG, shunt_resistance=2.0), replace(RIG, channels=RIG.channels[:2])):
        assert said(tmp_path, PROOF, other).startswith("not proven on this hardware: the rig file changed after its")
    assert "proved against a stand-in on 2026-11-21" in said(tmp_path, replace(PROOF, simulated=True))
    failed = replace(PROOF, items=(*ITEMS, Item("kill", "k", "failed", "3 V"), Item("hang", "h", "not done", "")))
    assert said(tmp_path, failed) == (
        "not proven on this hardware: on 2026-11-21 it did not pass kill, hang (rig.proof.toml)"
    )
    assert not replace(PROOF, items=()).passed


@pytest.mark.parametrize("text", ["", "x = [", 'items = [{name = "a"}]', "items = 3\ndate = 4"])
def test_a_file_that_is_no_report_proves_nothing(tmp_path: Path, text: str) -> None:
    proof_path(tmp_path / "rig.toml").write_text(text, "utf-8")
    assert "rig.proof.toml: this is no report of rig prove" in proof_of(RIG, tmp_path / "rig.toml")
    with pytest.raises(InputError, match="run rig prove again"):
        read_proof(tmp_path / "rig.proof.toml")
