"""``ipmclab baseline``: how fast a strip curls with no voltage, and whether it can be tested in that air."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.files import read_runs
from ipmclab.cli.options import Json, RunFiles
from ipmclab.cli.output import print_json, print_paragraph, read, with_unit
from ipmclab.errors import InputError
from ipmclab.units import LENGTH, TIME, parse_quantity

if TYPE_CHECKING:
    from ipmclab.measurement.curl import Curl

_DIGITS: Final = 2


def baseline(
    runs: RunFiles,
    displacement: Annotated[
        str, typer.Option(metavar="LENGTH", help='What a test is expected to show, for example "1.3 mm".')
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

    expected = parse_quantity(displacement, LENGTH, where="--displacement")
    length = parse_quantity(test, TIME, where="--test")
    part = _number(share)
    found = [curl(run, expected, test=length, share=part) for run in read_runs(runs)]
    if as_json:
        print_json({"baselines": [_document(*each) for each in zip(runs, found, strict=True)]})
        return
    for path, one in zip(runs, found, strict=True):
        print_paragraph(f"{path}: {in_words(one)}")


def in_words(found: Curl) -> str:
    """The rate of a curl and the verdict, in plain words.

    Examples
    --------
    >>> from ipmclab.measurement.curl import Curl
    >>> print(in_words(Curl(5.6e-6, (5.2e-6, 6.0e-6), 0.0, 9, 40.0, 6.4e-5)).partition("; ")[0])
    the tip moves by 5.6 um/s (95 %: 5.2 to 6) where it is fastest, 0 s after the start
    """
    low, high = (f"{1e6 * rate:.{_DIGITS}g}" for rate in found.interval)
    moved = read(abs(found.rate) * found.test, LENGTH, digits=_DIGITS)
    rate = (
        f"the tip moves by {1e6 * abs(found.rate):.{_DIGITS}g} um/s (95 %: {low} to {high}) where it is fastest, "
        f"{found.since:.3g} s after the start; {moved} in a test of {found.test:g} s, of which "
        f"{read(found.allowed, LENGTH, digits=_DIGITS)} are allowed. "
    )
    if found.verdict == "yes":
        return rate + "Tests are possible in this air."
    shorter = "" if not math.isfinite(found.longest_test) else f" than {read(found.longest_test, TIME, digits=_DIGITS)}"
    if found.verdict == "no":
        return (
            rate
            + f"Not in this air: test in a higher humidity, or make each test shorter{shorter} and hydrate between."
        )
    return rate + f"This record does not decide: record it longer, or make each test shorter{shorter}."


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
