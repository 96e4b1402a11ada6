"""The thickness of the strip against the membrane that it is made of."""

from __future__ import annotations

from ipmclab.consistency.known import KnownStrip
from ipmclab.consistency.polymers import PLATINUM, membrane_of
from ipmclab.measurement.amount import SURE, Amount, beyond, conflict, how_sure
from ipmclab.run import Finding
from ipmclab.units import LENGTH

CODE = "thickness-against-membrane"

_DRY = 0.95
"""A dry membrane is thinner than at 50 % relative humidity (convention)."""

_POROUS = 2.0
"""Thickness of a plated layer over that of the same metal when dense (convention)."""


def thickness_against_membrane(known: KnownStrip) -> list[Finding]:
    """``thickness-against-membrane``: thinner than the dry membrane, or thicker than the soaked and plated one."""
    sample = known.sample
    if sample is None:
        return []
    membrane = membrane_of(sample.membrane)
    nominal = sample.nominal_membrane_thickness or (membrane.thickness if membrane else None)
    if nominal is None:
        return []
    swelling = membrane.thickening if membrane else 0.2
    plating = 2.0 * _POROUS * (sample.plating_loading or 0.0) / PLATINUM
    low = Amount.of(_DRY * nominal, 0.0, LENGTH)
    high = Amount.of(nominal * (1.0 + swelling) + plating, 0.0, LENGTH)
    has = Amount.of(known.values["geometry.thickness"], known.uncertainty("geometry.thickness"), LENGTH)
    sigmas = beyond(has, low, high)
    if sigmas <= SURE:
        return []
    sheet = Amount.of(nominal, 0.0, LENGTH)
    return [
        conflict(
            CODE,
            f"the model has a thickness of {has}; its membrane, {sample.membrane or 'as stated'}, has {sheet} by data "
            f"sheet, which soaked and plated makes {low.number} to {high.number}: {how_sure(sigmas)}"
            + known.taken(["geometry.thickness"]),
            "measure the strip with a micrometer, dry and wet; a scanning electron micrograph of its cross-section "
            "shows membrane and metal separately",
            found=has,
            expected=sheet,
            sigmas=sigmas,
            more={"lowest": low.value, "highest": high.value},
        )
    ]
