"""Whether anything but an answer or a refusal comes of a record: drawn records through every function that fits.

Run ``python -m benchmarks.fuzz [--records 2000] [--first 0] [--minutes 60] [--record]``. A record is a simulated one
that is made short, constant, tiny, huge, quantised, gappy or uneven, often several of these at once. Every record goes
through ``check``, ``measure``, ``identify`` and ``validate``; one function more, in turn, sees it too: ``choose``,
``forecast``, ``follow_procedure``, ``profile``, ``bootstrap``, ``leave_one_run_out``, ``sample_posterior``,
``identifiability``. What comes back must be an answer without a nan given as a value, or a refusal that says what
to do instead; an exception of another kind, or a warning, is a fault. Seed 20261121.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from time import monotonic
from typing import Any, Final

import numpy as np
import numpy.typing as npt

import ipmclab
from benchmarks.harness import finish
from ipmclab import IpmclabError, Run
from ipmclab.measurement.uncertain import exact
from ipmclab.procedure.procedure import Procedure

SOURCES = ("src/ipmclab",)
SEED: Final = 20261121
Array = npt.NDArray[np.float64]

_SIGNALS: Final = (
    "step 1 V",
    "sine 1 V 0.5 Hz",
    "square 1 V 0.5 Hz",
    "prbs 1 V 0.2 s",
    "chirp 1 V 0.1 Hz 2 Hz",
)
_CHANNELS: Final = (("current",), ("current", "displacement"), ("current", "force"), ("displacement",), ("force",))
_NOISE: Final = {"current": 1e-4, "displacement": 2e-6, "force": 1e-5}


def draw(number: int) -> tuple[Run, str]:
    """A record, and what was done to it."""
    generator = np.random.default_rng([SEED, number])
    rows = int(generator.choice([2, 3, 5, 8, 13, 20, 40, 100, 300]))
    rate = float(generator.choice([5.0, 20.0, 100.0]))
    signal = str(generator.choice(_SIGNALS))
    if signal.startswith("step"):
        signal += f" delay={rows // 4 / rate:g} s"
    if signal.startswith("chirp"):
        signal += f" for {max(rows, 2) / rate!r} s"
    strip = ipmclab.load_actuator("friend-2")
    clean = ipmclab.simulate(strip, signal, duration=max(rows, 2) / rate, rate=rate)
    time, voltage = clean.time.copy(), clean.voltage.copy()
    channels = {
        name: clean.channels[name] + _NOISE[name] * generator.standard_normal(len(time))
        for name in _CHANNELS[int(generator.integers(len(_CHANNELS)))]
    }
    done = [f"{rows} rows of {signal} at {rate:g} Hz, {'+'.join(channels)}"]
    for change in generator.choice(list(_CHANGES), size=int(generator.integers(1, 4)), replace=False):
        time, voltage, channels = _CHANGES[change](generator, time, voltage, channels)
        done.append(str(change))
    return replace(Run.from_arrays(time=time, voltage=voltage), **channels), ", ".join(done)


Changed = tuple[Array, Array, dict[str, Array]]
Change = Callable[[np.random.Generator, Array, Array, dict[str, Array]], Changed]


def _one(generator: np.random.Generator, channels: Mapping[str, Array]) -> str:
    return str(generator.choice(list(channels)))


def _as_it_is(_: np.random.Generator, time: Array, voltage: Array, channels: dict[str, Array]) -> Changed:
    return time, voltage, channels


def _constant(generator: np.random.Generator, time: Array, voltage: Array, channels: dict[str, Array]) -> Changed:
    name = _one(generator, channels)
    level = float(generator.choice([0.0, channels[name][0], 1e-3]))
    return time, voltage, channels | {name: np.full(len(time), level)}


def _held(generator: np.random.Generator, time: Array, _: Array, channels: dict[str, Array]) -> Changed:
    return time, np.full(len(time), float(generator.choice([0.0, 1.0, -2.0]))), channels


def _scaled(smallest: float, largest: float) -> Change:
    def change(generator: np.random.Generator, time: Array, voltage: Array, channels: dict[str, Array]) -> Changed:
        factor = 10.0 ** float(generator.uniform(smallest, largest))
        if generator.random() < 0.3:
            return time, voltage * factor, channels
        name = _one(generator, channels)
        return time, voltage, channels | {name: channels[name] * factor}

    return change


def _quantised(generator: np.random.Generator, time: Array, voltage: Array, channels: dict[str, Array]) -> Changed:
    name = _one(generator, channels)
    step = max(float(np.ptp(channels[name])) / float(generator.choice([1.0, 2.0, 5.0, 20.0])), 1e-12)
    return time, voltage, channels | {name: np.round(channels[name] / step) * step}


def _gappy(generator: np.random.Generator, time: Array, voltage: Array, channels: dict[str, Array]) -> Changed:
    name = _one(generator, channels)
    gone = generator.random(len(time)) < float(generator.uniform(0.05, 1.0))
    return time, voltage, channels | {name: np.where(gone, np.nan, channels[name])}


def _uneven(generator: np.random.Generator, time: Array, voltage: Array, channels: dict[str, Array]) -> Changed:
    steps = np.diff(time) * np.exp(float(generator.choice([0.01, 0.5, 2.0])) * generator.standard_normal(len(time) - 1))
    return np.append(0.0, np.cumsum(steps)), voltage, channels


def _spiked(generator: np.random.Generator, time: Array, voltage: Array, channels: dict[str, Array]) -> Changed:
    name = _one(generator, channels)
    values = channels[name].copy()
    values[int(generator.integers(len(values)))] = float(10.0 ** generator.uniform(-2.0, 8.0))
    return time, voltage, channels | {name: values}


_CHANGES: Final[Mapping[str, Change]] = {
    "as it is": _as_it_is,
    "constant": _constant,
    "voltage held": _held,
    "tiny": _scaled(-20.0, -3.0),
    "huge": _scaled(3.0, 20.0),
    "quantised": _quantised,
    "gappy": _gappy,
    "uneven": _uneven,
    "a spike": _spiked,
}


def _free(run: Run) -> str:
    return "electrical" if "current" in run.channels else "coupling"


def calls(run: Run, number: int) -> Iterator[tuple[str, Callable[[], object]]]:
    """What is done with a record, each by its name; a fit that was made is used by those that need one."""
    friend = ipmclab.load_actuator("friend-2")
    free = _free(run)
    made: list[Any] = []

    def fit() -> Any:
        made.append(ipmclab.identify(friend, run, free=free))
        return made[-1]

    def two() -> Any:
        return ipmclab.leave_one_run_out(ipmclab.identify(friend, [run, draw(number + 1)[0]], free=free))

    yield "check", lambda: ipmclab.check(run)
    yield "measure", lambda: ipmclab.measure(run)
    yield "identify", fit
    yield "validate", lambda: ipmclab.validate(friend, run)
    middle = float(0.5 * (run.time[0] + run.time[-1]))
    rest: dict[str, Callable[[], object]] = {
        "choose": lambda: ipmclab.choose([run], "friend-2,friend-2+branches=1", free=free),
        "forecast": lambda: ipmclab.forecast(friend, run, origin=middle, horizon=1.0, channel=next(iter(run.channels))),
        "follow_procedure": lambda: ipmclab.follow_procedure(_procedure(run), all_at_once=False),
        "identifiability": lambda: ipmclab.identifiability(friend, free=free, outputs=tuple(run.channels)),
        "leave_one_run_out": two,
    }
    if made:
        rest |= {
            "profile": lambda: ipmclab.profile(made[0]),
            "bootstrap": lambda: ipmclab.bootstrap(made[0], 20),
            "sample_posterior": lambda: ipmclab.sample_posterior(made[0], steps=20),
        }
    name = list(rest)[number % len(rest)]
    yield name, rest[name]


def _procedure(run: Run) -> Procedure:
    friend = ipmclab.load_actuator("friend-2")
    lengths = {name: exact(friend[name]) for name in friend.parameter_values if name.startswith("geometry.")}
    return Procedure("drawn", lengths, dc_resistance=(("a", run),), branches=(("a", run),), coupling=(("a", run),))


def fault(call: Callable[[], object]) -> str | None:
    """What went wrong; None where it was answered, or refused with what to do instead."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            answer = call()
        except IpmclabError as refused:
            if "ended in" in str(refused):
                return f"refused for a fault of its own: {refused}"
            return None if refused.repair else f"refused without a repair: {refused}"
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)
            own = [frame for frame in place if "ipmclab" in frame.filename] or list(place)
            return f"{type(error).__name__}: {error} ({own[-1].filename.split('ipmclab/')[-1]}:{own[-1].lineno})"
    where = nan_in(answer)
    if where:
        return f"nan given as {where}"
    rows = answer.parameters.values() if isinstance(answer, ipmclab.Fit) else ()
    open_ones = [one.name for one in rows if one.determined and {*map(abs, one.interval)} <= {0.0, math.inf}]
    return f"called determined with an open interval: {', '.join(open_ones)}" if open_ones else None


