"""``ipmclab identify``: what it tells of the runs that it was given."""

from __future__ import annotations

from pathlib import Path

import ipmclab
from tests.cli.conftest import Command


def test_a_voltage_beyond_what_the_model_holds_for_is_told(command: Command, tmp_path: Path) -> None:
    run = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 2 V", duration=10.0, rate=25.0)
    ipmclab.write_run(run, tmp_path / "step.nc")
    outcome = command("identify", "friend-2", "step.nc", "--free", "electrical", "--out", "fitted.toml")
    assert outcome.status == 0, outcome.err
    said = " ".join(outcome.out.split())
    assert said.count("step 2 V: the voltage reaches 2 V, water decomposes above 1.23 V") == 1
    codes = [finding.code for finding in ipmclab.read_fit(tmp_path / "fitted.toml").findings]
    assert codes.count("above-electrolysis") == 1
