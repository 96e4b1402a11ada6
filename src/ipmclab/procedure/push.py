"""Step 5: Young's modulus from a force-displacement push (Friend, eq. 4.11)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.measurement.push import CALIBRATION, Push, stiffness
from ipmclab.measurement.uncertain import Uncertain, derived
from ipmclab.measurement.written import REPAIR
from ipmclab.procedure.step import Result, Step, advice_for, assumed_finding
from ipmclab.run import Finding
from ipmclab.units import MODULUS, STIFFNESS

NAME: Final = "beam.modulus"

_FAR: Final = 0.2  # of the length: beyond it the beam equation no longer holds


def modulus(push: Push, position: Uncertain, known: Mapping[str, Uncertain]) -> Step:
    """Y = 4 L_s^3/(w h^3) f/delta, with the slope of a regression (Friend, eq. 4.11).

    Parameters
    ----------
    push : Push
    position : Uncertain [m]
        From the edge of the clamp to where the load cell pushes.
    known : mapping of dotted name to Uncertain
        The dimensions.

    Raises
    ------
    InputError
        Too few readings, no travel, a force that does not rise, or one that is no larger than its uncertainty.
    """
    slip = push.slip()
    try:
        slope, findings = stiffness(push)
    except InputError as error:
        if slip is None or error.code != "out-of-range":
            raise
        raise InputError(f"{error.message}; {slip[1]}", code=error.code, where=slip[0], repair=REPAIR) from error
    if slope.value <= 2.0 * slope.uncertainty:
        raise _no_modulus(slope, slip)
    if slip is not None:
        share = sum(slope.shares.get(source, 0.0) for source in slope.shares if source != CALIBRATION)
        text = f"{slip[0]}: {slip[1]}: {100.0 * share:.0f} % of the variance of the slope is how far readings lie off"
        findings = (*findings, Finding("reading-apart", "warning", text, REPAIR))
    far = float(np.ptp(push.displacement)) / position.value
    if far > _FAR:
        findings = (
            *findings,
            Finding(
                "push-too-far",
                "warning",
                f"the push goes over {far:.2f} of the length: eq. 4.11 holds for small bending, up to {_FAR:g}",
                "push less far",
            ),
        )
    found = derived(
        lambda k, at, w, h: 4.0 * at**3 * k / (w * h**3),
        slope,
        position,
        known["geometry.width"],
        known["geometry.thickness"],
    )
    return Step(
        "modulus",
        "modulus from a push",
        "Y = 4 L_s³/(w h³) f/δ (Friend, eq. 4.11), f/δ by regression",
        {NAME: Result(found, MODULUS, "Y")},
        {"f/δ": Result(slope, STIFFNESS, "k")},
        (*findings, *assumed_finding([found])),
        advice_for(found),
    )


def _no_modulus(slope: Uncertain, slip: tuple[str, str] | None) -> InputError:
    """Why the slope of a push is no larger than its uncertainty: one reading, or what else is not known."""
    source, share = next(iter(slope.shares.items()))
    text = f"the slope, {slope.said('N/m')}, is not known: {100.0 * share:.0f} % of its variance is the {source}"
    if slip is not None:
        return InputError(f"{text}: {slip[1]}", code="no-modulus", where=slip[0], repair=REPAIR)
    return InputError(
        text,
        code="no-modulus",
        where="modulus",
        repair="push farther and read more often, let the force settle at each position; is every unit right?",
    )
