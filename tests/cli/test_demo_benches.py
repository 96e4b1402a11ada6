"""The demo's two benches: in-process, and NI's client with the stand-in chassis."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import load_actuator
from ipmclab.cli.demo import SEED, _bench
from ipmclab.rig.recording.recorder import record
from ipmclab.run import Run


@pytest.mark.parametrize("channel", ["force", "displacement"])
def test_they_record_the_same_strip(channel: str) -> None:
    strip = load_actuator("friend-2")
    runs: list[Run] = []
    for stand_in in (False, True):
        with _bench(strip, SEED, stand_in=stand_in) as (bench, rest):
            for _ in range(2):  # the second time the strip must have been at rest again
                rest()
                run = record(bench, "square 1 V 0.5 Hz", duration=4.0, rate=50.0, measured=("current", channel))
            runs.append(run)
    virtual, through_ni = runs
    assert through_ni.metadata.origin == "virtual bench"  # it says that it is simulated
    for name, noise in (
        ("voltage", 3e-4),
        ("current", 2e-5),
        (channel, {"force": 2e-4, "displacement": 2e-6}[channel]),
    ):
        one, other = getattr(virtual, name), getattr(through_ni, name)
        assert np.ptp(one) > 20 * noise or name == "force"
        # Zeros are means over noise of their own; the rest is the noise of a reading and the step of its converter.
        assert np.max(np.abs(one - other)) < 8.0 * noise, name
