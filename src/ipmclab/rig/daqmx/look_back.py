"""What the output of a chassis gives, read through the inputs that are wired to it."""

from __future__ import annotations

import time
from typing import Final

from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import Rig
from ipmclab.rig.daqmx.driver import Driver
from ipmclab.rig.daqmx.tasks import OnDemand
from ipmclab.rig.safety.readback import TOLERANCE, at_output, channels_at_output

SETTLED: Final = 0.1
"""Time [s] after which a reading of 0 V shows the output, not what came before."""


def read_output(driver: Driver) -> float:
    """What the output gives [V]; where it is not at 0 V, what it gives once it had the time to settle.

    Raises
    ------
    BenchError
        ``"output-unread"`` where no channel of the rig reads it; else what went wrong with reading.
    """
    names = channels_at_output(driver.rig)
    if not names:
        raise BenchError(
            "no channels of this rig show what the output gives",
            code="output-unread",
            where="output",
            repair="wire the channel voltage (and current, where a resistance lies between it and the output)",
        )
    demand = OnDemand(driver, names)
    try:
        volts = settled(driver.rig, demand)
    finally:
        demand.release_inputs()
    assert volts is not None
    return volts


def settled(rig: Rig, demand: OnDemand) -> float | None:
    """What the output gives [V], read once more where it may still be on its way to 0 V; None when it is not read."""
    volts = at_output(rig, demand.read())
    if volts is not None and abs(volts) > TOLERANCE:
        time.sleep(SETTLED)
        volts = at_output(rig, demand.read())
    return volts
