"""What people measure of a strip for a campaign: asked for at a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import typer

from ipmclab.errors import InputError
from ipmclab.units import LENGTH, MASS, STIFFNESS, Quantity, parse_quantity

if TYPE_CHECKING:
    from ipmclab.campaign.campaign import Campaign, Strip
    from ipmclab.campaign.facts import Fact


def asked_facts(campaign: Campaign, strip: Strip, known: Mapping[str, float]) -> Iterator[Fact]:
    """The facts of one strip that are not known yet; Enter leaves one out.

    Parameters
    ----------
    campaign : Campaign
    strip : Strip
    known : mapping of name to float [SI]
        Those that are.
    """
    from ipmclab.campaign.facts import BALANCE, Fact, water_uptake

    id_ = strip.sample.id
    if "mass" in campaign.facts:
        masses = {name: known[name] for name in ("dry mass", "hydrated mass") if name in known}
        for name in ("dry mass", "hydrated mass"):
            if name not in known and (value := _asked(f"{id_}: {name}", MASS, "90 mg")) is not None:
                masses[name] = value
                yield Fact(name, value, BALANCE, "kg", "weighed, tapped dry with tissue")
        if len(masses) == 2 and "water uptake" not in known:
            yield water_uptake(masses["dry mass"], masses["hydrated mass"], BALANCE)
    if "sheet resistance" in campaign.facts and "sheet resistance" not in known and campaign.rig.four_probe:
        width = _asked(f"{id_}: press the four contacts onto it; its width", LENGTH, "5 mm")
        if width is not None:
            yield _read_sheet(campaign, width)
    if "stiffness" in campaign.facts and "stiffness" not in known:
        value = _asked(f"{id_}: stiffness at the sensing point", STIFFNESS, "0.8 N/m")
        if value is not None:
            yield Fact("stiffness", value, 0.0, "N/m", "typed by the operator, without its uncertainty")


def _asked(text: str, quantity: Quantity, example: str) -> float | None:
    """A quantity that somebody types; None where nothing was typed."""
    while True:
        typed = typer.prompt(f"{text} (such as {example}; Enter to go without)", default="", show_default=False)
        if not typed.strip():
            return None
        try:
            value = parse_quantity(typed, quantity, where=text)
        except InputError as error:
            print(f"  {error}")
            continue
        if value > 0.0:
            return value
        print(f"  {typed.strip()} is not above 0: read it again")


def _read_sheet(campaign: Campaign, width: float) -> Fact:
    from ipmclab.campaign.facts import Fact
    from ipmclab.measurement.uncertain import exact
    from ipmclab.procedure.four_probe import FourProbes, sheet_resistance
    from ipmclab.rig.sheet_meter import read_four_probe

    found = read_four_probe(campaign.rig)
    probes = FourProbes.of_rig(found.probe, list(found.resistance))
    result = sheet_resistance(probes, exact(width), exact(math.inf))
    return Fact("sheet resistance", result.value, result.uncertainty, "ohm/sq", f"four probes, {found.bench}")
