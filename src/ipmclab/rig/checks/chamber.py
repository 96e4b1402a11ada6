"""Whether the chamber of a rig answers, reads what the rig's own sensors read, and can be brought to standby."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from ipmclab.rig.chambers.chamber import Chamber, ChamberError, Conditions
from ipmclab.rig.checks.proof import Item
from ipmclab.run import Finding

SAME_TEMPERATURE: Final = 3.0
SAME_HUMIDITY: Final = 8.0
"""A sensor at the strip and that of the chamber differ by no more in still air [K, percent]."""


def chamber_findings(
    chamber: Chamber, temperature: float | None, relative_humidity: float | None
) -> tuple[Conditions | None, tuple[Finding, ...]]:
    """Read a chamber, and nothing else: it continues with what it does.

    Parameters
    ----------
    chamber : Chamber
    temperature : float [degC], optional
    relative_humidity : float [percent], optional
        What the sensors of the rig read.

    Returns
    -------
    conditions : Conditions or None
        None where it does not answer.
    findings : tuple of Finding

    Examples
    --------
    >>> from ipmclab.rig.chambers.virtual import VirtualChamber
    >>> read, found = chamber_findings(VirtualChamber(), 77.0, 45.0)
    >>> read.mode, [finding.code for finding in found]
    ('off', ['chamber-differs'])
    """
    try:
        read = chamber.read()
    except ChamberError as error:
        return None, (Finding(error.code, "error", f"{error.where}: {error.message}", error.repair),)
    return read, tuple(_findings(read, temperature, relative_humidity))


def chamber_items(chamber: Chamber) -> Iterator[Item]:
    """What ``rig prove`` tries of a chamber: whether it answers, and whether it comes to standby."""
    name, what = "chamber", "the chamber answers"
    try:
        read = chamber.read()
    except ChamberError as error:
        yield Item(name, what, "failed", error.message, error.repair)
        return
    yield Item(name, what, "passed", str(read))
    name, what = "chamber-standby", "the chamber after standby was asked for"
    if read.mode == "program":
        yield Item(name, what, "not done", "it follows a program", "end that at its panel, and prove the rig again")
        return
    try:
        chamber.safe()
        read = chamber.read()
    except ChamberError as error:
        yield Item(name, what, "failed", error.message, error.repair)
        return
    if read.mode in ("standby", "off"):
        yield Item(name, what, "passed", str(read))
    elif read.mode == "unknown":
        yield Item(name, what, "noted", str(read), "check at its panel that it is in standby")
    else:
        yield Item(name, what, "failed", str(read), "look at its panel")


def _findings(read: Conditions, temperature: float | None, relative_humidity: float | None) -> Iterator[Finding]:
    if read.alarms:
        yield Finding(
            "chamber-alarm", "error", f"the chamber raises: {', '.join(read.alarms)}", "look at its panel and clear it"
        )
    if read.mode == "program":
        yield Finding(
            "chamber-in-use",
            "warning",
            "the chamber follows a program of its own: no experiment sets it meanwhile",
            "end that at its panel",
        )
    pairs = (
        ("temperature", read.temperature, temperature, SAME_TEMPERATURE, "degC"),
        ("relative_humidity", read.relative_humidity, relative_humidity, SAME_HUMIDITY, "percent"),
    )
    for name, own, at_strip, most, unit in pairs:
        if own is None or at_strip is None or abs(own - at_strip) <= most:
            continue
        yield Finding(
            "chamber-differs",
            "warning",
            f"the chamber's own sensor reads {own:.1f} {unit}, that at the strip {at_strip:.1f} {unit}",
            "see that both are in the same air, and in the same unit; the strip's counts",
            name,
            values={"chamber": own, "strip": at_strip},
        )
