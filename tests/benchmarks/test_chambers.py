"""Whole experiments in real time, each with a fault of its chamber: a few of those that the benchmark draws."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.chambers import draw, report, run_faults
from tests.rig.chambers.benches_of_chambers import KINDS


def test_an_experiment_ends_well_whatever_its_chamber_does() -> None:
    drawn = draw(4)
    faults = [
        replace(drawn[0], kind=KINDS[0], what="another client", step="equilibrium", at=1.0),
        replace(drawn[1], kind=KINDS[-1], what="alarm", step="apply", at=2.0),
        replace(drawn[2], kind=KINDS[2], what="garbage", step="equilibrium", at=1.0, lasts=2),
        replace(drawn[3], kind=KINDS[1], what="locked", step="chamber-on", at=0.0),
    ]
    ended = run_faults(faults, at_once=4)
    assert [one.wrong for one in ended] == [[], [], [], []]
    assert [bool(one.reason) for one in ended] == [True, True, False, True]
    assert "* 0 faults of ours" in report(ended, 1.0)


def test_every_kind_of_chamber_meets_every_kind_of_fault() -> None:
    drawn = draw(200)
    assert draw(200) == drawn
    assert len({(one.kind.driver, one.kind.serial) for one in drawn}) == len(KINDS)
    assert len({one.what for one in drawn}) == 17
