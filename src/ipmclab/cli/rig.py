"""``ipmclab rig``: look at a rig, prove its hardware, serve a stand-in for it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.options import Json, PlainCommand, PlainGroup, positive
from ipmclab.cli.output import (
    finding_document,
    print_findings,
    print_json,
    print_table,
    progress,
    read,
    with_unit,
)
from ipmclab.cli.rig_prove import prove
from ipmclab.cli.rig_serve import serve
from ipmclab.cli.rig_sheet import sheet
from ipmclab.errors import unknown_name
from ipmclab.units import CHANNELS, CURRENT, VOLTAGE

if TYPE_CHECKING:
    from ipmclab.rig.channels import Channel
    from ipmclab.rig.checks.check import ChannelCheck, RigCheck

SEVERITIES: Final = ("info", "warning", "error")

rig_app = typer.Typer(
    cls=PlainGroup,
    help="Look at a rig, prove its hardware, serve a stand-in for it.",
    add_completion=False,
    rich_markup_mode=None,
    invoke_without_command=True,
)

RigFile = Annotated[
    str,
    typer.Argument(metavar="RIG", help="A rig file (.toml), or thesis: the rig in the library.", show_default=False),
]


@rig_app.callback()
def _rig(context: typer.Context) -> None:
    """Show the help of the group where no verb of it is named."""
    if context.invoked_subcommand is None:
        print(context.get_help())


def check(
    rig: RigFile,
    actuator: Annotated[
        str | None,
        typer.Option(metavar="ACTUATOR", help="The strip that is to be driven; friend-2 unless given."),
    ] = None,
    amplitude: Annotated[
        str, typer.Option(metavar="QUANTITY", help="The largest voltage that will be applied, of either sign.")
    ] = "1 V",
    fail_on: Annotated[
        str | None,
        typer.Option(metavar="|".join(SEVERITIES), help="Exit with 1 on a finding at least this severe."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check every channel of a rig, with the output at 0 V.

    \b
    ipmclab rig check rig.toml --actuator friend-2 --amplitude "1 V"
    """
    if fail_on is not None and fail_on not in SEVERITIES:
        raise unknown_name("severity", fail_on, SEVERITIES, where="--fail-on")
    from ipmclab import load_actuator
    from ipmclab.cli.benches import make_bench, make_chamber
    from ipmclab.rig.checks.check import check_rig
    from ipmclab.rig.files.rig_file import load_rig

    volts = positive(amplitude, VOLTAGE, option="--amplitude")
    loaded = load_rig(rig)
    strip = load_actuator(actuator or loaded.virtual.actuator)
    bench = make_bench(loaded)
    chamber = make_chamber(loaded, bench)
    with progress(f"reading the channels of {loaded.name}"):
        found = check_rig(bench, strip, amplitude=volts, chamber=chamber)
    if chamber is not None:
        chamber.close()
    ranks = [SEVERITIES.index(finding.severity) for finding in found.findings]
    if as_json:
        print_json(
            {
                "rig": rig,
                "bench": found.bench,
                "actuator": strip.name,
                "amplitude": with_unit(volts, "V"),
                "peak_current": with_unit(found.peak_current, "A"),
                "peak_current_at_reversal": with_unit(2.0 * found.peak_current, "A"),
                "temperature": with_unit(found.temperature, "degC"),
                "chamber": None if found.chamber is None else asdict(found.chamber),
                "channels": [_channel_document(one) for one in found.channels],
                "findings": [finding_document(finding) for finding in found.findings],
                "worst": SEVERITIES[max(ranks)] if ranks else None,
            }
        )
    else:
        _print_check(found, strip.name, volts)
    if fail_on is not None and any(rank >= SEVERITIES.index(fail_on) for rank in ranks):
        raise typer.Exit(1)


def _print_check(found: RigCheck, strip: str, amplitude: float) -> None:
    print(found.bench)
    print(
        f"{strip} at {amplitude:g} V: at most {read(found.peak_current, CURRENT)} at an edge, "
        f"{read(2.0 * found.peak_current, CURRENT)} at a polarity reversal"
    )
    print()
    rows = [
        (
            one.channel.name,
            one.channel.physical or "-",
            _range(one),
            _in_display(one, one.channel.resolution),
            _in_display(one, one.reading),
            _in_display(one, one.noise),
            one.channel.calibrated or "-",
        )
        for one in found.channels
    ]
    if found.rig.thermometer is not None:
        reading = "-" if found.temperature is None else f"{found.temperature:.1f} degC"
        rows.append(("temperature", found.rig.thermometer.physical or "-", "-", "-", reading, "-", "-"))
    print_table(("channel", "input", "range", "resolution", "reads at 0 V", "noise", "calibrated"), rows)
    print()
    if found.rig.chamber is not None:
        reading = "it does not answer" if found.chamber is None else str(found.chamber)
        print(f"chamber ({found.rig.chamber.driver}): {reading}")
    print(f"{len(found.findings) or 'no'} finding{'' if len(found.findings) == 1 else 's'}")
    print_findings(found.findings)


def _in_display(one: ChannelCheck, value: float | None) -> str:
    return read(value, one.channel.quantity, digits=3)


def _range(one: ChannelCheck) -> str:
    quantity = one.channel.quantity
    low, high = (quantity.to_display(end) for end in _readable(one.channel))
    return f"{low:.4g} to {high:.4g} {quantity.display_unit}"


def _readable(channel: Channel) -> tuple[float, float]:
    """What a channel can read of what there is: no humidity is below 0 or above 100 percent."""
    low, high = channel.range
    return (max(low, 0.0), min(high, 100.0)) if channel.name == "relative_humidity" else (low, high)


def _channel_document(one: ChannelCheck) -> dict[str, Any]:
    channel = one.channel
    return {
        "channel": channel.name,
        "physical": channel.physical,
        "unit": CHANNELS[channel.name].unit,
        "range": _readable(channel),
        "resolution": channel.resolution,
        "expected": one.expected,
        "reading": one.reading,
        "noise": one.noise,
        "calibrated": channel.calibrated,
        "uncertainty": channel.uncertainty or None,
    }


rig_app.command("check", cls=PlainCommand)(check)
rig_app.command("prove", cls=PlainCommand)(prove)
rig_app.command("serve", cls=PlainCommand)(serve)
rig_app.command("sheet", cls=PlainCommand)(sheet)