def nan_in(answer: object, where: str = "answer", depth: int = 6) -> str | None:
    """Where an answer holds a nan as a value; None where it holds none.

    Records may have gaps, and there is no correlation with what is open: neither is a value that is given.
    """
    if isinstance(answer, float):
        return where if math.isnan(answer) else None
    if depth == 0 or isinstance(answer, Run | ipmclab.Actuator | str | bytes | type) or callable(answer):
        return None
    parts: Iterator[tuple[str, object]] = iter(())
    if isinstance(answer, Mapping):
        parts = ((f"{where}[{key}]", value) for key, value in answer.items())
    elif isinstance(answer, tuple | list):
        parts = ((f"{where}[{place}]", value) for place, value in enumerate(answer))
    elif dataclasses.is_dataclass(answer):
        parts = (
            (f"{where}.{field.name}", getattr(answer, field.name))
            for field in dataclasses.fields(answer)
            if field.repr and field.name != "correlations"
        )
    return next((found for name, value in parts if (found := nan_in(value, name, depth - 1))), None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="the number of the first record")
    parser.add_argument("--minutes", type=float, default=math.inf, help="after which no record is drawn")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/fuzz.md")
    options = parser.parse_args()
    asked: Counter[str] = Counter()
    wrong: dict[str, list[str]] = {}
    end = monotonic() + 60.0 * options.minutes
    last = options.first - 1
    for number in range(options.first, options.first + options.records):
        if monotonic() > end:
            break
        last = number
        run, done = draw(number)
        for name, call in calls(run, number):
            asked[name] += 1
            found = fault(call)
            if found:
                wrong.setdefault(name, []).append(f"record {number} ({done}): {found}")
                print(f"{name}: {wrong[name][-1]}", flush=True)
    drawn = last + 1 - options.first
    lines = [f"{drawn} records, number {options.first} to {last}; asked were {options.records}.", ""]
    lines += ["| function | records | faults |", "|---|---|---|"]
    lines += [f"| {name} | {count} | {len(wrong.get(name, ()))} |" for name, count in asked.items()]
    told = [f"* {name}: {one}" for name, faults in wrong.items() for one in faults]
    lines += ["", "## Faults", "", *(told or ["None."])]
    finish("fuzz", "Drawn records: an answer or a refusal", "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
