"""``ipmclab simulate``: what an actuator does under a signal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.files import check_output
from ipmclab.cli.options import ActuatorName, Force, Json, positive
from ipmclab.cli.output import print_json, print_remarks, print_table, progress, read, with_unit
from ipmclab.errors import InputError, suggest
from ipmclab.units import CHANNELS, FREQUENCY, TIME

if TYPE_CHECKING:
    from ipmclab.run import Hold, Run

HOLDS: Final[tuple[Hold, ...]] = ("zero", "zero-before", "first")


def simulate(
    actuator: ActuatorName,
    signal: Annotated[str, typer.Option(metavar="TEXT", help='For example "step 1 V" or "sine 1 V 0.1 Hz".')],
    duration: Annotated[str, typer.Option(metavar="TIME", help='For example "40 s".')],
    rate: Annotated[str, typer.Option(metavar="FREQUENCY", help='Rows a second, for example "50 Hz".')],
    out: Annotated[Path, typer.Option(metavar="FILE.nc", help="The run to write.")],
    hold: Annotated[str, typer.Option(metavar="|".join(HOLDS), help="What the voltage does between rows.")] = "zero",
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Simulate an actuator under a signal and write the run.

    \b
    ipmclab simulate friend-2 --signal "step 1 V" --duration "40 s" --rate "50 Hz" --out step.nc
    """
    from ipmclab import load_actuator, signals, write_run
    from ipmclab.model.simulate import simulate as simulate_actuator
    from ipmclab.model.validity import sentence

    if hold not in HOLDS:
        raise InputError(f"unknown hold {hold!r}", code="unknown-hold", where="--hold", repair=suggest(hold, HOLDS))
    seconds = positive(duration, TIME, option="--duration")
    hertz = positive(rate, FREQUENCY, option="--rate")
    applied = signals.parse(signal)
    check_output(out, force=force, suffixes=(".nc",))
    model = load_actuator(actuator)
    with progress(f"simulating {model.name}"):
        run = simulate_actuator(model, applied, duration=seconds, rate=hertz, hold=hold)
        write_run(run, out, overwrite=force)

    told = [sentence(finding) for finding in run.metadata.findings]
    summary = {name: _summary(run, name) for name in run.channels if name != "voltage"}
    if as_json:
        print_json(
            {
                "actuator": model.name,
                "signal": str(applied),
                "rows": len(run),
                "rate": with_unit(run.rate, "Hz"),
                "hold": run.hold,
                "outputs": {
                    name: {
                        "peak": with_unit(peak, CHANNELS[name].unit) | {"time": with_unit(time, "s")},
                        "end": with_unit(end, CHANNELS[name].unit),
                    }
                    for name, (peak, time, end) in summary.items()
                },
                "warnings": told,
                "out": out,
            }
        )
        return
    rows = [
        [CHANNELS[name].name, read(peak, CHANNELS[name]), read(time, TIME), read(end, CHANNELS[name])]
        for name, (peak, time, end) in summary.items()
    ]
    print_table(["output", "peak", "at", "end"], rows, title=f"{model.name} under {applied}, {len(run)} rows")
    print_remarks(told, "warning")
    print(f"wrote {out}")


def _summary(run: Run, channel: str) -> tuple[float, float, float]:
    """The value of largest magnitude, its time [s], and the last value."""
    values: Any = run.channels[channel]
    sizes = abs(values)
    sizes[sizes != sizes] = -1.0  # no reading: the laser lost the strip
    row = int(sizes.argmax())
    return float(values[row]), float(run.time[row]), float(values[-1])
