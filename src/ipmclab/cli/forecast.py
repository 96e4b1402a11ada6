"""``ipmclab forecast``: what the readings of a run do next."""

from __future__ import annotations

from typing import Annotated

import typer

from ipmclab.cli.files import fit_or_actuator, read_runs
from ipmclab.cli.options import Json, RunFile
from ipmclab.cli.output import (
    finding_document,
    print_findings,
    print_json,
    print_paragraph,
    print_table,
    progress,
    read,
    with_unit,
)
from ipmclab.errors import InputError
from ipmclab.units import CHANNELS, TIME, parse_quantity

_ROWS = 6


def forecast(
    actuator: Annotated[
        str, typer.Argument(metavar="FITTED", help="A fitted strip, or any actuator; - for none.", show_default=False)
    ],
    run: RunFile,
    origin: Annotated[str, typer.Option(metavar="TIME", help='The last time that is used, for example "20 s".')],
    horizon: Annotated[str, typer.Option(metavar="TIME", help="How far ahead.")] = "10 s",
    channel: Annotated[str, typer.Option(metavar="CHANNEL", help="displacement or force.")] = "displacement",
    level: Annotated[str, typer.Option(metavar="NUMBER", help="Probability that the band holds a reading.")] = "0.8",
    as_json: Json = False,
) -> None:
    """Forecast a channel of a run from what was read up to a time; the voltage after it is the plan.

    \b
    ipmclab forecast fitted.toml run.nc --origin "20 s" --horizon "10 s"
    """
    from ipmclab.forecasting.forecast import forecast as forecast_channel

    start = parse_quantity(origin, TIME, where="--origin")
    ahead = parse_quantity(horizon, TIME, where="--horizon")
    try:
        part = float(level)
    except ValueError as error:
        raise InputError(
            f"the level is {level!r}", code="bad-level", where="--level", repair="give a number between 0 and 1"
        ) from error
    model = None if actuator == "-" else fit_or_actuator(actuator)
    (loaded,) = read_runs([run])
    with progress("forecasting"):
        found = forecast_channel(model, loaded, origin=start, horizon=ahead, channel=channel, level=part)
    if as_json:
        unit = CHANNELS[channel].unit
        print_json(
            {
                "actuator": actuator,
                "run": run,
                "channel": channel,
                "origin": with_unit(found.origin, "s"),
                "level": found.level,
                "time": {"values": found.time, "unit": "s"},
                **{name: {"values": getattr(found, name), "unit": unit} for name in ("mean", "lower", "upper")},
                "weights": found.weights,
                "findings": [finding_document(one) for one in found.findings],
            }
        )
        return
    quantity, last = CHANNELS[channel], len(found.time) - 1
    places = sorted({round(k * last / (_ROWS - 1)) for k in range(_ROWS)})
    rows = [
        [
            read(float(found.time[k]), TIME),
            *(read(float(values[k]), quantity) for values in (found.mean, found.lower, found.upper)),
        ]
        for k in places
    ]
    title = f"{channel} after {read(found.origin, TIME)}"
    print_table(["time", "expected", f"{100 * found.level:.0f} % from", "to"], rows, title=title)
    print_paragraph(found.made_of)
    if found.findings:
        print_findings(found.findings)
