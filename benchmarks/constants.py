"""What hangs on the numbers that are set by hand in a fit.

Run ``python -m benchmarks.constants [--rooms identification.noise,statespace] [--record]``; ``IPMCLAB_REAL_RUNS``
names the real records.
Every number that a module of these rooms (``ROOMS``) names in capitals is doubled and halved, one at a time (of
a probability near 1 what is missing to 1; a whole number stays at least 1), and the cases below are identified again.
A number on which no answer hangs is a matter of taste or of speed; what hangs on the others is written down here.

Cases: two real records (current, 5 s before to 30 s after the contact, two branches); friend-2 simulated, a step of
1 V and a sine of 0.1 Hz, current with white noise, with a drift, and as a random walk; its force with AR(1) noise, the
coupling free. Compared are the values in standard errors of the unchanged fit, what is called determined, the width of
the intervals, and the findings. The compiled loops keep their numbers and are not asked. Seed 20261123.

What was found is kept under ``build/`` as it is found: a call that is ended goes on where it was, as long as the
module of the number is what it was.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import importlib
import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import ipmclab
from benchmarks.harness import finish
from benchmarks.real_records import records
from benchmarks.trust import NOISES, draw
from benchmarks.wrong_model import FREE, cut_out

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/refitting",
    "src/ipmclab/measurement/random_effect.py",
    "src/ipmclab/prediction/open_coupling.py",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
)
SEED = 20261123
ROOT = Path(__file__).parents[1]
ROOMS = ("identification", "statespace", "refitting", "measurement/random_effect.py", "prediction/open_coupling.py")
COMPILED = ("kernels", "kernel")
"""Modules whose loops are compiled: what they name is part of the machine code."""
SHOWN = 0.1
"""Standard errors, and part of a width: a smaller change of an answer is none."""


@dataclass(frozen=True)
class Constant:
    """A number that is set by hand.

    Parameters
    ----------
    module, name : str
    what : str
        What the source says of it.
    """

    module: str
    name: str
    what: str


@dataclass(frozen=True)
class Effect:
    """What a changed number does: the largest over the cases."""

    moved: float = 0.0
    """Of a value [standard errors]."""
    width: float = 0.0
    """Of an interval, as the logarithm of the ratio of widths."""
    verdicts: int = 0
    """Parameters that are called determined with the one number and not with the other."""
    findings: tuple[str, ...] = ()
    failed: str = ""

    @property
    def shows(self) -> bool:
        return bool(self.moved > SHOWN or self.width > SHOWN or self.verdicts or self.findings or self.failed)

    def __str__(self) -> str:
        parts = [
            f"value {self.moved:.2g} s.e." if self.moved > SHOWN else "",
            f"width x {math.exp(self.width):.2g}" if self.width > SHOWN else "",
            f"{self.verdicts} verdicts" if self.verdicts else "",
            f"findings {', '.join(self.findings)}" if self.findings else "",
            f"fails: {self.failed}" if self.failed else "",
        ]
        return ", ".join(filter(None, parts)) or "-"


def constants() -> Iterator[Constant]:
    """Those of every module that is not compiled, in the order of the sources."""
    rooms = [ROOT / "src" / "ipmclab" / room for room in ROOMS]
    for path in (path for room in rooms for path in (sorted(room.rglob("*.py")) or [room])):
        if path.stem in COMPILED:
            continue
        text = path.read_text(encoding="utf-8")
        module = ".".join(path.relative_to(ROOT / "src").with_suffix("").parts)
        body = ast.parse(text).body
        for place, statement in enumerate(body):
            if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
                continue
            target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
            names = [one.id for one in ast.walk(target) if isinstance(one, ast.Name)]
            for name in names:
                if name.lstrip("_").isupper() and _is_number(importlib.import_module(module), name):
                    yield Constant(module, name, _said(text, statement, body[place + 1 : place + 2]))


def _is_number(module: Any, name: str) -> bool:
    value = getattr(module, name, None)
    values = value if isinstance(value, tuple) else (value,)
    return all(isinstance(one, int | float) and not isinstance(one, bool) for one in values) and bool(values)


def _said(text: str, statement: ast.stmt, following: list[ast.stmt]) -> str:
    if following and isinstance(following[0], ast.Expr) and isinstance(following[0].value, ast.Constant):
        said = following[0].value.value
        if isinstance(said, str):
            return " ".join(said.split()).rstrip(".")
    line = text.splitlines()[(statement.end_lineno or statement.lineno) - 1]
    return line.partition("  # ")[2]


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_scaled(one, factor) for one in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    if 0.5 < value < 1.0:  # part of a whole, or a probability
        return 1.0 - min(1.0 - value, 0.25) * factor
    return value * factor


def _taken_over(constant: Constant) -> Iterator[str]:
    """The modules that import a number by its name."""
    words = f"from {constant.module} import "
    for name, module in list(sys.modules.items()):
        path = getattr(module, "__file__", None)
        if name.startswith("ipmclab.") and path and hasattr(module, constant.name):
            for part in Path(path).read_text(encoding="utf-8").split(words)[1:]:
                taken = part[1:].partition(")")[0] if part.startswith("(") else part.partition("\n")[0]
                if constant.name in taken.replace(",", " ").split():
                    yield name


def with_changed(constant: Constant, factor: float, work: Callable[[], Any]) -> Any:
    """Do some work while a number is another one, in every module that took it over."""
    own = importlib.import_module(constant.module)
    before = getattr(own, constant.name)
    after = _scaled(before, factor)
    holders = [own, *(sys.modules[name] for name in _taken_over(constant))]
    for module in holders:
        setattr(module, constant.name, after)
    try:
        return work()
    finally:
        for module in holders:
            setattr(module, constant.name, before)


def cases() -> dict[str, Callable[[], ipmclab.Fit]]:
    """The fits that are asked."""
    two = ipmclab.load_actuator("friend-2")
    found: dict[str, Callable[[], ipmclab.Fit]] = {}

    def add(name: str, runs: list[ipmclab.Run], free: tuple[str, ...]) -> None:
        found[name] = lambda: ipmclab.identify(two, runs, free=free)

    real = records()
    for name in ("step_1V", "step_2V"):
        add(name, [cut_out(real[name], 30.0)], FREE)
    generator = np.random.default_rng(SEED)
    signals = ("step 1 V", "sine 1 V 0.1 Hz")
    clean = [ipmclab.simulate(two, signal, duration=40, rate=25) for signal in signals]
    for noise in (NOISES[0], *NOISES[2:]):
        runs = []
        for one in clean:
            assert one.current is not None
            current = one.current + 1e-4 * draw(noise, len(one), generator)
            runs.append(ipmclab.Run.from_arrays(time=one.time, voltage=one.voltage, current=current, hold=one.hold))
        add(noise, runs, ("electrical",))
    runs = []
    for one in clean:
        assert one.force is not None
        force = one.force + 2e-6 * draw(NOISES[1], len(one), generator)
        runs.append(ipmclab.Run.from_arrays(time=one.time, voltage=one.voltage, force=force, hold=one.hold))
    add(f"force, {NOISES[1]}", runs, ("coupling",))
    return found


@dataclass(frozen=True)
class Answer:
    """What is compared of a fit, by parameter; widths are of logarithms where an interval has both ends."""

    values: dict[str, float]
    errors: dict[str, float]
    widths: dict[str, float]
    determined: frozenset[str]
    findings: frozenset[str]


def asked(case: Callable[[], ipmclab.Fit]) -> Answer:
    """Identify, and take what is compared."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = case()
    rows = fit.parameters.values()
    widths = {
        one.name: one.interval[1] - one.interval[0] for one in rows if all(math.isfinite(end) for end in one.interval)
    }
    return Answer(
        {one.name: one.value for one in rows},
        {one.name: one.standard_error for one in rows},
        widths,
        frozenset(one.name for one in rows if one.determined),
        frozenset(one.code for one in fit.findings),
    )


