"""``ipmclab simulate``: what an actuator does under a signal."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.files import actuator_files, check_output
from ipmclab.cli.options import ActuatorName, Force, Json, positive
from ipmclab.cli.output import (
    print_json,
    print_paragraph,
    print_remarks,
    print_table,
    progress,
    read,
    significant,
    with_unit,
)
from ipmclab.errors import InputError, unknown_name
from ipmclab.units import CHANNELS, FREQUENCY, TIME, Quantity, parse_quantity

if TYPE_CHECKING:
    from ipmclab.model import Actuator
    from ipmclab.model.environment import Environment, EnvironmentHistory
    from ipmclab.prediction.answer import SureAnswer
    from ipmclab.run import Hold, Run

HOLDS: Final[tuple[Hold, ...]] = ("zero", "zero-before", "first")

Ends = tuple[float, float]


def simulate(
    actuator: ActuatorName,
    signal: Annotated[str, typer.Option(metavar="TEXT", help='For example "step 1 V" or "sine 1 V 0.1 Hz".')],
    duration: Annotated[str, typer.Option(metavar="TIME", help='For example "40 s".')],
    rate: Annotated[str, typer.Option(metavar="FREQUENCY", help='Rows a second, for example "50 Hz".')],
    out: Annotated[Path, typer.Option(metavar="FILE.nc", help="The run to write.")],
    hold: Annotated[
        str,
        typer.Option(
            metavar="|".join(HOLDS),
            help="What the voltage does between two rows. zero: it has the value of the first one. zero-before: it has "
            "that of the second one. first: a straight line.",
        ),
    ] = "zero",
    environment: Annotated[
        str | None,
        typer.Option(
            "--environment",
            "--at",
            metavar="TEXT",
            help='The air around a strip whose file has laws: "25 degC, 45 %RH" or "25 degC, in water"; several with '
            'their times, straight lines between them, "0 s: 20 degC, 80 %RH; 5 min: 20 degC, 50 %RH"; or a run (.nc) '
            "whose air was read.",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Simulate what an actuator answers to a voltage, and write the run; of a fitted one, with its uncertainty.

    \b
    ipmclab simulate friend-2 --signal "step 1 V" --duration "40 s" --rate "50 Hz" --out step.nc
    """
    from ipmclab import load_actuator, signals, write_run
    from ipmclab.model.left_open import open_sentence
    from ipmclab.model.simulate import simulate as simulate_actuator
    from ipmclab.model.validity import sentence

    if hold not in HOLDS:
        raise unknown_name("hold", hold, HOLDS, where="--hold")
    seconds = positive(duration, TIME, option="--duration")
    hertz = positive(rate, FREQUENCY, option="--rate")
    applied = signals.parse(signal)
    parts = applied.signals if isinstance(applied, signals.Sequence) else (applied,)
    played = [one.path for one in parts if isinstance(one, signals.Samples)]
    air = None if environment is None else _environment(environment)
    read_from = [Path(environment)] if environment is not None and environment.endswith(".nc") else []
    check_output(out, force=force, suffixes=(".nc",), reads=[*actuator_files(actuator), *played, *read_from])
    model = load_actuator(actuator)
    with progress(f"simulating {model.name}"):
        strip = model if model.fit_table is None else _as_it_is_now(model)
        run = simulate_actuator(strip, applied, duration=seconds, rate=hertz, hold=hold, environment=air)
        changes = run.time_environment is not None
        sure = None if changes else _sureness(model, run, actuator)
        write_run(run, out, overwrite=force)

    sentences = [sentence(finding) for finding in run.metadata.findings]
    if doubt := open_sentence(model):
        sentences.append(doubt)
    if changes and model.fit_table is not None:
        sentences.append(
            "how sure this answer is, is known for constant environments only; simulate one of them for its interval"
        )
    peaks = {name: _peak(run, name) for name in run.channels if name != "voltage"}
    if as_json:
        print_json(
            {
                "actuator": model.name,
                "signal": str(applied),
                "rows": len(run),
                "rate": with_unit(run.rate, "Hz"),
                "hold": run.hold,
                **({} if environment is None else {"environment": _air_of(run)}),
                "outputs": {
                    name: {
                        "peak": with_unit(float(run.channels[name][row]), CHANNELS[name].unit)
                        | {"time": with_unit(float(run.time[row]), "s")}
                        | _intervals(sure, run, name, row),
                        "end": with_unit(float(run.channels[name][-1]), CHANNELS[name].unit)
                        | _intervals(sure, run, name, -1),
                    }
                    for name, row in peaks.items()
                },
                **({} if sure is None else {"fit": _document(sure)}),
                "warnings": sentences,
                "out": out,
            }
        )
        return
    rows = []
    for name, row in peaks.items():
        values, quantity = run.channels[name], CHANNELS[name]
        peak, time = read(float(values[row]), quantity), read(float(run.time[row]), TIME)
        rows.append([quantity.name, peak, time, read(float(values[-1]), quantity)])
    where = "" if environment is None else f" at {_environment_text(environment)}"
    print_table(["output", "peak", "at", "end"], rows, title=f"{model.name} under {applied}{where}, {len(run)} rows")
    if run.metadata.water_content is not None:
        print(f"water content as the run begins: {significant(run.metadata.water_content, 4)}")
    if sure is not None:
        _print_sureness(sure, run, peaks)
    print_remarks(sentences, "warning")
    print(f"wrote {out}")


