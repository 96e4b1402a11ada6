"""``ipmclab rig sheet``: read the sheet resistance of a strip through four probes."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from ipmclab.cli.options import Json, positive
from ipmclab.cli.output import print_json, print_paragraph, progress
from ipmclab.errors import InputError
from ipmclab.units import LENGTH, RESISTANCE, SHEET_RESISTANCE, parse_quantity


def sheet(
    rig: Annotated[
        str,
        typer.Argument(
            metavar="RIG", help="A rig file (.toml), or thesis: the rig in the library.", show_default=False
        ),
    ],
    width: Annotated[
        str | None,
        typer.Option(metavar="QUANTITY", help="The width of the strip, for example '5 mm'; needed unless --shorted."),
    ] = None,
    length: Annotated[
        str | None,
        typer.Option(
            metavar="QUANTITY", help="The length of the whole strip, for example '30 mm'; needed for point contacts."
        ),
    ] = None,
    count: Annotated[int, typer.Option(metavar="N", help="How many readings; it takes two each second.")] = 20,
    zero: Annotated[
        str | None,
        typer.Option(metavar="QUANTITY", help="What the meter read with its four contacts shorted; see --shorted."),
    ] = None,
    shorted: Annotated[
        bool, typer.Option("--shorted", help="A piece of metal joins the four contacts: read the meter's offset.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Read the sheet resistance of a strip through four probes (NI 9217).

    \b
    ipmclab rig sheet rig.toml --width "5 mm"
    """
    from ipmclab.measurement.uncertain import exact
    from ipmclab.procedure.four_probe import FourProbes, sheet_resistance
    from ipmclab.procedure.step import Result, advice_for
    from ipmclab.rig.files.rig_file import load_rig
    from ipmclab.rig.sheet_meter import RATE, read_four_probe

    if width is None and not shorted:
        raise InputError(
            "the width of the strip is not given",
            code="missing-option",
            where="--width",
            repair='give --width "5 mm"; only --shorted needs none',
        )
    across = math.nan if width is None else positive(width, LENGTH, option="--width")
    along = math.inf if length is None else positive(length, LENGTH, option="--length")
    offset = None if zero is None else parse_quantity(zero, RESISTANCE, where="--zero")
    loaded = load_rig(rig)
    with progress(f"reading {loaded.name}, {count / RATE:.0f} s"):
        found = read_four_probe(loaded, count=count, shorted=shorted)
    if found.probe.contacts == "points" and length is None and not shorted:
        raise InputError(
            "the contacts are points, whose factor depends on the length of the strip",
            code="missing-option",
            where="--length",
            repair='give --length "30 mm"',
        )
    error = found.scatter / math.sqrt(len(found.resistance))
    document = {
        "rig": rig,
        "bench": found.bench,
        "readings": {"value": found.resistance, "unit": "ohm"},
        "resistance": {"value": found.mean, "standard_uncertainty": error, "unit": "ohm"},
        "shorted": shorted,
    }
    title = f"{found.bench}: {len(found.resistance)} readings"
    if shorted:
        if as_json:
            print_json({**document, "sheet_resistance": None})
            return
        print(f"{title}, contacts shorted")
        print(f"offset of the meter         {found.mean:.4f} ± {error:.4f} ohm")
        print_paragraph(f'Next: read the strip with --zero "{found.mean:.4f} ohm".')
        return
    result = sheet_resistance(
        FourProbes.of_rig(found.probe, list(found.resistance), offset), exact(across), exact(along)
    )
    if as_json:
        square = {"value": result.value, "standard_uncertainty": result.uncertainty, "unit": "ohm/sq"}
        print_json({**document, "sheet_resistance": {**square, "shares": result.shares}})
        return
    shown = Result(result, SHEET_RESISTANCE)
    print(title)
    print(f"between the inner contacts  {found.mean:.4f} ± {error:.4f} ohm (scatter of the readings alone)")
    print(f"sheet resistance            {shown.said}, of a strip exactly {1e3 * across:g} mm wide")
    print_paragraph(f"Of its variance: {shown.because}.")
    if advice_for(result):
        print_paragraph(f"-> {advice_for(result)}")
    print_paragraph("For a procedure (ipmclab procedure), [sheet_resistance] has:")
    print(f'  contacts = "{found.probe.contacts}"')
    print(f'  spacing = "{1e3 * found.probe.spacing:g} mm"')
    print("  resistance = [" + ", ".join(f'"{one:.4f} ohm"' for one in found.resistance) + "]")
    if offset is not None:
        print(f'  zero = "{offset:g} ohm"')
