"""Water uptake against what the polymer can hold."""

from __future__ import annotations

import math

from ipmclab.consistency.known import KnownStrip, area_of
from ipmclab.consistency.polymers import EQUIVALENT_WEIGHT, WATER, membrane_of
from ipmclab.measurement.amount import SURE, Amount, beyond, conflict, how_sure
from ipmclab.run import Finding

CODE = "water-uptake"


def water_uptake(known: KnownStrip) -> list[Finding]:
    """``water-uptake``: less or more water by mass of polymer than the membrane takes up in water.

    The mass of polymer is known twice, from basis weight and area and from the dry mass less the plating; there is a
    finding only where both put the uptake outside the range on the same side.
    """
    sample = known.sample
    membrane = membrane_of(sample.membrane) if sample else None
    if sample is None or membrane is None or not sample.dry_mass or not sample.hydrated_mass:
        return []
    if sample.has_no_water:
        return []
    water = sample.hydrated_mass - sample.dry_mass
    of_water = math.hypot(known.uncertainty("sample.dry_mass"), known.uncertainty("sample.hydrated_mass"))
    area = area_of(known.values)
    sheet = membrane.basis_weight * area
    polymers = [(sheet, known.uncertainty("sample.basis_weight", sheet))]
    if sample.plating_loading is not None:
        metal = 2.0 * sample.plating_loading * area
        if sample.dry_mass > metal:
            polymers.append((sample.dry_mass - metal, known.uncertainty("sample.plating_loading", metal)))
    low = Amount(100.0 * membrane.least_uptake, 0.0, "%")
    high = Amount(100.0 * membrane.largest_uptake, 0.0, "%")
    uptakes = []
    for mass, uncertainty in polymers:
        part = 100.0 * water / mass
        uptakes.append(Amount(part, math.hypot(100.0 * of_water / mass, part * uncertainty / mass), "%"))
    nearest = min(uptakes, key=lambda uptake: beyond(uptake, low, high))
    sigmas = beyond(nearest, low, high)
    sides = {uptake.value < low.value for uptake in uptakes}
    if sigmas <= SURE or len(sides) > 1:
        return []
    molecules = nearest.value / 100.0 * EQUIVALENT_WEIGHT / WATER
    expected = low if nearest.value < low.value else high
    less = nearest.value < low.value
    return [
        conflict(
            CODE,
            f"from dry to hydrated the strip gains {1e6 * water:.3g} mg, {nearest} of its polymer ({molecules:.2g} "
            f"molecules of water for each acid group); soaked {membrane.name} takes {low.number} to {high.number}: "
            + how_sure(sigmas)
            + known.taken(["sample.dry_mass", "sample.hydrated_mass"]),
            "weigh the strip dry (two hours at 80 degC) and again after a day in water, blotted for the same few "
            "seconds: "
            + ("either it was not soaked, or not dry" if less else "either water clung to it, or it was not whole"),
            found=Amount(nearest.value / 100.0, nearest.uncertainty / 100.0, ""),
            expected=Amount(expected.value / 100.0, 0.0, ""),
            sigmas=sigmas,
            more={"molecules_per_acid_group": molecules},
        )
    ]
