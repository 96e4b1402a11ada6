"""On which fixed values a fit leans, and how hard."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final

import numpy as np

from ipmclab.fit.fit import FittedParameter
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.uncertainty.covariance import Uncertainty
from ipmclab.identification.uncertainty.interval import half_width
from ipmclab.model.declared import MOTION, in_group
from ipmclab.model.order import Order
from ipmclab.run import Finding, Severity
from ipmclab.ties import largest_first

_REPORTED: Final = 1e-3  # of a parameter, for 1 % of a fixed value: what is less is not reported
_AMPLIFIED: Final = 0.05  # likewise: a warning whatever the fixed value is
_NAMED: Final = 3  # parameters that a sentence names


def leaning_findings(
    found: Uncertainty,
    fitted: Mapping[str, FittedParameter],
    stated: Collection[str],
    exact: Sequence[str],
    asked: Sequence[Unknown],
    order: Order,
) -> list[Finding]:
    """``fixed-uncertainty`` and ``exact-fixed-value``: what 1 % of each fixed value does to the parameters.

    Of a value of 0 it is what one standard uncertainty of it does.

    The second is a warning where 1 % moves a parameter beyond its interval, and either the value is one of the
    coupling, which no handbook gives and which differs from strip to strip by far more, or it moves it five times as
    far. The hardest stand first.

    Parameters
    ----------
    found : Uncertainty
    fitted : mapping of name to FittedParameter
    stated : collection of str
        Fixed values with an uncertainty.
    exact : sequence of str
        Fixed values without one.
    asked : sequence of Unknown
        In the order of ``found``.
    order : Order
    """
    own = [fitted[order(unknown.name)] for unknown in asked]
    finite = np.array([math.isfinite(one.standard_error) for one in own], dtype=bool)
    # What moves a parameter that the readings leave open says nothing of it.
    known = np.array([one.determined for one in own], dtype=bool)
    half = np.array([half_width(unknown, one.interval) for unknown, one in zip(asked, own, strict=True)])
    sized: list[tuple[float, Finding]] = []
    for name in (*stated, *exact):
        moved = np.where(finite if name in stated else known, np.abs(found.leverage[name]), 0.0)
        largest = float(moved.max(initial=0.0))
        if largest < (1e-9 if name in stated else _REPORTED):
            continue
        most = [k for k in largest_first(moved)[:_NAMED] if moved[k] >= min(_REPORTED, largest)]
        amount = "1 %" if name not in found.zero else "one standard uncertainty"
        leans = f"{amount} of {order(name)} moves "
        leans += ", ".join(f"{order(asked[k].name)} by {100.0 * moved[k]:.2g} %" for k in most)
        if name in stated:
            message = f"the stated uncertainty of {order(name)} is passed on to the errors: {leans}"
            sized.append((largest, Finding("fixed-uncertainty", "info", message, "", values={"leverage": largest})))
            continue
        beyond = finite & (moved > half) & (moved >= _REPORTED)
        if not in_group(MOTION, [name]):
            beyond &= moved > _AMPLIFIED
        message = f"{order(name)} is taken as exact, because no uncertainty is stated for it: {leans}"
        if beyond.any():
            message += ", farther than the 95 % interval reaches"
        severity: Severity = "warning" if beyond.any() else "info"
        repair = 'write it as { value = "...", standard_uncertainty = "..." } in the actuator\'s file'
        sized.append((largest, Finding("exact-fixed-value", severity, message, repair, values={"leverage": largest})))
    return [sized[k][1] for k in largest_first([size for size, _ in sized])]
