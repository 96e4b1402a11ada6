"""Mass = density x volume."""

from __future__ import annotations

from ipmclab.consistency.known import KnownStrip, Values, area_of
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
from ipmclab.run import Finding
from ipmclab.units import LENGTH, MASS

CODE = "density-against-mass"


def density_against_mass(known: KnownStrip) -> list[Finding]:
    """``density-against-mass``: the thickness that mass, density and area need is not the model's.

    The hydrated mass counts where it is known, since a strip works wet; else the dry one. Stated as a thickness,
    because the stiffness goes with its cube.
    """
    sample = known.sample
    mass = (sample.hydrated_mass or sample.dry_mass) if sample else None
    if sample is None or mass is None:
        return []
    which = "sample.hydrated_mass" if sample.hydrated_mass else "sample.dry_mass"
    names = ("beam.density", "geometry.width", "geometry.free_length", "geometry.clamped_length")

    def needed(values: Values) -> float:
        return mass / (values["beam.density"] * area_of(values))

    value = needed(known.values)
    of_mass = value * known.uncertainty(which, mass) / mass
    needs = Amount.of(value, (known.standard_uncertainty(needed, names) ** 2 + of_mass**2) ** 0.5, LENGTH)
    thickness = known.values["geometry.thickness"]
    has = Amount.of(thickness, known.uncertainty("geometry.thickness"), LENGTH)
    sigmas = sigmas_between(needs, has)
    if sigmas <= SURE:
        return []
    density, implied = known.values["beam.density"], mass / (area_of(known.values) * thickness)
    return [
        conflict(
            CODE,
            f"a mass of {Amount.of(mass, 0.0, MASS)} and a density of {density:.4g} kg/m^3 need a thickness of "
            f"{needs}, but the model has {has}, with which the density would be {implied:.4g} kg/m^3: "
            + how_sure(sigmas)
            + known.taken((which, *names, "geometry.thickness")),
            "measure the thickness of the wet strip with a micrometer at five places, and weigh it: the stiffness goes "
            "with the cube of the thickness",
            found=needs,
            expected=has,
            sigmas=sigmas,
            more={"density": density, "implied_density": implied},
        )
    ]
