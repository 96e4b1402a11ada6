"""``ipmclab baseline``: how fast a strip curls with no voltage, and whether it can be tested in that air."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ipmclab.cli.files import read_runs
from ipmclab.cli.options import Json, RunFiles
from ipmclab.cli.output import print_json, print_paragraph, with_unit
from ipmclab.errors import InputError
from ipmclab.units import LENGTH, TIME, parse_quantity

if TYPE_CHECKING:
    from ipmclab.measurement.curl import Curl


def baseline(
    runs: RunFiles,
    displacement: Annotated[
        str,
        typer.Option(metavar="LENGTH", help='The displacement that a test is expected to show, for example "1.3 mm".'),
    ],
    test: Annotated[str, typer.Option(metavar="TIME", help="Length of one test.")] = "40 s",
    share: Annotated[
        str, typer.Option(metavar="NUMBER", help="Part of the displacement that the curl may make in one test.")
    ] = "0.05",
    as_json: Json = False,
) -> None:
    """Say how fast a strip curls with no voltage on it, and whether it can be tested in that air.

    \b
    ipmclab baseline room.nc chamber.nc --displacement "1.3 mm"
    """
    from ipmclab.measurement.curl import curl
    from ipmclab.reporting.curl import curl_in_words

    expected = parse_quantity(displacement, LENGTH, where="--displacement")
    length = parse_quantity(test, TIME, where="--test")
    part = _number(share)
    found = [curl(run, expected, test=length, share=part) for run in read_runs(runs)]
    if as_json:
        print_json({"baselines": [_document(*each) for each in zip(runs, found, strict=True)]})
        return
    for path, one in zip(runs, found, strict=True):
        print_paragraph(f"{path}: {curl_in_words(one)}")


def _document(path: Path, found: Curl) -> dict[str, Any]:
    return {
        "run": path,
        "rate": with_unit(found.rate, "m/s"),
        "interval": {"values": found.interval, "unit": "m/s"},
        "since": with_unit(found.since, "s"),
        "stretches": found.stretches,
        "test": with_unit(found.test, "s"),
        "allowed": with_unit(found.allowed, "m"),
        "longest_test": with_unit(found.longest_test if math.isfinite(found.longest_test) else None, "s"),
        "verdict": found.verdict,
    }


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise InputError(
            f"the share is {text!r}", code="bad-share", where="--share", repair="give a number between 0 and 1"
        ) from error
