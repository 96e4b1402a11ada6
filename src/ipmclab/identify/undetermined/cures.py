"""What would cure a combination of parameters that readings leave open: another measurement, or another output."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_MOVED: Final = 1e-3

SERIES: Final = ("circuit.sheet_resistance", "circuit.contact_resistance")
"""What lies in series with all branches."""

_MEASURED: Final = {
    "circuit.sheet_resistance": "measure the sheet resistance (four probes)",
    "circuit.contact_resistance": "measure the contact resistance (four wires, the clamp closed on bare metal)",
    "geometry.free_length": "measure the free length",
    "geometry.clamped_length": "measure the clamped length",
    "geometry.width": "measure the width",
    "geometry.thickness": "measure the thickness",
    "geometry.sensing_length": "measure where the sensor stands",
    "beam.modulus": "measure Young's modulus (push the tip with a known force)",
    "beam.density": "measure the density (mass and volume)",
}
"""Parameters that an experiment without the model gives, the quickest first."""


@dataclass(frozen=True)
class Cure:
    """One measurement that would determine a combination.

    Parameters
    ----------
    name : str
        ``measure`` and a parameter, ``record`` and an output, or ``raise voltage``.
    sentence : str
    """

    name: str
    sentence: str


def cures_of(names: Sequence[str], row: FloatArray, outputs: Sequence[str]) -> tuple[Cure, ...]:
    """Measurements of which each alone would determine a combination.

    Parameters
    ----------
    names : sequence of str
    row : float array, shape (n_names,)
        Relative change of each parameter along the combination.
    outputs : sequence of str
        Outputs that would show it, everything else being as free as it is.
    """
    moved = {name.split("[")[0] for name, part in zip(names, row, strict=True) if abs(part) > _MOVED}
    found = [Cure(f"measure {name}", sentence) for name, sentence in _MEASURED.items() if name in moved]
    leans = not (any(name.startswith("coupling.") for name in names) or _is_of_sensors(moved))
    known = " (if the coupling is known from elsewhere)" if leans else ""
    for output in outputs:
        said = f"add a {output} run" if output == outputs[0] else f"a {output} run"
        found.append(Cure(f"record {output}", said + (known if output == outputs[-1] else "")))
    if not found and moved and all(name.startswith("leak.") for name in moved):
        found.append(Cure("raise voltage", "record at several voltages above the threshold of the leak"))
    return tuple(found)


def _is_of_sensors(moved: Collection[str]) -> bool:
    return all(name.startswith("observation.") for name in moved)


def measured(name: str) -> str:
    """How a parameter is measured on its own, in words; empty where nobody does."""
    return _MEASURED.get(name.split("[")[0], "")


def said_of(cures: Sequence[Cure], moved: Sequence[str]) -> str:
    """The cures of a combination in words; ``moved`` are its parameters, the most important first."""
    if not cures:
        listed = ", ".join(moved)
        return f"fix {listed if len(moved) == 1 else f'one of {listed}'} at a known value"
    *most, last = [cure.sentence for cure in cures]
    return f"{', '.join(most)} or {last}" if most else last
