"""What is measured of a strip without a run: mass dry and wet, sheet resistance, stiffness against a push."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from ipmclab.campaign.campaign import Campaign, Strip
from ipmclab.measurement.push import Push, stiffness
from ipmclab.measurement.uncertain import exact
from ipmclab.model import Actuator
from ipmclab.procedure.four_probe import FourProbes, sheet_resistance
from ipmclab.rig.sheet_meter import read_four_probe

BALANCE: Final = 0.3e-6
"""Standard deviation [kg] of a weighing on the virtual balance, which shows 1 mg."""

_SHOWN: Final = 1e-6
_WAY: Final = np.linspace(0.0, 0.5e-3, 11)  # of the push [m], in; out again the same
_FORCE_NOISE: Final = 0.1e-3 / 5.0  # N: the load cell's, each reading a mean of 25


@dataclass(frozen=True)
class Fact:
    """One number of a strip.

    Parameters
    ----------
    name : str
        ``"dry mass"``, ``"hydrated mass"``, ``"water uptake"``, ``"sheet resistance"`` or ``"stiffness"``.
    value : float [SI unit]
    uncertainty : float
        Standard uncertainty.
    unit : str
        Empty for a ratio.
    how : str
    """

    name: str
    value: float
    uncertainty: float
    unit: str
    how: str

    def as_dict(self) -> dict[str, Any]:
        """The fact as a JSON document."""
        values = {"value": self.value, "uncertainty": self.uncertainty}
        return {"name": self.name, **values, "unit": self.unit, "how": self.how}


def measured_facts(campaign: Campaign, strip: Strip) -> Iterator[Fact]:
    """What a campaign needs of a strip at a virtual bench, with the noise of the instruments.

    Examples
    --------
    >>> from ipmclab.campaign.campaign_file import load_campaign
    >>> campaign = load_campaign("friend-chapter-5")
    >>> [fact.name for fact in measured_facts(campaign, campaign.strips[0])]
    ['dry mass', 'hydrated mass', 'water uptake', 'sheet resistance', 'stiffness']
    """
    noise = np.random.default_rng(zlib.crc32(f"{campaign.seed}/{strip.sample.id}/facts".encode()))
    if "mass" in campaign.facts:
        yield from _masses(strip, noise)
    model = strip.virtual("", "", "")
    if model is None:
        return
    if "sheet resistance" in campaign.facts and strip.actuator is not None:
        yield _sheet(campaign, strip, model)
    if "stiffness" in campaign.facts:
        yield _stiffness(model, noise)


def _masses(strip: Strip, noise: np.random.Generator) -> Iterator[Fact]:
    found = {}
    uncertainty = float(np.hypot(BALANCE, _SHOWN / np.sqrt(12.0)))
    for name, mass in (("dry mass", strip.sample.dry_mass), ("hydrated mass", strip.sample.hydrated_mass)):
        if mass is not None:
            found[name] = _SHOWN * round((mass + BALANCE * float(noise.standard_normal())) / _SHOWN)
            yield Fact(name, found[name], uncertainty, "kg", "weighed once, tapped dry with tissue")
    if len(found) == 2 and found["dry mass"] > 0.0:  # lighter than the balance shows
        yield water_uptake(found["dry mass"], found["hydrated mass"], uncertainty)


def water_uptake(dry: float, wet: float, uncertainty: float) -> Fact:
    """The water that a strip took up, as a share of its dry mass; of masses [kg] with one standard uncertainty.

    Examples
    --------
    >>> round(water_uptake(90e-6, 107e-6, 0.5e-6).value, 3)
    0.189
    """
    share = wet / dry - 1.0
    error = uncertainty / dry * float(np.hypot(1.0, wet / dry))
    return Fact("water uptake", share, error, "", "hydrated over dry mass, less 1")


def _sheet(campaign: Campaign, strip: Strip, model: Actuator) -> Fact:
    seed = zlib.crc32(f"{campaign.seed}/{strip.sample.id}/sheet".encode())
    assert strip.actuator is not None
    rig = replace(campaign.rig, virtual=replace(campaign.rig.virtual, actuator=strip.actuator, seed=seed))
    found = read_four_probe(rig)
    across, along = (
        exact(model["geometry.width"]),
        exact(model["geometry.free_length"] + model["geometry.clamped_length"]),
    )
    result = sheet_resistance(FourProbes.of_rig(found.probe, list(found.resistance)), across, along)
    return Fact("sheet resistance", result.value, result.uncertainty, "ohm/sq", f"four probes, {found.bench}")


def _stiffness(model: Actuator, noise: np.random.Generator) -> Fact:
    """A push of the load cell against the strip at the sensing point, in and out."""
    compliance = model.frequency_response(np.zeros(1), ["displacement"], driven_by="external_force")
    slope = 1.0 / float(compliance[0, 0].real)
    way = np.concatenate([_WAY, _WAY[::-1]])
    found, _ = stiffness(Push(way, slope * way + _FORCE_NOISE * noise.standard_normal(len(way))))
    return Fact("stiffness", found.value, found.uncertainty, "N/m", "push of 0.5 mm at the sensing point, in and out")
