"""A recorder that is killed leaves no chamber at its set points, whatever it was doing."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from ipmclab.cli.record import RECORDER
from ipmclab.rig.chambers.settings import ChamberSettings
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.files.text import write_rig
from ipmclab.rig.process.client import launch
from tests.rig.chambers.devices import EspecDevice
from tests.rig.chambers.wire import at_socket
from tests.waiting import HANGS, until

EXPERIMENT = """
sample = "friend-2"
rig = "rig.toml"
signal = "step 1 V"
rate = "50 Hz"
duration = "2 s"
measured = ["current"]
steps = ["chamber-on", "equilibrium", "apply"]
environment = { temperature = "25 degC", relative_humidity = "60 percent", settle = "1 h" }
"""


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM"])
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="Windows has no such signals")
def test_the_chamber_stands_by_when_the_recorder_is_gone(tmp_path: Path, name: str) -> None:
    device = EspecDevice()
    with at_socket(device) as emulator:
        chamber = ChamberSettings("espec-p300", (0.0, 60.0), (5.0, 95.0), address=f"127.0.0.1:{emulator.port}")
        # The virtual bench has no sensors in an emulated chamber: the chamber's own decide.
        rig = replace(THESIS_RIG, channels=THESIS_RIG.channels[:-1], thermometer=None, chamber=chamber)
        write_rig(rig, tmp_path / "rig.toml")
        (tmp_path / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
        recorder = launch(
            RECORDER,
            {"experiment": str(tmp_path / "experiment.toml"), "answers": {}, "yes": True, "interactive": False},
        )
        recorder.request("start")
        until(lambda: device.room.mode == "CONSTANT")
        assert device.room.regulated == [(25.0, 60.0)]
        told = recorder.next(HANGS)
        while told is not None and told.kind != "equilibrium":
            told = recorder.next(HANGS)
        assert told is not None
        process = json.loads(recorder.file.read_text(encoding="utf-8"))["process"]
        os.kill(process, getattr(signal, name))
        until(lambda: device.room.mode == "STANDBY")
        recorder.close()
        log = tmp_path / "runs" / "guardian.log"
        if name == "SIGKILL":
            until(lambda: log.is_file() and "chamber: it is in standby" in log.read_text(encoding="utf-8"))
        assert device.room.regulated == [(25.0, 60.0)]
