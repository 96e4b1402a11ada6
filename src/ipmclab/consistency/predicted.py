"""What the model says to a fact, read as the fact was."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ipmclab.consistency.facts import READ_BY, Fact
from ipmclab.model import Actuator, simulate
from ipmclab.run import FloatArray

_PERIODS = 4
_ROWS_OF_A_PERIOD = 500


def predicted(actuator: Actuator, fact: Fact) -> float:
    """Largest displacement [m] or force [N] of a step up to the time at which it was read; the amplitude of a wave.

    Parameters
    ----------
    actuator : Actuator
    fact : Fact
        With metric ``max_displacement`` or ``max_force`` under a step, a sine or a square.
    """
    channel = fact.metric.removeprefix("max_")
    if fact.frequency is None:
        duration = max(fact.time or READ_BY, 0.1)
        return float(np.max(np.abs(_response(actuator, fact.signal, duration, 50.0, channel))))
    duration = fact.time or _PERIODS / fact.frequency
    values = _response(actuator, fact.signal, duration, _ROWS_OF_A_PERIOD * fact.frequency, channel)
    return float(np.ptp(values[-_ROWS_OF_A_PERIOD:]) / 2.0)


@lru_cache(maxsize=32)
def _response(actuator: Actuator, signal: str, duration: float, rate: float, channel: str) -> FloatArray:
    # At least two rows: a step whose peak is at once.
    run = simulate(actuator, signal, duration=max(duration, 2.0 / rate), rate=rate)
    return run.channels[channel]
