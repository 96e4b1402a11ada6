"""What is known of a strip: parameters and masses, each with the best uncertainty that there is."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from ipmclab.fit.fit import Fit
from ipmclab.measurement.amount import shown
from ipmclab.model import Actuator
from ipmclab.sample import Sample
from ipmclab.units import LENGTH, MASS

Values = Mapping[str, float]

ASSUMED: Final[tuple[tuple[str, float, bool, str], ...]] = (
    (r"geometry\.thickness", 5e-6, False, "a micrometer on a soft strip"),
    (r"geometry\.width", 1e-4, False, "cut by hand"),
    (r"geometry\..*_length", 5e-4, False, "a ruler at the edge of the clamp"),
    (r"sample\..*_mass", 1e-6, False, "a balance that shows 1 mg"),
    (r"sample\.plating_loading", 0.10, True, "metal taken up by the whole batch, distributed evenly"),
    (r"sample\.basis_weight", 0.05, True, "between batches"),
    (r"beam\.density", 0.02, True, "mass over volume"),
    (r"beam\.modulus", 0.10, True, "a push test"),
    (r".*", 0.05, True, "no better than that without a fit"),
)
"""What is taken where nobody states an uncertainty: pattern of the name, standard uncertainty [SI], whether it is a
part of the value, and why (convention)."""


def area_of(values: Values) -> float:
    """(L_f + L_c) w [m^2]: one face of the whole strip."""
    return (values["geometry.free_length"] + values["geometry.clamped_length"]) * values["geometry.width"]


class KnownStrip:
    """The parameters of an actuator and the masses of its sample, with standard uncertainties.

    An uncertainty is the fit's where the parameter was fitted, else the one that the actuator's file states, else the
    one of ``ASSUMED``.

    Parameters
    ----------
    actuator : Actuator
    sample : Sample, optional
        The actuator's own where it is left out.
    fit : Fit, optional
    """

    def __init__(self, actuator: Actuator, sample: Sample | None = None, fit: Fit | None = None) -> None:
        self.actuator = actuator
        self.sample = sample if sample is not None else actuator.sample
        self.values: dict[str, float] = dict(actuator.parameter_values)
        self._fitted = {name: one.standard_error for name, one in fit.parameters.items()} if fit else {}

    def uncertainty(self, name: str, value: float | None = None) -> float:
        """Standard uncertainty of a parameter, or of a number of the sample that is given with its value [SI]."""
        if name in self._fitted:
            return self._fitted[name]
        if name in self.actuator.standard_uncertainties:
            return self.actuator.standard_uncertainties[name]
        size, relative = next((u, part) for pattern, u, part, _ in ASSUMED if re.fullmatch(pattern, name))
        return size * abs(self.values[name] if value is None else value) if relative else size

    def is_assumed(self, name: str) -> bool:
        """Whether nobody stated an uncertainty."""
        return name not in self._fitted and name not in self.actuator.standard_uncertainties

    def standard_uncertainty(self, function: Callable[[Values], float], names: Iterable[str]) -> float:
        """Standard uncertainty of what follows from some parameters: each moved by its own, added in squares."""
        total = 0.0
        for name in names:
            step = self.uncertainty(name)
            if math.isinf(step):
                return math.inf
            value = self.values[name]
            step = min(step, 0.5 * abs(value))  # so that a length does not go through zero
            up, down = function({**self.values, name: value + step}), function({**self.values, name: value - step})
            total += (0.5 * (up - down)) ** 2
        return math.sqrt(total)

    def taken(self, names: Iterable[str]) -> str:
        """A clause that names the uncertainties that were assumed, empty where all are stated."""
        said: list[str] = []
        for name in names:
            if not self.is_assumed(name):
                continue
            size, relative = next((u, part) for pattern, u, part, _ in ASSUMED if re.fullmatch(pattern, name))
            short = name.rpartition(".")[2].replace("_", " ")
            quantity = MASS if name.endswith("_mass") else LENGTH
            one = f"{100 * size:g} %" if relative else f"{shown(quantity.to_display(size))} {quantity.display_unit}"
            if f"{short} {one}" not in said:
                said.append(f"{short} {one}")
        return f" (standard uncertainties taken, as none are stated: {', '.join(said)})" if said else ""
