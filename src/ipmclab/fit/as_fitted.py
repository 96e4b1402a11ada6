"""Whether an actuator still is the one that its fit found."""

from __future__ import annotations

import math
from typing import Final

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.fit.rows import listed

_SAME: Final = 1e-9
"""Values that went through a file in another unit differ by less."""


def why_changed(fit: Fit) -> str:
    """What of the actuator of a fit is no longer what the fit found or held; empty where all is.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> fit = identify(strip, simulate(strip, "step 1 V", duration=20, rate=50), free="circuit.dc_resistivity")
    >>> wider = {**fit.actuator.parameter_values, "geometry.width": 6e-3}
    >>> why_changed(fit), why_changed(replace(fit, actuator=replace(fit.actuator, parameter_values=wider)))
    ('', 'geometry.width is no longer what it was when its fit was made')
    """
    values = fit.actuator.parameter_values
    known = (fit.actuator.fit_table or {}).get("values")
    expected = {name: one.value for name, one in fit.parameters.items() if name in values}
    if isinstance(known, dict):
        if known.keys() != values.keys():
            return "the actuator has other stages than when its fit was made"
        expected |= known
    moved = [name for name, value in expected.items() if not is_same(values[name], value)]
    stated = fit.actuator.standard_uncertainties
    held = {name: math.sqrt(max(row[name], 0.0)) for name, row in fit.covariance.items() if name not in fit.parameters}
    own = {name.partition("[")[0] for name in fit.parameters}
    held |= dict.fromkeys(stated.keys() - held.keys() - own, 0.0)
    changed_names = sorted(name for name, one in held.items() if not is_same(stated.get(name, 0.0), one))
    moved += [f"the stated uncertainty of {name}" for name in changed_names]
    verb = "is no longer what it was" if len(moved) == 1 else "are no longer what they were"
    return f"{listed(moved)} {verb} when its fit was made" if moved else ""


def need_as_fitted(fit: Fit) -> None:
    """Refuse a fit whose actuator is no longer the one that it found.

    Raises
    ------
    InputError
    """
    if why := why_changed(fit):
        raise InputError(
            f"{why}: its uncertainty does not hold for this actuator",
            code="changed-since-fit",
            where="fit",
            repair="identify again with these values, or take the file as identify wrote it",
        )


def is_same(one: float, other: object) -> bool:
    """Whether a value is still the one that a fit's table has, which anybody may have edited."""
    return isinstance(other, int | float) and math.isclose(one, other, rel_tol=_SAME)
