"""What a fit left open that a predicted displacement or force rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from ipmclab.run import Finding

if TYPE_CHECKING:
    from ipmclab.model import Actuator

_LARGE: Final = 0.1  # part of a direction of unit length


def open_coupling(actuator: Actuator) -> list[Finding]:
    """Whether the fit that an actuator carries never asked for the coupling, or left its size open."""
    if actuator.fit_table is None:
        return []
    names = [str(one.get("name", "")) for one in _entries(actuator, "parameters")]
    if not any(name.startswith("coupling.") for name in names):
        return [
            Finding(
                "coupling-not-identified",
                "info",
                f"the fit in {actuator.name} did not identify the coupling: displacement and force are predicted with "
                "the values that it was given",
                repair="identify it too, from runs with displacement or force",
            )
        ]
    found = []
    for one in _entries(actuator, "undetermined"):
        coefficients = one.get("coefficients")
        if not isinstance(coefficients, Mapping):
            continue
        gain, zero, p2 = (float(coefficients.get(f"coupling.{name}", 0.0)) for name in ("gain", "zero", "p2"))
        # Gain against zero with d(0) = K_d Z_d/P_2d standing still does not show below the Nyquist rate.
        if abs(gain + zero - p2) > _LARGE:
            found.append(
                Finding(
                    "coupling-undetermined",
                    "warning",
                    f"the fit in {actuator.name} leaves d(0), the size of displacement and force, open: "
                    f"{one.get('sentence', '')}",
                    repair="take these scores as those of one of many models that fit alike",
                )
            )
    return found


def _entries(actuator: Actuator, key: str) -> list[Mapping[str, Any]]:
    """The tables of an array in the fit table, which may have been written by hand."""
    found = (actuator.fit_table or {}).get(key, ())
    return [one if isinstance(one, Mapping) else {} for one in found] if isinstance(found, Sequence) else []
