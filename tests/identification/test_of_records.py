"""What a fit says of a current that rises: by whether its model has a leak that grows, and whether that shows."""

from __future__ import annotations

from typing import Literal

import pytest

from ipmclab import load_actuator, simulate
from ipmclab.fit.in_brief import in_brief
from ipmclab.identification.of_records import findings_of_records
from ipmclab.identification.problem.record import prepare
from ipmclab.run import Finding

RISES = Finding("current-rises", "warning", "the current rises", "try a leak that grows", channel="current")


@pytest.mark.parametrize(
    ("leak", "brief", "repair"),
    [
        ("none", "which only a leak that grows (leak.slow) can follow", RISES.repair),
        ("hidden", "the growing leak of this model is not visible", "record longer at this voltage"),
        ("shown", None, None),
    ],
)
def test_nobody_is_told_to_try_what_was_tried(
    leak: Literal["none", "hidden", "shown"], brief: str | None, repair: str | None
) -> None:
    record = prepare(simulate(load_actuator("friend-2"), "step 1 V", duration=2.0, rate=20.0), 0, ["current"], ())
    found = findings_of_records([record], [[RISES]], leak)
    if brief is None or repair is None:
        assert found == ()
        return
    (one,) = found
    assert one.message.startswith(f"{record.label}: the current rises")
    assert one.repair.startswith(repair)
    ((line,), _) = in_brief([one], ["current"])
    assert brief in line.text