def effect(before: Answer, after: Answer) -> Effect:
    """What changed from one answer to another."""
    moved = [
        abs(after.values[name] - before.values[name]) / before.errors[name]
        for name in before.determined
        if before.errors[name] > 0.0
    ]
    width = [
        abs(math.log(after.widths[name] / before.widths[name]))
        for name in before.determined & after.determined
        if before.widths.get(name, 0.0) > 0.0 and after.widths.get(name, 0.0) > 0.0
    ]
    return Effect(
        max(moved, default=0.0),
        max(width, default=0.0),
        len(before.determined ^ after.determined),
        tuple(sorted(before.findings ^ after.findings)),
    )


def _largest(effects: list[Effect]) -> Effect:
    return Effect(
        max(one.moved for one in effects),
        max(one.width for one in effects),
        max(one.verdicts for one in effects),
        tuple(sorted({code for one in effects for code in one.findings})),
        "; ".join(dict.fromkeys(one.failed for one in effects if one.failed)),
    )


def tried(
    constant: Constant, factor: float, fits: dict[str, Callable[[], ipmclab.Fit]], known: dict[str, Answer]
) -> Effect:
    """The largest effect over all cases."""
    effects = []
    for name, case in fits.items():
        try:
            effects.append(effect(known[name], with_changed(constant, factor, partial(asked, case))))
        except Exception as error:  # what a number breaks is what is asked here
            effects.append(Effect(failed=f"{name}: {type(error).__name__}"))
    return _largest(effects)


