"""Systems that are smaller or simpler: only what some outputs see, and the small signal about rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import System
from ipmclab.model.blocks import Law


def seen_states(systems: Sequence[System], outputs: Sequence[int]) -> npt.NDArray[np.int64]:
    """The states that some outputs or any law can see, directly or through other states.

    Parameters
    ----------
    systems : sequence of System
        Systems with the same states, each of one or of many parameter sets. A path counts where one of them has it: a
        derivative may have a path that the system itself has not, as by the amplitude of a part that is switched off.
    outputs : sequence of int
        Places of the outputs.

    Returns
    -------
    states : int array
        Ascending.
    """
    n = len(systems[0].states)
    inner = np.zeros((n, n), dtype=bool)
    seen = np.zeros(n, dtype=bool)
    for system in systems:
        inner |= np.any(system.a.reshape(-1, n, n) != 0, axis=0)
        seen |= np.any(system.c[..., list(outputs), :].reshape(-1, n) != 0, axis=0)
        if system.law_ports is not None:
            seen |= np.any(system.law_ports.c.reshape(-1, n) != 0, axis=0)
    while True:
        wider = seen | np.any(inner[seen], axis=0)
        if np.array_equal(wider, seen):
            return np.flatnonzero(seen)
        seen = wider


def reduced(system: System, outputs: Sequence[int], states: npt.NDArray[np.int64]) -> System:
    """The system, or many, with some outputs, and with states that are all they see (``seen_states``)."""
    rows = np.array(outputs, dtype=np.int64)
    ports = system.law_ports
    return System(
        states=tuple(system.states[i] for i in states),
        inputs=system.inputs,
        outputs=tuple(system.outputs[i] for i in rows),
        a=system.a[..., states[:, None], states],
        b=system.b[..., states, :],
        c=system.c[..., rows[:, None], states],
        d=system.d[..., rows, :],
        law_ports=None
        if ports is None
        else replace(ports, drive=ports.drive[..., states, :], reach=ports.reach[..., rows, :], c=ports.c[..., states]),
    )


def small_signal(system: System) -> System:
    """The linear system for small voltages about 0 V: each law is replaced by its slope there.

    A leak with a threshold above 0 V is then not there at all.
    """
    ports = system.law_ports
    if ports is None:
        return system
    slopes = np.diag([_slope_at_rest(law) for law in ports.laws])
    # w = slopes p with p = c x + d v + loop w
    answer = np.linalg.solve(np.eye(len(slopes)) - slopes @ ports.loop, slopes)
    return System(
        states=system.states,
        inputs=system.inputs,
        outputs=system.outputs,
        a=system.a + ports.drive @ answer @ ports.c,
        b=system.b + ports.drive @ answer @ ports.d,
        c=system.c + ports.reach @ answer @ ports.c,
        d=system.d + ports.reach @ answer @ ports.d,
    )


def _slope_at_rest(law: Law) -> complex:
    from ipmclab.model.stages.leak import FORMS

    first, second, third = law.coefficients
    if FORMS[law.form] == "cubic":
        return first
    return first / third if second == 0 else 0.0
