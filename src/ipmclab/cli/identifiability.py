"""``ipmclab identifiability``: what perfect readings could determine, before any is recorded."""

from __future__ import annotations

from typing import Annotated

import typer

from ipmclab.cli.options import ActuatorName, Free, Json, positive
from ipmclab.cli.output import print_json, print_paragraph
from ipmclab.units import VOLTAGE


def identifiability(
    actuator: ActuatorName,
    free: Free,
    outputs: Annotated[
        list[str] | None,
        typer.Option(metavar="NAMES", help="What is read: current (unless given), displacement, force."),
    ] = None,
    voltage: Annotated[
        str, typer.Option(metavar="QUANTITY", help="The largest voltage that is applied; only a leak depends on it.")
    ] = "3 V",
    as_json: Json = False,
) -> None:
    """Compute what runs could determine if they were perfect, and what would cure what they leave open.

    It takes the actuator alone. Every cure is tried on the model before it is named.

    \b
    ipmclab identifiability friend-2 --free electrical,circuit.sheet_resistance --outputs current
    """
    from ipmclab import load_actuator
    from ipmclab.planning.identifiable import identifiability as look

    volts = positive(voltage, VOLTAGE, option="--voltage")
    read = [name.strip() for text in outputs or ["current"] for name in text.split(",")]
    found = look(load_actuator(actuator), free=free, outputs=read, voltage=volts)
    if as_json:
        print_json(
            {
                "actuator": actuator,
                "free": found.free,
                "outputs": found.outputs,
                "rank": found.rank,
                "is_complete": found.is_complete,
                "singular_values": found.singular_values,
                "undetermined": [
                    {"coefficients": one.coefficients, "sentence": one.sentence, "cures": one.cures}
                    for one in found.directions
                ],
            }
        )
        return
    print_paragraph(
        f"Perfect readings of {' and '.join(found.outputs)} show {found.rank} of {len(found.free)} combinations of "
        "the free parameters."
    )
    for one in found.directions:
        print_paragraph(f"Open: {one.sentence}.")
    if found.is_complete:
        print_paragraph("Nothing is left open. Whether real readings show it well enough is said by a fit.")
