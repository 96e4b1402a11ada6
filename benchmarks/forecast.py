"""Forecasts of four real step records of one strip, 10 s ahead, against simple ones.

Run ``python -m benchmarks.forecast [--record]``; ``IPMCLAB_REAL_RUNS`` names the folder of the records. Origins lie
every 2 s from 15 to 49 s after the contact. Settings are chosen on three records and reported on the fourth, in turn.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import finish
from benchmarks.real_records import NAMES, StepRecord, cut, records, strip
from ipmclab.identify import ForecastSettings, with_slow_modes
from ipmclab.identify.forecasting.forecast import prepare
from ipmclab.identify.forecasting.forecast_record import Prepared

Array = npt.NDArray[np.float64]

ORIGINS = np.arange(15.0, 50.0, 2.0)
HORIZON = 10.0
LEVEL = 0.8
SHORTEST, LONGEST, MODES = 0.4, 60.0, 9  # s, s: the slow modes of all four records

AMPLITUDES = (0.3e-3, 0.6e-3, 1.2e-3)  # m/V
MEMORIES = (0.3, 0.6, 1.0)  # s
SPANS = (2.0, 3.0, 4.0)  # s
TREND_MEMORIES = (0.5, 1.0, 2.0, 3.0, 5.0)  # s, of the damped local trend


@dataclass(frozen=True, eq=False)
class Case:
    """One origin of one record: what was seen, and what came."""

    prepared: Prepared
    came: Array
    last: Array
    crosses: bool
    """Whether the contact was open, or the rate jumped, between the origin and the horizon."""


@dataclass(frozen=True)
class Result:
    """Errors of all origins of one record.

    Parameters
    ----------
    error, at_end : float [m]
        Root mean square over all points, and 10 s ahead.
    clear : float [m]
        Over all points of the origins whose horizon crosses no jump.
    covered, width : float
        Share of the points in the band; mean width [m].
    likelihood : float
        Mean logarithm of the density, of displacement in mm.
    """

    error: float
    at_end: float
    clear: float
    covered: float = np.nan
    width: float = np.nan
    likelihood: float = np.nan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/forecast.md")
    options = parser.parse_args()
    found = records()
    body = "\n\n".join([forecasts(found), *_others(found)])
    finish("forecast", "Forecasts of four real records", body, [], record=options.record, gate=False)


def _others(found: Mapping[str, StepRecord]) -> list[str]:
    from benchmarks.real_leak import leak
    from benchmarks.real_shape import in_sample, jump

    return [in_sample(found), jump(found), leak(found)]


def forecasts(found: Mapping[str, StepRecord]) -> str:
    """The tables of skill and bands."""
    ours = {name: list(cases(record, with_model=True)) for name, record in found.items()}
    plain = {name: list(cases(record, with_model=False)) for name, record in found.items()}
    knowing = {name: list(cases(record, with_model=False, told=True)) for name, record in found.items()}
    told: dict[str, Result] = {}
    turns = {name: ours[name][0].prepared.drift[0] for name in NAMES}
    changes = {name: after(found[name]) - turns[name] for name in NAMES}

    results: dict[str, dict[str, Result]] = {}
    chosen: dict[str, ForecastSettings] = {}
    chosen_trend: dict[str, ForecastSettings] = {}
    for name in NAMES:
        others = [other for other in NAMES if other != name]
        chosen[name] = in_turn(name, ours, changes, Spread())
        trends = [ForecastSettings(memory=m, span=s) for m, s in itertools.product(TREND_MEMORIES, SPANS)]
        chosen_trend[name] = best(trends, [plain[other] for other in others])
        told[name] = bands(knowing[name], chosen_trend[name])
        results[name] = {
            "hold the last value": points(ours[name], lambda case: np.full(len(case.came), case.last[-1])),
            "extend the last 5 s": points(ours[name], extended),
            "damped local trend": bands(plain[name], chosen_trend[name]),
            "actuator": bands(ours[name], chosen[name]),
        }
    hold = {name: rules["hold the last value"].error for name, rules in results.items()}
    parts = [
        _skill(results),
        _bands(results, told),
        _settings(chosen, chosen_trend),
        _variants(found, ours, changes, hold),
    ]
    return "\n\n".join(parts)


def in_turn(
    name: str, of: Mapping[str, Sequence[Case]], changes: Mapping[str, float], spread: Spread
) -> ForecastSettings:
    """The settings that the records other than this one choose."""
    others = [other for other in NAMES if other != name]
    curl = float(np.sqrt(np.mean([changes[other] ** 2 for other in others])))
    grid = [
        ForecastSettings(amplitude=amplitude, memory=memory, span=span, curl=curl, settle=spread.settle)
        for amplitude, memory, span in itertools.product(AMPLITUDES, MEMORIES, SPANS)
    ]
    return best(grid, [of[other] for other in others])


def _variants(
    found: Mapping[str, StepRecord],
    ours: Mapping[str, Sequence[Case]],
    changes: Mapping[str, float],
    hold: Mapping[str, float],
) -> str:
    lines = [
        "## How much hangs on the structure",
        "",
        "Skill against holding the last value, and bands, where one thing is otherwise; settings chosen in turn again. "
        "`settle` is how long after the step readings are left out.",
        "",
        f"| | {' | '.join(NAMES)} | points within | width |",
        "|---|" + "---|" * (len(NAMES) + 2),
    ]
    for label, spread in VARIANTS.items():
        as_above = replace(spread, settle=Spread().settle) == Spread()  # settling is asked after preparing
        of = ours if as_above else {n: list(cases(r, with_model=True, spread=spread)) for n, r in found.items()}
        results = {name: bands(of[name], in_turn(name, of, changes, spread)) for name in NAMES}
        cells = [f"{1.0 - results[name].error / hold[name]:+.2f}" for name in NAMES]
        covered, width = (float(np.mean([getattr(r, key) for r in results.values()])) for key in ("covered", "width"))
        lines.append(f"| {label} | {' | '.join(cells)} | {100 * covered:.0f} % | {1e3 * width:.3f} mm |")
    return "\n".join(lines)


@dataclass(frozen=True)
class Spread:
    """The slow modes, and what is left out after the step: what was found while looking at all records [s]."""

    shortest: float = SHORTEST
    longest: float = LONGEST
    modes: int = MODES
    settle: float = 2.0


VARIANTS = {
    "settle 0.4 s": Spread(settle=0.4),
    "settle 1 s": Spread(settle=1.0),
    "settle 4 s": Spread(settle=4.0),
    "modes up to 120 s": Spread(longest=120.0),
    "5 modes": Spread(modes=5),
}


@cache
def circuit(record: StepRecord) -> ipmclab.Actuator:
    """The strip with the circuit that the current up to the first origin tells: it too knows only what came before."""
    early = cut(record, -2.0, float(ORIGINS[0]))
    return ipmclab.identify(strip(), [early], free=["electrical", "circuit.sheet_resistance"]).actuator


def cases(record: StepRecord, *, with_model: bool, told: bool = False, spread: Spread = Spread()) -> Sequence[Case]:
    """Every origin, with nothing prepared from what came after it; a trend knows findings only where it is told."""
    model = None
    if with_model:
        model = with_slow_modes(circuit(record), shortest=spread.shortest, longest=spread.longest, modes=spread.modes)
    run = record.run
    assert run.displacement is not None
    breaks = [
        run.time[row]
        for finding in ipmclab.check(run)
        if finding.code in ("contact-lost", "rate-jump")
        for pair in finding.samples
        for row in pair[:1]
    ]
    breaks += [run.time[stop] for f in ipmclab.check(run) if f.code == "contact-lost" for _, stop in f.samples]
    found = []
    for origin in run.time[record.contact] + ORIGINS:
        prepared = prepare(model, run, origin=float(origin), horizon=HORIZON)
        if not with_model and not told:
            prepared = replace(prepared, reopened=())
        row = int(np.searchsorted(run.time, prepared.origin + 1e-6))
        found.append(
            Case(
                prepared,
                run.displacement[row : row + len(prepared.ahead)],
                run.displacement[max(row - round(5.0 / 0.040), 0) : row],
                any(prepared.origin < time <= prepared.origin + HORIZON for time in breaks),
            )
        )
    return found


def after(record: StepRecord) -> float:
    """Drift from 20 to 60 s after the contact [m/s]: asked only of records that settings are chosen on."""
    rows = record.rows(20.0, 60.0)
    assert record.run.displacement is not None
    return float(np.polyfit(record.run.time[rows], record.run.displacement[rows], 1)[0])


def extended(case: Case) -> Array:
    """A straight line through the last 5 s."""
    period = 0.040
    line = np.polyfit(period * np.arange(1 - len(case.last), 1), case.last, 1)
    return np.polyval(line, case.prepared.ahead - case.prepared.origin)


def points(cases: Sequence[Case], rule: Callable[[Case], Array]) -> Result:
    """Errors of a forecast without bands."""
    return _result(cases, [rule(case) - case.came for case in cases])


def bands(cases: Sequence[Case], settings: ForecastSettings) -> Result:
    """Errors and bands of ours."""
    made = [case.prepared.forecast(settings, level=LEVEL) for case in cases]
    errors = [one.mean - case.came for one, case in zip(made, cases, strict=True)]
    inside = [(case.came > one.lower) & (case.came < one.upper) for one, case in zip(made, cases, strict=True)]
    sigma = 1e3 * np.array([one.standard_deviation for one in made])
    density = -0.5 * (1e3 * np.array(errors) / sigma) ** 2 - np.log(sigma) - 0.5 * np.log(2.0 * np.pi)
    return replace(
        _result(cases, errors),
        covered=float(np.mean(inside)),
        width=float(np.mean([one.upper - one.lower for one in made])),
        likelihood=float(np.mean(density)),
    )


def best(grid: Sequence[ForecastSettings], records_of: Sequence[Sequence[Case]]) -> ForecastSettings:
    """The settings with the largest sum of mean predictive log densities over records."""
    return max(grid, key=lambda settings: sum(bands(cases, settings).likelihood for cases in records_of))


def _result(cases: Sequence[Case], errors: Sequence[Array]) -> Result:
    every = np.array(errors)
    clear = every[[not case.crosses for case in cases]]
    return Result(rms(every), rms(every[:, -1]), rms(clear))


def rms(values: npt.ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _skill(results: Mapping[str, Mapping[str, Result]]) -> str:
    lines = [
        "## Skill",
        "",
        f"Root mean square error of displacement up to {HORIZON:g} s ahead, from {len(ORIGINS)} origins every 2 s, "
        f"{ORIGINS[0]:g} to {ORIGINS[-1]:g} s after the contact; in brackets the error of the point "
        f"{HORIZON:g} s ahead. **Skill** is one less the ratio of the error to that of another forecast: above 0 is "
        "better. Nothing read after an origin enters its forecast, nor the record's findings and circuit; the "
        "settings of a record were chosen on the other three.",
        "",
        "| record | hold the last value | extend the last 5 s | damped local trend | actuator |"
        " skill against holding | against extending | against the damped trend |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, rules in results.items():
        cells = [f"{1e3 * one.error:.4f} ({1e3 * one.at_end:.4f}) mm" for one in rules.values()]
        own = rules["actuator"].error
        skills = [
            f"{1.0 - own / rules[key].error:+.2f}"
            for key in ("hold the last value", "extend the last 5 s", "damped local trend")
        ]
        lines.append(f"| {name} | {' | '.join([*cells, *skills])} |")
    for name, rules in results.items():
        hold = rules["hold the last value"].error
        if min(one.error for one in rules.values()) >= hold:
            lines += ["", f"`{name}`: over all origins nothing beats holding the last value."]
        one = rules["actuator"]
        if one.clear != one.error:
            clear = ", ".join(f"{key} {1e3 * value.clear:.4f}" for key, value in rules.items())
            lines += ["", f"`{name}`, origins whose 10 s cross the open contact left out: {clear} mm."]
    return "\n".join(lines)


def _bands(results: Mapping[str, Mapping[str, Result]], told: Mapping[str, Result]) -> str:
    keys = ("damped local trend", "actuator")
    lines = [
        "## Bands",
        "",
        f"Share of the points within the {100 * LEVEL:g} % bands, and their mean width. The damped trend's strength "
        "is judged as ours, from its own misses on the record's past.",
        "",
        "| record | damped trend: within | width | actuator: within | width |",
        "|---|---|---|---|---|",
    ]
    rows = {name: [rules[key] for key in keys] for name, rules in results.items()}
    for name, pair in rows.items():
        lines.append(
            f"| {name} | " + " | ".join(f"{100 * one.covered:.0f} % | {1e3 * one.width:.3f} mm" for one in pair) + " |"
        )
    pooled = [
        (np.mean([pair[k].covered for pair in rows.values()]), np.mean([pair[k].width for pair in rows.values()]))
        for k in range(2)
    ]
    lines.append("| **all** | " + " | ".join(f"**{100 * c:.0f} %** | **{1e3 * w:.3f} mm**" for c, w in pooled) + " |")
    covered, width = (float(np.mean([getattr(one, key) for one in told.values()])) for key in ("covered", "width"))
    lines += [
        "",
        "The damped trend knows readings only. Told of the contact that came back in `step_1V`, as the actuator is, so "
        f"that its misses there do not count, its bands hold {100 * covered:.0f} % and are {1e3 * width:.3f} mm wide.",
    ]
    return "\n".join(lines)


def _settings(ours: Mapping[str, ForecastSettings], trend: Mapping[str, ForecastSettings]) -> str:
    lines = [
        "## Settings, chosen on the other three records",
        "",
        f"One structure for all: {MODES} slow modes from {SHORTEST:g} to {LONGEST:g} s, a drift, a disturbance. `curl` "
        "is the root mean square of how much the drifts of the other three changed at their steps; the others maximise "
        "the sum of mean predictive log densities over the other three, on a grid of "
        f"{len(AMPLITUDES)} x {len(MEMORIES)} x {len(SPANS)}. The kinds of terms, the spread of the modes and the grid "
        "were found while looking at all four records; only the numbers below were not.",
        "",
        "| record | amplitude | curl | memory | span | damped trend: memory | span |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, one in ours.items():
        assert one.amplitude is not None
        assert one.curl is not None
        other = trend[name]
        lines.append(
            f"| {name} | {1e3 * one.amplitude:g} mm/V | {1e6 * one.curl:.1f} µm/s | {one.memory:g} s | {one.span:g} s "
            f"| {other.memory:g} s | {other.span:g} s |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
