"""Dry mass against what the membrane and the metal weigh."""

from __future__ import annotations

import math

from ipmclab.consistency.known import KnownStrip, Values, area_of
from ipmclab.consistency.polymers import membrane_of
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
from ipmclab.run import Finding
from ipmclab.units import MASS

CODE = "dry-mass-against-layers"


def dry_mass_against_layers(known: KnownStrip) -> list[Finding]:
    """``dry-mass-against-layers``: the dry mass is not basis weight x area + 2 x plating x area."""
    sample = known.sample
    membrane = membrane_of(sample.membrane) if sample else None
    if sample is None or membrane is None or sample.dry_mass is None or sample.plating_loading is None:
        return []
    basis, loading = membrane.basis_weight, sample.plating_loading
    names = ("geometry.width", "geometry.free_length", "geometry.clamped_length")

    def layers(values: Values) -> float:
        return (basis + 2.0 * loading) * area_of(values)

    area = area_of(known.values)
    uncertainty = math.hypot(
        known.standard_uncertainty(layers, names),
        known.uncertainty("sample.basis_weight", basis) * area,
        2.0 * known.uncertainty("sample.plating_loading", loading) * area,
    )
    expected = Amount.of(layers(known.values), uncertainty, MASS)
    weighed = Amount.of(sample.dry_mass, known.uncertainty("sample.dry_mass"), MASS)
    sigmas = sigmas_between(weighed, expected)
    if sigmas <= SURE:
        return []
    return [
        conflict(
            CODE,
            f"the strip weighs {weighed} dry; {area * 1e6:.4g} mm^2 of {membrane.name} ({basis * 1e3:.4g} g/m^2) with "
            f"{loading * 100:.3g} mg/cm^2 of metal on each face make {expected}: {how_sure(sigmas)}"
            + known.taken(("sample.dry_mass", "sample.basis_weight", "sample.plating_loading", *names)),
            "dry the strip at 80 degC for two hours and weigh it again, and measure its length and width: water that "
            "was left, a larger strip or more metal than stated would each explain it",
            found=weighed,
            expected=expected,
            sigmas=sigmas,
        )
    ]
