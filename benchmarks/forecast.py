"""Forecasts of four real step records of one strip, 10 and 30 s ahead, against holding and against a straight line.

Run ``python -m benchmarks.forecast [--record]``; ``IPMCLAB_REAL_RUNS`` names the folder of the records.
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import finish
from benchmarks.real_records import records, strip
from ipmclab import Actuator, Run
from ipmclab.forecasting import forecasters, past, stacking

SOURCES = ("src/ipmclab/forecasting", "src/ipmclab/model", "src/ipmclab/quality", "benchmarks/real_records.py")

Array = npt.NDArray[np.float64]

HORIZONS = (10.0, 30.0)
LEVEL = 0.8
PERIOD = 0.040  # s
LAST = 400.0  # s after the contact
MADE_UP = 24
SEED = 20261121

VARIED: Mapping[str, Sequence[tuple[object, str, Sequence[object]]]] = {
    "memory (horizons)": [(stacking, "MEMORY", (2.0, 8.0)), (forecasters, "MEMORY", (2.0, 8.0))],
    "settle (s)": [(past, "SETTLE", (1.0, 3.0))],
    "span of the line (s)": [(forecasters, "LINE_SPAN", (2.0, 10.0))],
    "drift time (s)": [(forecasters, "DRIFT_TIME", (30.0, 300.0))],
    "time constants (s)": [
        (forecasters, "TIME_CONSTANTS", ((3.0, 10.0, 30.0), (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)))
    ],
    "change (s)": [(forecasters, "CHANGE", (0.4, 2.0))],
    "growth of misses": [(stacking, "GROWTH", (0.5, 1.0))],
    "borrowed degrees of freedom": [(stacking, "BORROWED", (1.0, 2.0))],
}
"""Where each constant stands, and what else it might be."""


@dataclass(frozen=True, eq=False)
class Record:
    """A record, the row at which the strip first sees the voltage, and the last row with a reading."""

    run: Run
    contact: int
    last: int


@dataclass(frozen=True)
class Result:
    """Of one record and horizon: root mean square errors [m], also at the horizon alone, and the bands."""

    errors: tuple[float, float, float]
    at_end: tuple[float, float, float]
    covered: float
    width: float

    @property
    def skills(self) -> tuple[float, float]:
        """Against holding and against the line."""
        own, hold, line = self.errors
        return 1.0 - own / hold, 1.0 - own / line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/forecast.md")
    options = parser.parse_args()
    found = {
        name: Record(one.run, one.contact, int(np.flatnonzero(one.usable("displacement"))[-1]))
        for name, one in records().items()
    }
    body = "\n\n".join([_tables(found), _constants(found), _made_up(found)])
    finish("forecast", "Forecasts of four real records", body, [], record=options.record, gate=False)


def early(_: Record) -> Array:
    """Every 2 s, 15 to 49 s after the contact."""
    return np.arange(15.0, 50.0, 2.0)


def whole(record: Record) -> Array:
    """Along the record, from 15 s after the contact to 30 s before its end, or 400 s."""
    end = min(PERIOD * (record.last - record.contact) - max(HORIZONS), LAST)
    return np.arange(15.0, end, 5.0 if end < 100.0 else 20.0)


def tried(record: Record, origins: Array, horizon: float, model: Actuator | None) -> Result:
    """Forecasts with default settings from some origins [s after the contact], and the two simple ones."""
    run = record.run
    assert run.displacement is not None
    errors: list[list[Array]] = [[], [], []]
    inside, width = [], []
    for since in origins:
        row = record.contact + round(since / PERIOD)
        if row + round(horizon / PERIOD) > record.last:
            continue
        made = ipmclab.forecast(model, run, origin=float(run.time[row]), horizon=horizon, level=LEVEL)
        came = run.displacement[row + 1 : row + 1 + len(made.time)]
        came = np.where(np.abs(came) < 0.09, came, np.nan)  # the laser's sentinel
        seen = slice(max(row + 1 - round(5.0 / PERIOD), 0), row + 1)
        line = np.polyfit(run.time[seen] - made.origin, run.displacement[seen], 1)
        rules = made.mean, np.full(len(came), run.displacement[row]), np.polyval(line, made.time - made.origin)
        for kept, rule in zip(errors, rules, strict=True):
            kept.append(rule - came)
        inside.append(np.mean(((came > made.lower) & (came < made.upper))[np.isfinite(came)]))
        width.append(np.mean(made.upper - made.lower))
    rms = [float(np.sqrt(np.nanmean(np.square(kept)))) for kept in errors]
    end = [float(np.sqrt(np.nanmean([one[-1] ** 2 for one in kept]))) for kept in errors]
    return Result((rms[0], rms[1], rms[2]), (end[0], end[1], end[2]), float(np.mean(inside)), float(np.mean(width)))


Origins = Callable[[Record], Array]
Key = tuple[str, float, str]


def results(found: Mapping[str, Record], model: Actuator | None, which: Sequence[Origins]) -> dict[Key, Result]:
    """By origins, horizon and record."""
    return {
        (origins.__name__, horizon, name): tried(record, origins(record), horizon, model)
        for origins in which
        for horizon in HORIZONS
        for name, record in found.items()
    }


def _tables(found: Mapping[str, Record]) -> str:
    lines = [
        "## Skill and bands",
        "",
        "Default settings. Root mean square error of displacement up to the horizon, in brackets at the horizon. "
        "**Skill** is one less the ratio of the error to that of another forecast: above 0 is better. `early`: 18 "
        "origins every 2 s, 15 to 49 s after the contact; `whole`: every 20 s (5 s in records shorter than 130 s) "
        f"from 15 s after the contact to 30 s before the last reading, at most {LAST:g} s. Nothing read after an "
        "origin enters its forecast. Without an actuator; then with one of another strip (`friend-2` with the "
        "dimensions of this one, nothing fitted). Pooled: errors of each record over those of holding (of the line), "
        "squared and averaged.",
    ]
    for label, model in {"Without an actuator": None, "With the actuator of another strip": strip()}.items():
        lines += [
            "",
            f"### {label}",
            "",
            "| origins | ahead | record | hold | line | forecast | skill against holding | against the line "
            f"| points in the {100 * LEVEL:g} % band | width |",
            "|---|---|---|---|---|---|---|---|---|---|",
        ]
        made = results(found, model, (early, whole))
        for (origins, horizon, name), one in made.items():
            own, hold, line = (
                f"{1e3 * error:.4f} ({1e3 * end:.4f}) mm" for error, end in zip(one.errors, one.at_end, strict=True)
            )
            against = " | ".join(f"{skill:+.2f}" for skill in one.skills)
            lines.append(
                f"| {origins} | {horizon:g} s | {name} | {hold} | {line} | {own} | {against} "
                f"| {100 * one.covered:.0f} % | {1e3 * one.width:.3f} mm |"
            )
        for origins in (early, whole):
            for horizon in HORIZONS:
                of = [one for (which, ahead, _), one in made.items() if (which, ahead) == (origins.__name__, horizon)]
                lines.append(
                    f"| **{origins.__name__}** | **{horizon:g} s** | **pooled** | | | | "
                    + " | ".join(f"**{skill:+.2f}**" for skill in pooled(of))
                    + f" | **{100 * np.mean([one.covered for one in of]):.0f} %** | |"
                )
    return "\n".join(lines)


def pooled(of: Sequence[Result]) -> tuple[float, float]:
    """Skill over records that count alike."""
    hold, line = (
        1.0 - float(np.sqrt(np.mean([(one.errors[0] / one.errors[other]) ** 2 for one in of]))) for other in (1, 2)
    )
    return hold, line


@contextlib.contextmanager
def instead(places: Sequence[tuple[object, str, Sequence[object]]], turn: int) -> Iterator[None]:
    """A constant with another value, wherever it is read."""
    before = [getattr(module, name) for module, name, _ in places]
    for module, name, values in places:
        setattr(module, name, values[turn])
    try:
        yield
    finally:
        for (module, name, _), value in zip(places, before, strict=True):
            setattr(module, name, value)


def _constants(found: Mapping[str, Record]) -> str:
    lines = [
        "## How much hangs on the constants",
        "",
        "One constant otherwise at a time, for all records alike, without an actuator: mean over `early` and `whole`, "
        "10 and 30 s ahead, of the skill against holding of each record; the least of all skills against holding and "
        "against the line; points in the bands. In the last column, for each record in turn, what the other three "
        "would choose by their mean skill (a: as it is).",
        "",
        f"| constant | value | {' | '.join(found)} | least, holding | least, line | in the bands | others' choice |",
        "|---|---|" + "---|" * (len(found) + 4),
    ]
    as_it_is = results(found, None, (early, whole))
    lines.append(f"| as it is | | {_row(found, as_it_is)} | |")
    for label, places in VARIED.items():
        values = places[0][2]
        made = []
        for turn in range(len(values)):
            with instead(places, turn):
                made.append(results(found, None, (early, whole)))
        tried_ones = {"a": as_it_is, **{_shown(value): one for value, one in zip(values, made, strict=True)}}
        choice = ", ".join(
            max(tried_ones, key=lambda key: float(np.mean([_mean(tried_ones[key], other) for other in others])))
            for others in ([other for other in found if other != name] for name in found)
        )
        for turn, value in enumerate(values):
            lines.append(f"| {label} | {_shown(value)} | {_row(found, made[turn])} | {choice if turn == 0 else ''} |")
    return "\n".join(lines)


def _shown(value: object) -> str:
    return ", ".join(f"{one:g}" for one in value) if isinstance(value, tuple) else f"{value:g}"


def _mean(made: Mapping[Key, Result], name: str) -> float:
    return float(np.mean([one.skills[0] for (_, _, record), one in made.items() if record == name]))


def _row(found: Mapping[str, Record], made: Mapping[Key, Result]) -> str:
    least = [min(one.skills[place] for one in made.values()) for place in range(2)]
    means = [f"{_mean(made, name):+.2f}" for name in found]
    covered = 100.0 * float(np.mean([one.covered for one in made.values()]))
    return " | ".join([*means, *(f"{one:+.2f}" for one in least), f"{covered:.0f} %"])


def _made_up(found: Mapping[str, Record]) -> str:
    lines = [
        "## Records that nobody looked at",
        "",
        f"{MADE_UP} sums of two of the records, drawn at random: each runs 0.6 to 1.65 times as fast, has either sign, "
        "and 0.3 to 1 times its range over the first 60 s. Origins `early`, without an actuator. `step_1V` is told "
        "apart: the jump as its contact comes back, which nothing foresees, is then ahead of the earliest origins.",
        "",
        "| of | ahead | mean skill against holding | least | below -0.1 | against the line | least | below -0.1 "
        "| in the band |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for label, names in {
        "the other three": [name for name in found if name != "step_1V"],
        "all four": list(found),
    }.items():
        generator = np.random.default_rng(SEED)
        sums = [_sum(found, names, generator) for _ in range(MADE_UP)]
        for horizon in HORIZONS:
            made = [tried(one, early(one), horizon, None) for one in sums]
            cells = []
            for place in range(2):
                skills = np.array([one.skills[place] for one in made])
                cells.append(f"{skills.mean():+.2f} | {skills.min():+.2f} | {np.sum(skills < -0.1)} of {len(made)}")
            covered = 100.0 * np.mean([one.covered for one in made])
            lines.append(f"| {label} | {horizon:g} s | {' | '.join(cells)} | {covered:.0f} % |")
    return "\n".join(lines)


def _sum(found: Mapping[str, Record], names: Sequence[str], generator: np.random.Generator) -> Record:
    """Two records as one, from 5 s before the contact to 85 s after it."""
    time = PERIOD * np.arange(round(90.0 / PERIOD))
    read = np.zeros(len(time))
    for name in generator.choice(len(names), 2, replace=False):
        record = found[names[name]]
        assert record.run.displacement is not None
        speed, share = float(np.exp(generator.uniform(-0.5, 0.5))), generator.uniform(0.3, 1.0)
        own = np.interp(
            speed * (time - 5.0),
            record.run.time[: record.last] - record.run.time[record.contact],
            record.run.displacement[: record.last],
        )
        first = (time >= 5.0) & (time < 65.0)
        read += generator.choice([-1.0, 1.0]) * share * (own - own[0]) / np.ptp(own[first])
    run = Run.from_arrays(time=time, voltage=np.where(time >= 5.0, 2.0, 0.0), displacement=1e-3 * read)
    return Record(run, round(5.0 / PERIOD), len(time) - 1)


if __name__ == "__main__":
    main()
