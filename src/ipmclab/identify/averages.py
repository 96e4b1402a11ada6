"""Parameters of which one value stands for mountings that differ."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from ipmclab.identify.many_runs.mountings import differ, dragged

if TYPE_CHECKING:
    from ipmclab.identify.fit import Fit

AVERAGED: Final = "average of mountings that differ: its interval holds for none of them"


def averages(fit: Fit) -> frozenset[str]:
    """The shared parameters of a fit in which its mountings differ by more than their errors.

    One value for what differs is wrong in every run, and others give way to it: what the fit of all runs puts
    elsewhere than the mean of the mountings by themselves is no better.
    """
    if fit.mountings is None:
        return frozenset()
    apart = differ(fit.mountings.each, fit.actuator)
    return frozenset({*apart, *dragged(fit, fit.mountings.each)} if apart else ()) & set(fit.parameters)