def _environment(text: str) -> Environment | EnvironmentHistory:
    """The environment that the option names."""
    from ipmclab import read_run
    from ipmclab.model.environment import Environment, EnvironmentHistory

    if text.endswith(".nc"):
        return EnvironmentHistory.of_run(read_run(Path(text)))
    if ":" not in text:
        return Environment.parse(text, where="--environment")
    points = []
    for part in filter(None, (piece.strip() for piece in text.split(";"))):
        time, colon, air = part.partition(":")
        if not colon:
            raise InputError(
                f"{part!r} has no time",
                code="bad-environment",
                where="--environment",
                repair="write for example '5 min: 20 degC, 50 %RH'",
            )
        points.append(
            (parse_quantity(time, TIME, where="--environment"), Environment.parse(air, where="--environment"))
        )
    return EnvironmentHistory.of(points)


def _environment_text(text: str) -> str:
    """An environment as the title of a table says it."""
    return "an environment that changes" if ":" in text or text.endswith(".nc") else text


def _air_of(run: Run) -> dict[str, Any]:
    """The environment of a run, for a JSON document."""
    about = run.metadata
    return {
        "temperature": None if about.temperature is None else with_unit(about.temperature, "degC"),
        "relative_humidity": None if about.relative_humidity is None else with_unit(about.relative_humidity, "percent"),
        "water_content": about.water_content,
        "water_content_origin": about.water_content_origin,
    }


def _peak(run: Run, channel: str) -> int:
    """The row of the value of largest magnitude."""
    sizes: Any = abs(run.channels[channel])
    sizes[sizes != sizes] = -1.0  # no reading: the laser lost the strip
    return int(sizes.argmax())


def _sureness(model: Actuator, run: Run, named: str) -> SureAnswer | None:
    """What a fit says of the answer; the rest of the program is not loaded for an actuator without one."""
    if model.fit_table is None and "+" not in named:
        return None
    from ipmclab.prediction.answer import sure_answer

    return sure_answer(model, run, named=named)


def _as_it_is_now(model: Actuator) -> Actuator:
    """A fitted strip after the last run of its fit, where something of it ages."""
    from ipmclab.prediction.in_state import as_it_is_now

    return as_it_is_now(model)


def _intervals(sure: SureAnswer | None, run: Run, output: str, row: int) -> dict[str, Ends | None]:
    """Where the strip's answer, a reading of it, and the answer at the next mounting lie with 95 % [SI]."""
    if sure is None:
        return {}
    value = float(run.channels[output][row])

    def ends(bands: Any, of_readings: bool) -> Ends | None:
        if bands is None or output not in bands.predicted:
            return None
        reach = float(bands.reach(output, of_readings=of_readings)[row])
        return value - reach, value + reach

    return {
        "interval": ends(sure.here, False),
        "interval_of_reading": ends(sure.here, True),
        "interval_next_mounting": ends(sure.following, False),
    }


def _document(sure: SureAnswer) -> dict[str, Any]:
    """What is next to the intervals in a JSON document."""
    return {
        "level": 0.95,
        "why_no_interval": sure.why_none or None,
        "mountings": sure.mountings,
        "left_out": some.left_out if (some := sure.here or sure.following) is not None else (),
        "not_read": sure.not_read,
        "next_mounting_unknown": sure.next_mounting_unknown or None,
        "warnings": sure.warnings,
    }


def _print_sureness(sure: SureAnswer, run: Run, peaks: dict[str, int]) -> None:
    columns = {"interval": "of the answer", "interval_of_reading": "of a reading"} if sure.here is not None else {}
    if sure.following is not None:
        columns["interval_next_mounting"] = "at the next mounting"
    some = sure.here or sure.following
    rows = []
    for name in some.predicted if some is not None else ():
        quantity = CHANNELS[name]
        for row in dict.fromkeys((peaks[name], len(run) - 1)):
            found = _intervals(sure, run, name, row)
            ends = [_ends(found[key], quantity) for key in columns]
            rows.append([quantity.name, read(float(run.time[row]), TIME), *ends])
    if rows:
        print_table(["95 % interval", "at", *columns.values()], rows)
    for sentence in sure.sentences():
        print_paragraph(sentence)


def _ends(interval: Ends | None, quantity: Quantity) -> str:
    """An interval with three digits of its width."""
    if interval is None or not all(map(math.isfinite, interval)):
        return "-"
    low, high = (quantity.to_display(end) for end in interval)
    largest, width = max(abs(low), abs(high)), high - low
    digits = min(max(3 + math.ceil(math.log10(largest / width)), 3), 9) if width > 1e-9 * largest else 6
    return f"{significant(low, digits)} to {significant(high, digits)} {quantity.display_unit}"
