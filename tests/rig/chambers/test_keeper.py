"""Who lets a chamber stand by when the recorder is gone."""

from __future__ import annotations

from pathlib import Path

import pytest

from ipmclab.rig.chambers.chamber import Chamber, ChamberError
from ipmclab.rig.chambers.keeper import Keeper
from ipmclab.rig.chambers.keeper_process import watch
from ipmclab.rig.chambers.settings import ChamberSettings
from ipmclab.rig.chambers.virtual import VirtualChamber


@pytest.mark.parametrize(
    ("words", "acts"), [([], False), (["hold"], True), (["hold", "safe"], False), (["hold", "safe", "hold"], True)]
)
def test_it_acts_where_the_chamber_regulated_last(words: list[str], acts: bool) -> None:
    chamber = VirtualChamber()
    chamber.set(40.0, 50.0)
    assert watch(words, lambda: chamber, lambda _: None) == 0
    assert (chamber.read().mode == "standby") is acts


def test_it_tries_until_the_chamber_hears_it() -> None:
    chamber, told = VirtualChamber(), list[str]()
    chamber.set(40.0, 50.0)
    attempts = iter([True, True, False])

    def reach() -> Chamber:
        if next(attempts):
            raise ChamberError("its port is in use", code="chamber-in-use", where="chamber")
        return chamber

    assert watch(["hold"], reach, told.append, pause=0.0) == 0
    assert chamber.read().mode == "standby"
    assert len([text for text in told if "could not be asked for" in text]) == 2


def test_no_failure_of_any_kind_ends_it() -> None:
    chamber, told = VirtualChamber(), list[str]()
    chamber.set(40.0, 50.0)
    failures = iter([OSError("no such port"), ValueError("nonsense")])

    def reach() -> Chamber:
        for failure in failures:
            raise failure
        return chamber

    assert watch(["hold"], reach, told.append, pause=0.0) == 0
    assert chamber.read().mode == "standby"
    assert any("OSError: no such port" in text for text in told)


def test_its_process_outlives_the_pipe_and_says_in_the_log_what_it_did(tmp_path: Path) -> None:
    log = tmp_path / "guardian.log"
    keeper = Keeper(ChamberSettings("virtual"), log)
    keeper.hold(True)
    keeper.close()
    keeper.close()
    assert "chamber: it is in standby" in log.read_text(encoding="utf-8")
    with pytest.raises(ChamberError, match="its keeper is gone"):
        keeper.hold(True)
    keeper.hold(False)