def _key(constant: Constant, factor: float) -> str:
    path = ROOT / "src" / Path(*constant.module.split(".")).with_suffix(".py")
    return hashlib.sha256(path.read_bytes() + f"{constant.name} {factor}".encode()).hexdigest()[:16]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--rooms",
        default="",
        help="rooms, such as identification.noise, separated by commas; all without",
    )
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/constants.md")
    options = parser.parse_args()
    rooms = tuple(f"ipmclab.{one}" for one in filter(None, options.rooms.split(",")))
    kept = ROOT / "build" / "constants.jsonl"
    kept.parent.mkdir(exist_ok=True)
    lines = kept.read_text().splitlines() if kept.exists() else []
    done = {one.pop("key"): one for one in map(json.loads, lines)}
    fits = cases()
    chosen = [one for one in constants() if not rooms or one.module.startswith(rooms)]
    known = {name: asked(case) for name, case in fits.items()}
    table: list[str] = []
    shown = 0
    for place, constant in enumerate(chosen):
        found = {}
        for factor in (2.0, 0.5):
            key = _key(constant, factor)
            if key not in done:
                done[key] = asdict(tried(constant, factor, fits, known))
                with kept.open("a") as file:
                    file.write(json.dumps({"key": key, **done[key]}) + "\n")
            found[factor] = Effect(**{**done[key], "findings": tuple(done[key]["findings"])})
        value = getattr(importlib.import_module(constant.module), constant.name)
        print(
            f"{place + 1} of {len(chosen)}: {constant.module} {constant.name}: {found[2.0]} | {found[0.5]}", flush=True
        )
        if any(one.shows for one in found.values()):
            shown += 1
            where = constant.module.removeprefix("ipmclab.")
            table.append(f"| {where} | {constant.name} | {value} | {constant.what} | {found[2.0]} | {found[0.5]} |")
    body = [
        f"{len(chosen)} numbers, each doubled and halved, {len(fits)} fits each. {shown} of them change an answer by "
        f"more than {SHOWN:g} standard errors or a tenth of a width, a verdict or a finding:",
        "",
        "| module | number | value | what it is | doubled | halved |",
        "|---|---|---|---|---|---|",
        *table,
    ]
    finish("constants", "Numbers set by hand", "\n".join(body), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
