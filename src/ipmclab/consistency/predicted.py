"""What the model says to a fact, read as the fact was."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ipmclab.consistency.fact import Fact
from ipmclab.consistency.facts import READ_BY
from ipmclab.model import Actuator, simulate

_PERIODS = 4  # after which the amplitude of a strip no longer changes (convention)
_ROWS_OF_A_PERIOD = 500  # a peak between rows is missed by 2e-5 of it: 1 - cos(pi/500) (derived)


def predicted(actuator: Actuator, fact: Fact) -> float:
    """Largest displacement [m] or force [N] of a step up to the time at which it was read; the amplitude of a wave.

    Parameters
    ----------
    actuator : Actuator
    fact : Fact
        With metric ``max_displacement`` or ``max_force`` under a step, a sine or a square.
    """
    return _size(actuator, fact.signal, fact.frequency, fact.time, fact.metric.removeprefix("max_"))


@lru_cache(maxsize=32)
def _size(actuator: Actuator, signal: str, frequency: float | None, time: float | None, channel: str) -> float:
    if frequency is None:
        run = simulate(actuator, signal, duration=max(time or READ_BY, 0.1), rate=50.0)
        return float(np.max(np.abs(run.channels[channel])))
    rate = _ROWS_OF_A_PERIOD * frequency
    run = simulate(actuator, signal, duration=max(time or _PERIODS / frequency, 2.0 / rate), rate=rate)
    return float(np.ptp(run.channels[channel][-_ROWS_OF_A_PERIOD:]) / 2.0)
