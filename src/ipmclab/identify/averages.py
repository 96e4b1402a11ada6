"""Parameters of which one value stands for mountings that differ."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from ipmclab.identify.many_runs.mountings import differ

if TYPE_CHECKING:
    from ipmclab.identify.fit import Fit

AVERAGED: Final = "average of mountings that differ: its interval holds for none of them"


def averages(fit: Fit) -> frozenset[str]:
    """The shared parameters of a fit in which its mountings differ by more than their errors."""
    if fit.mountings is None:
        return frozenset()
    return frozenset(differ(fit.mountings.each, fit.actuator)) & set(fit.parameters)
