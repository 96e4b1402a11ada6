"""Where a simulation leaves what the model holds for: said, never refused."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from ipmclab.units import LENGTH

if TYPE_CHECKING:
    from ipmclab.model import Actuator
    from ipmclab.run import Run

ELECTROLYSIS: Final = 1.23
"""Water decomposes above this voltage [V]."""

SMALL_BENDING: Final = 0.2
"""Displacement, as a part of the free length, up to which bending counts as small."""

RESONANCE: Final = 1.0 / 3.0
"""Part of the first resonance up to which one mode of the beam is enough."""

_FREQUENCIES: Final = ("frequency", "start_frequency", "end_frequency", "highest_frequency")


def remarks(actuator: Actuator, run: Run) -> list[str]:
    """What to think of a predicted run, a sentence each.

    Parameters
    ----------
    actuator : Actuator
    run : Run
        Simulated with it.

    Returns
    -------
    sentences : list of str
        Empty where the model holds.
    """
    from ipmclab.model.beam import natural_frequency

    told = []
    largest = float(abs(run.voltage).max())
    if largest > ELECTROLYSIS:
        told.append(
            f"the voltage reaches {largest:.4g} V, water decomposes above {ELECTROLYSIS:g} V: the linear model has no "
            "leak, so a strip with water in it draws more current and moves otherwise; stay below, unless the "
            "strip holds no water"
        )
    length = actuator["geometry.free_length"]
    if run.displacement is not None:
        bending = float(abs(run.displacement).max())
        if bending > SMALL_BENDING * length:
            told.append(
                f"the displacement reaches {LENGTH.to_display(bending):.4g} mm, more than {SMALL_BENDING:g} of the "
                f"free length of {LENGTH.to_display(length):.4g} mm: the beam is one of small bending; lower the "
                "voltage, or check the coupling"
            )
    resonance = float(abs(natural_frequency(actuator.parameter_values))) / (2.0 * math.pi)
    fastest = _highest_frequency(run.metadata.signal)
    if fastest > RESONANCE * resonance:
        told.append(
            f"the signal goes up to {fastest:.4g} Hz, more than a third of the first resonance at {resonance:.4g} Hz: "
            "the model has this one mode only, and the damping of its ring is a guess unless it was identified; "
            "stay below, or trust the current alone"
        )
    return told


def _highest_frequency(text: str | None) -> float:
    """Of the waveforms of a signal [Hz]; 0 where none has a frequency."""
    from ipmclab.errors import InputError
    from ipmclab.signals import parse

    try:
        signal: Any = parse(text or "")
    except InputError:  # what was noted with a measured run need not be a signal
        return 0.0
    parts = getattr(signal, "signals", (signal,))
    return max(float(getattr(part, name, 0.0)) for part in parts for name in _FREQUENCIES)
