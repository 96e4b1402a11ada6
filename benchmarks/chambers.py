"""Chambers that fail at drawn moments: ``python -m benchmarks.chambers [--faults 200] [--at-once 16] [--record]``.

Each is a whole experiment in real time: a chamber is set, waited for, kept still while a run is recorded, and brought
to standby. The strip is virtual; the chamber is an emulated instrument at a socket or a pseudo-terminal of this
computer, spoken to by its own driver. At a drawn moment one thing goes wrong with the line or with the instrument, for
one answer or for good. Then the experiment is held against this:

* the strip is at 0 V at its end, and the experiment ended by itself or with a reason;
* no call of the chamber took longer than 30 s, and no more than 30 s passed between the fault (for one that sleeps, the
  first call that met it) and the end, where it ended for it; the making of the run's file is not counted;
* the chamber regulated to nothing but what the experiment asked for, or what somebody else set in the fault itself;
* at the end it is in standby, or it was said that it could not be brought there: its own state is held against what
  was said;
* once the fault is over, a new driver brings it to standby, as the keeper does.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Timer, local
from typing import Any

import numpy as np

from benchmarks.harness import finish
from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import Block
from ipmclab.rig.chambers.chamber import DEADLINE, Chamber, Conditions, Ranges, Stillness
from ipmclab.rig.chambers.settings import ChamberSettings
from ipmclab.rig.chambers.watch import ChamberWatch
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.experiments import archive
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.rig.experiments.plan import make_plan
from ipmclab.rig.experiments.session import Session
from ipmclab.rig.process.messages import Message
from ipmclab.rig.virtual import VirtualBench
from ipmclab.store.journal.finalise import finish_here
from ipmclab.store.journal.laboratory import Laboratory
from tests.rig.chambers.benches_of_chambers import KINDS, WANTED, Kind, Pair, paired, set_by_another
from tests.rig.chambers.wire import LINE_FAULTS, Fault
from tests.rig.test_session import Desk

SOURCES = (
    "src/ipmclab/rig/chambers",
    "src/ipmclab/rig/experiments",
    "tests/rig/chambers/benches_of_chambers.py",
    "tests/rig/chambers/devices.py",
    "tests/rig/chambers/wire.py",
)

SEED = 20261123
MOMENTS = (("chamber-on", 0.5), ("equilibrium", 6.0), ("apply", 8.0), ("apply", 8.0), ("standby", 0.01))
"""A fault comes while this step is done, at most so long [s] after its begin."""

OTHERS = {
    "another client": [(WANTED[0], 42.0)],
    "unit": [((WANTED[0] - 32.0) / 1.8, WANTED[1])],  # 25 is taken for degF, until it is read back
}
"""What a chamber may regulate to beside what was asked, for the fault itself sets it."""

ADMITS = ("could not be", "may still")
"""Words of a message that leave no doubt that a chamber may regulate on; "it was brought to standby" would deny it."""

INSIDE = ("alarm", "unit", "another client", "a program", "deaf", "locked", "no water")
"""What may go wrong with the instrument itself."""

EXPERIMENT: dict[str, Any] = {
    "sample": "friend-2",
    "signal": "step 1 V",
    "rate": "10 Hz",
    "duration": "6 s",
    "zero_time": "0.2 s",
    "fingerprint": False,
    "steps": ["chamber-on", "equilibrium", "chamber-off", "apply"],
    "measured": ["current"],
    "environment": {
        "temperature": f"{WANTED[0]:g} degC",
        "relative_humidity": f"{WANTED[1]:g} percent",
        "settle": "3 s",
        "longest_wait": "40 s",
        "longest_still": "1 min",
    },
}


class PacedBench(VirtualBench):
    """A virtual bench that takes as long as a real one."""

    def apply(self, source: Any, rows: int | None = None) -> Iterator[Block]:
        """Blocks when their time has come."""
        began, rate = time.monotonic(), self._rate
        for block in super().apply(source, rows):
            time.sleep(max(0.0, began + (block.first_row + len(block)) / rate - time.monotonic()))
            yield block

    @property
    def output(self) -> float:
        """What the output gives [V]."""
        return float(self._output)


@dataclass
class Timed:
    """A chamber whose calls are timed."""

    inner: Chamber
    longest: float = 0.0
    failures: list[float] = field(default_factory=list)
    """When each call began that failed [s]."""

    @property
    def ranges(self) -> Ranges:
        return self.inner.ranges

    def set(self, temperature: float, relative_humidity: float | None) -> None:
        self._timed(lambda: self.inner.set(temperature, relative_humidity))

    def read(self) -> Conditions:
        return self._timed(self.inner.read)

    def still(self, longest: float) -> Stillness:
        return self._timed(lambda: self.inner.still(longest))

    def resume(self) -> None:
        self._timed(self.inner.resume)

    def safe(self) -> None:
        self._timed(self.inner.safe)

    def close(self) -> None:
        self._timed(self.inner.close)

    def _timed(self, call: Callable[[], Any]) -> Any:
        began = time.monotonic()
        try:
            return call()
        except IpmclabError:
            self.failures.append(began)
            raise
        finally:
            self.longest = max(self.longest, time.monotonic() - began)


@dataclass(frozen=True)
class Drawn:
    """One fault.

    Parameters
    ----------
    number : int
    kind : Kind
        Of chamber.
    what : str
        A fault of the line, or one of ``INSIDE``.
    step : str
        Of the experiment, during which it comes.
    at : float [s]
        Since the begin of that step.
    lasts : int
        Answers; a fault of the line lasts no longer.
    late : float [s]
        How late an answer is.
    """

    number: int
    kind: Kind
    what: str
    step: str
    at: float
    lasts: int
    late: float

    def __str__(self) -> str:
        many = "for good" if self.lasts > 100 else f"{self.lasts} times"
        return f"{self.number} ({self.kind}, {self.what} {many}, {self.step} + {self.at:.1f} s)"


@dataclass
class Ended:
    """How an experiment ended."""

    drawn: Drawn
    reason: str = ""
    came: bool = False
    volts: float = 0.0
    after: float = float("nan")
    longest_call: float = 0.0
    standby: bool = False
    wrong: list[str] = field(default_factory=list)


def draw(count: int, seed: int = SEED) -> list[Drawn]:
    """So many faults: every kind of chamber and of fault in turn, everything else by chance."""
    rng = random.Random(seed)
    names = [*LINE_FAULTS, *INSIDE]
    drawn = []
    for number in range(count):
        kind, what = KINDS[number % len(KINDS)], names[(number // len(KINDS) + number) % len(names)]
        lasts = rng.choice([1, 2, 5, 10**9, 10**9])
        step, longest = rng.choice(MOMENTS)
        late = rng.choice([0.5, 4.0, 12.0])
        drawn.append(Drawn(number, kind, what, step, rng.uniform(0.0, longest), lasts, late))
    return drawn


def strike(pair: Pair, drawn: Drawn) -> None:
    """Let it go wrong."""
    room = pair.room
    if drawn.what in LINE_FAULTS:
        pair.emulator.fault = Fault(drawn.what, lasts=drawn.lasts, seconds=drawn.late)  # type: ignore[arg-type]
    elif drawn.what == "alarm":
        room.trip()
    elif drawn.what == "unit":
        room.fahrenheit = True
    elif drawn.what == "another client":
        set_by_another(pair, drawn.kind)
    elif drawn.what == "a program":
        room.mode = "RUN"
    elif drawn.what == "no water":
        room.alarms = [2]
    else:
        setattr(room, drawn.what, True)


def mend(pair: Pair) -> None:
    """As before the fault, but for what the instrument was set to."""
    pair.emulator.fault = None
    pair.room.fahrenheit = pair.room.deaf = pair.room.locked = False
    pair.room.alarms = []


def hold(drawn: Drawn, folder: Path) -> Ended:
    """One experiment with one fault, and what is wrong with how it ended."""
    ended = Ended(drawn)
    with paired(drawn.kind, folder, patience=2.0, seed=drawn.number) as pair:
        timed = Timed(pair.chamber)
        rig = replace(
            THESIS_RIG, channels=THESIS_RIG.channels[:-1], thermometer=None, chamber=ChamberSettings("virtual")
        )
        bench = PacedBench(rig=rig)
        watch = ChamberWatch(timed)
        desk = Desk()
        plan = make_plan(experiment_from_table(EXPERIMENT), rig, bytes_free=10**10)
        laboratory = Laboratory.open(folder / "laboratory")
        session = Session(plan, bench, laboratory, desk, inspect=lambda _: [], chamber=watch)
        struck: list[float] = []

        def act() -> None:
            struck.append(time.monotonic())
            strike(pair, drawn)

        def heard(message: Message) -> None:
            if message.kind == "step" and message.values["name"] == drawn.step and not timer.is_alive():
                timer.start()

        timer = Timer(drawn.at, act)
        desk.on_message = heard
        filing.seconds = 0.0
        try:
            session.run()
            ended.reason = session.reason
        except IpmclabError as error:
            ended.reason = session.reason or str(error)
        over = time.monotonic()
        timer.cancel()
        watch.close()
        ended.came = bool(struck)
        if struck and ended.reason:
            met = [began for began in timed.failures if began > struck[0]]
            ended.after = over - filing.seconds - min(met, default=struck[0])
        ended.longest_call = timed.longest
        ended.standby = pair.room.mode in ("STANDBY", "OFF")
        said = " ".join([ended.reason, *desk.texts()])
        ended.volts = bench.output
        judge(ended, pair, said)
        mend(pair)
        time.sleep(0.2)
        try:
            pair.chamber.close()
            pair.chamber.safe()
        except IpmclabError as error:
            ended.wrong.append(f"it cannot be brought to standby after the fault: {error}")
        if pair.room.mode not in ("STANDBY", "OFF"):
            ended.wrong.append("it is not in standby after the fault")
    return ended


def judge(ended: Ended, pair: Pair, said: str) -> None:
    """What is wrong with the end of an experiment."""
    drawn = ended.drawn
    if ended.volts != 0.0:
        ended.wrong.append(f"the strip is at {ended.volts:g} V")
    if ended.longest_call > DEADLINE:
        ended.wrong.append(f"a call took {ended.longest_call:.1f} s")
    if ended.after > DEADLINE:
        ended.wrong.append(f"it ended {ended.after:.1f} s after the fault")
    may = [(WANTED, 0.1), *((pair_, 1.0) for pair_ in OTHERS.get(drawn.what, ()))]
    asked = [one for one in pair.room.regulated if not any(np.allclose(_pair(one), at, atol=by) for at, by in may)]
    if asked:
        ended.wrong.append(f"it regulated to {asked}")
    if not ended.standby and not any(words in said for words in ADMITS):
        ended.wrong.append(f"the chamber is in {pair.room.mode}, and nobody said so: {said}")


def _pair(set_points: tuple[float, float | None]) -> tuple[float, float]:
    return set_points[0], -1.0 if set_points[1] is None else set_points[1]


def run_faults(faults: list[Drawn], at_once: int, on_end: Callable[[Ended], None] = lambda _: None) -> list[Ended]:
    """Hold so many experiments, some at once: they mostly wait."""

    def one(drawn: Drawn) -> Ended:
        with tempfile.TemporaryDirectory() as folder:
            ended = hold(drawn, Path(folder))
        on_end(ended)
        return ended

    before = archive.finalise
    archive.finalise = _in_this_process  # type: ignore[assignment]  # a process for each would take most of the time
    try:
        with ThreadPoolExecutor(at_once) as pool:
            return list(pool.map(one, faults))
    finally:
        archive.finalise = before


filing = local()
"""How long [s] a thread has made run files."""


def _in_this_process(journal: Path, laboratory: Laboratory) -> Path:
    began = time.monotonic()
    try:
        return Path(finish_here(Path(journal), laboratory).path)
    finally:
        filing.seconds = getattr(filing, "seconds", 0.0) + time.monotonic() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--at-once", type=int, default=16)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/chambers.md")
    options = parser.parse_args()
    began = time.monotonic()

    def told(one: Ended) -> None:
        print(f"{one.drawn}: {one.reason[:70] or 'complete'}; {'; '.join(one.wrong) or 'well'}", file=sys.stderr)

    done = run_faults(draw(options.faults), options.at_once, told)
    finish("chambers", TITLE, report(done, time.monotonic() - began), [], record=options.record, gate=False)
    if any(one.wrong for one in done):
        sys.exit(1)


TITLE = "Chambers that fail at drawn moments of an experiment, emulated, in real time"


def report(done: list[Ended], seconds: float) -> str:
    """The results as a page."""
    for_it = [one for one in done if one.reason]
    after = np.array([one.after for one in for_it if np.isfinite(one.after)])
    calls = np.array([one.longest_call for one in done])
    unsafe = [one for one in done if not one.standby]
    wrong = [f"{one.drawn}: {text}" for one in done for text in one.wrong]
    lines = [
        f"* {len(done)} faults in {len({str(one.drawn.kind) for one in done})} kinds of chamber and line; "
        f"{sum(one.came for one in done)} of them came before the end; {seconds:.0f} s in all; seed {SEED}",
        f"* {len(for_it)} experiments ended with a reason, {len(done) - len(for_it)} were complete; "
        f"the strip at 0 V at the end of {sum(one.volts == 0.0 for one in done)}",
        f"* from the fault to the end: {np.median(after):.1f} s (median), {after.max():.1f} s at most; "
        f"bound {DEADLINE:g} s",
        f"* longest call of a chamber: {np.median(calls):.2f} s (median), {calls.max():.1f} s at most; "
        f"bound {DEADLINE:g} s",
        f"* the chamber in standby at the end: {len(done) - len(unsafe)}; not, and said so, for the fault lasted: "
        f"{len(unsafe)}",
        f"* {len(wrong)} faults of ours" + "".join(f"\n  * {text}" for text in wrong),
        "",
        "| fault | came | ended with a reason | longest from the fault to the end [s] |",
        "|---|---|---|---|",
    ]
    counts = Counter(one.drawn.what for one in done if one.came)
    for what in sorted(counts):
        of = [one for one in for_it if one.drawn.what == what]
        longest = max((one.after for one in of if np.isfinite(one.after)), default=None)
        lines.append(f"| {what} | {counts[what]} | {len(of)} | {'-' if longest is None else f'{longest:.1f}'} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
