"""What must be said beside a fitted number, wherever it stands in a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from ipmclab.identify.many_runs.mountings import differ, dragged

if TYPE_CHECKING:
    from ipmclab.identify.fit import Fit

AVERAGED: Final = "average of mountings that differ: its interval holds for none of them"
"""Said beside a shared parameter that is not the same in every mounting."""

_NOT_DESCRIBED: Final = "its interval may be too small: the noise is not described"


def remarks(fit: Fit) -> dict[str, str]:
    """The remark beside each parameter; empty where its number says all."""
    averaged = averages(fit)
    described = not any(finding.code == "noise-not-described" for finding in fit.findings)
    found = {}
    for name, one in fit.parameters.items():
        found[name] = "at its bound" if one.at_bound else "with its prior" if one.prior else ""
        found[name] = found[name] or (AVERAGED if name in averaged else "")
        found[name] = found[name] or ("" if described or not one.determined else _NOT_DESCRIBED)
    return found


def averages(fit: Fit) -> frozenset[str]:
    """The shared parameters of a fit in which its mountings differ by more than their errors.

    One value for what differs is wrong in every run, and others give way to it: what the fit of all runs puts
    elsewhere than the mean of the mountings by themselves is no better.
    """
    if fit.mountings is None:
        return frozenset()
    apart = differ(fit.mountings.each, fit.actuator)
    return frozenset({*apart, *dragged(fit, fit.mountings.each)} if apart else ()) & set(fit.parameters)
