"""Waiting for the chassis: the lock is given away meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from virtual_cdaq.model.clock import LockStepClock, ticks

if TYPE_CHECKING:
    from virtual_cdaq.model.chassis import Chassis

LONGEST_SLEEP = 0.25  # s; a waiting call looks this often whether its caller is still there


class Gone(Exception):
    """The caller of a waiting call has gone away, or the server closes."""


def gate(chassis: Chassis) -> None:
    """Hold the caller while the chassis is frozen."""
    while chassis.faults.frozen and not chassis.closing:
        _sleep(chassis, LONGEST_SLEEP)
        chassis.faults.thaw()
    if chassis.closing:
        raise Gone


def _sleep(chassis: Chassis, duration: float) -> None:
    chassis.changed.wait(max(duration, 0.0))
    alive: Callable[[], bool] | None = getattr(chassis.caller, "alive", None)
    if chassis.closing or (alive is not None and not alive()):
        raise Gone


def wait(chassis: Chassis, ready: Callable[[], bool], due: Callable[[], int | None], timeout: float) -> bool:
    """Wait until `ready()`; the lock is given away meanwhile.

    Parameters
    ----------
    ready : callable
        Looked at after every catching up with the clock.
    due : callable
        When it may become ready [ticks]; None if that is not known.
    timeout : float [s]
        Negative for no end. On the wall; on a clock that does not move, in its own time.

    Returns
    -------
    bool
        False when the time-out came first.
    """
    begin = time.monotonic()
    limit = chassis.clock.now() + ticks(timeout) if timeout >= 0 else None
    while True:
        chassis.advance()
        gate(chassis)
        if ready():
            return True
        tick = due()
        if isinstance(chassis.clock, LockStepClock):
            if tick is not None:
                if limit is not None and tick > limit:
                    chassis.clock.step_to(limit)
                    chassis.advance()
                    return ready()
                chassis.clock.step_to(max(tick, chassis.clock.now() + 1))
                continue
            until_due = LONGEST_SLEEP
        else:
            until_due = LONGEST_SLEEP if tick is None else chassis.clock.wall(tick - chassis.clock.now())
        left = LONGEST_SLEEP if timeout < 0 else begin + timeout - time.monotonic()
        if left <= 0.0:
            return False
        _sleep(chassis, min(until_due, left, LONGEST_SLEEP))
