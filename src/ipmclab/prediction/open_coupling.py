"""What a fit left open that a predicted displacement or force rests on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.fit import DETERMINED
from ipmclab.model import Actuator
from ipmclab.model.declared import MOTION, in_group
from ipmclab.model.quantities import AT_REST
from ipmclab.model.stages.coupling import STATIC
from ipmclab.run import Finding

NOT_IDENTIFIED: Final = "coupling-not-identified"

_LARGE: Final = 0.01  # part of a direction of unit length (convention)


def open_coupling(actuator: Actuator) -> list[Finding]:
    """Whether the fit that an actuator carries never asked for the coupling, or left its size open."""
    if actuator.fit_table is None:
        return []
    names = [str(one.get("name", "")) for one in _entries(actuator, "parameters")]
    if not in_group(MOTION, names):
        return [
            Finding(
                NOT_IDENTIFIED,
                "warning",
                f"the fit of {actuator.name} did not identify the coupling: displacement and force are predicted with "
                "the values that it was given",
                repair="identify it too, from runs with displacement or force: --free electrical,coupling",
            )
        ]
    if any(one.get("name") == AT_REST for one in _entries(actuator, "known")):
        return []  # though its parts may be open
    for one in _entries(actuator, "undetermined"):
        # Gain against zero with d(0) = K_d Z_d/P_2d standing still does not show below the Nyquist rate.
        if abs(_along(one)) > _LARGE:
            return [_open(actuator, str(one.get("sentence", "")))]
    error = _error(actuator)
    if error > DETERMINED:
        return [_open(actuator, f"it is known to a factor of {math.exp(min(NORMAL_95 * error, 50.0)):.2g} only")]
    return []


def unidentified(actuator: Actuator, output: str) -> bool:
    """Whether the fit that an actuator carries says nothing of an output: no run had it, and no coupling was free.

    Parameters
    ----------
    actuator : Actuator
    output : str

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> fit = identify(strip, simulate(strip, "step 1 V", duration=20.0, rate=50.0), free="electrical")
    >>> [unidentified(one, "force") for one in (strip, fit.actuator)]
    [False, True]
    """
    if output == "current" or all(one.code != NOT_IDENTIFIED for one in open_coupling(actuator)):
        return False
    return not any(output in _mapping(run.get("noise")) for run in _entries(actuator, "runs"))


def _open(actuator: Actuator, why: str) -> Finding:
    return Finding(
        "coupling-undetermined",
        "warning",
        f"the fit of {actuator.name} leaves d(0), the size of displacement and force, open: {why}",
        repair="take these scores as those of one of many models that fit alike",
    )


def _along(direction: Mapping[str, Any]) -> float:
    """By how much d(0) moves along a direction about which a fit knows nothing; 0 where the table does not say.

    A fit knows d(0) together with a direction of which it knows something: its covariance shows how well.
    """
    try:
        open_end = float(direction.get("error", math.inf)) == math.inf
        parts = direction["coefficients"]
        return sum(sign * float(parts.get(name, 0.0)) for name, sign in STATIC.items()) if open_end else 0.0
    except (KeyError, AttributeError, TypeError, ValueError):
        return 0.0  # written by hand


def _error(actuator: Actuator) -> float:
    """Standard error of log d(0) by the covariance of the fit; 0 where the table does not say."""
    table = (actuator.fit_table or {}).get("covariance", {})
    try:
        names = [str(name) for name in table["names"]]
        rows = [[float(value) for value in row] for row in table["rows"]]
        known = {name: names.index(name) for name in STATIC if name in names}
        variance = sum(
            STATIC[one] * STATIC[other] * rows[known[one]][known[other]] / (actuator[one] * actuator[other])
            for one in known
            for other in known
        )
    except (KeyError, TypeError, ValueError, IndexError, ZeroDivisionError):
        return 0.0  # written by hand
    return math.sqrt(max(variance, 0.0))


def _entries(actuator: Actuator, key: str) -> list[Mapping[str, Any]]:
    """The tables of an array in the fit table, which may have been written by hand."""
    found = (actuator.fit_table or {}).get(key, ())
    return [_mapping(one) for one in found] if isinstance(found, Sequence) else []


def _mapping(found: Any) -> Mapping[str, Any]:
    return found if isinstance(found, Mapping) else {}
