"""What must be said with a fitted number, wherever it is in a table."""

from __future__ import annotations

from typing import Final

from ipmclab.fit.fit import Fit
from ipmclab.fit.in_brief import NOT_DESCRIBED
from ipmclab.fit.rows import prior_in_words
from ipmclab.identification.mountings.mountings import differ, dragged

AVERAGED: Final = "average of mountings that differ: its interval holds for none of them"
"""Said with a shared parameter that is not the same in every mounting."""

_FROM_AVERAGE: Final = "from an average of mountings that differ: its band holds for none of them"
_FROM_ANOTHER: Final = "from another mounting, and mountings differ: its band does not hold for this one"

_NOT_DESCRIBED: Final = "its interval may be too small: the noise is not described"


def remarks(fit: Fit) -> dict[str, str]:
    """The remark with each parameter; empty where its number says all."""
    averaged = averages(fit)
    described = not any(finding.code == NOT_DESCRIBED for finding in fit.findings)
    found = {}
    for name, one in fit.parameters.items():
        found[name] = "at its bound" if one.at_bound else prior_in_words(one)
        found[name] = found[name] or (AVERAGED if name in averaged else "")
        found[name] = found[name] or ("" if described or not one.determined else _NOT_DESCRIBED)
    return found


def left_out_remarks(fit: Fit) -> tuple[str, ...]:
    """The remark with each run that was left out; empty where its prediction says all.

    Where mountings differ, what the other runs share is an average of them, or of a mounting that is not the run's.
    """
    mountings = [one.mounting for one in fit.observations]
    differing = bool(fit.left_out and averages(fit))
    found = []
    for place, one in enumerate(fit.left_out):
        several = len({*mountings[:place], *mountings[place + 1 :]} - {""}) > 1
        predicted = (_FROM_AVERAGE if several else _FROM_ANOTHER) if differing else ""
        found.append("; ".join(filter(None, (one.lacking, predicted))))
    return tuple(found)


def averages(fit: Fit) -> frozenset[str]:
    """The shared parameters of a fit in which its mountings differ by more than their errors.

    One value for what differs is wrong in every run, and others give way to it: what the fit of all runs puts
    elsewhere than the mean of the mountings by themselves is no better.
    """
    if fit.mountings is None:
        return frozenset()
    differing = differ(fit.mountings.each, fit.actuator)
    return frozenset({*differing, *dragged(fit, fit.mountings.each)} if differing else ()) & set(fit.parameters)
