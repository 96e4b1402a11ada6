"""What a run in an environment that changes costs beside the same run in one that stands.

Run ``python -m benchmarks.drift [--rounds 21] [--gate] [--record]``. Processor times of whole calls of ``simulate`` at
50 S/s. Both runs are the second of their kind, as those of a session are: numbers that hang on the actuator and on the
history of the air are kept; what the first run costs is beside them. Candidates take short turns
(``harness.interleave``). Before anything is timed, the run in changing air is held against the same rows by matrices,
ten times as fine (1e-4 of peak); ``tests/model/test_changing.py`` holds both against a stiff solver.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.harness import Ratio, finish, interleave
from ipmclab import Run, load_actuator, simulate
from ipmclab.model import Actuator
from ipmclab.model.changing import changing_outputs
from ipmclab.model.environment import EnvironmentHistory
from ipmclab.model.environment.laws import KINDS

SOURCES = ("src/ipmclab/model",)

BOUND: Final = 1.5
RATE: Final = 50.0
LENGTHS: Final = {"40 s": 40.0, "1 h": 3600.0}
AIR: Final = EnvironmentHistory.of([(0.0, "20 degC, 80 %RH"), (600.0, "22 degC, 70 %RH"), (3600.0, "22 degC, 70 %RH")])
STILL: Final = EnvironmentHistory.of("20 degC, 80 %RH")
"""In which a strip dries by what leaks alone."""

_TWO: Final = "+environment.coupling_gain+environment.permittivity"
_EVERY: Final = "".join(f"+{kind.name}" for kind in KINDS)


@dataclass(frozen=True)
class Case:
    """A strip, the amplitude [V] that drives it (at 1 V nothing leaks), the air that it is in, and its laws."""

    stages: str
    volts: float
    air: EnvironmentHistory = AIR
    laws: str = _TWO

    @property
    def strip(self) -> Actuator:
        return load_actuator(f"friend-2{self.stages}{self.laws}")

    @property
    def signal(self) -> str:
        return f"sine {self.volts:g} V 0.1 Hz"


CASES: Final = {
    "lumped, linear": Case("", 1.0),
    "line of 10 segments": Case("+line.segments=10", 1.0),
    "a leak that stays below its threshold": Case("+leak.exponential", 1.0),
    "a leak that flows": Case("+leak.exponential", 3.0),
    "a leak that flows, in still air": Case("+leak.exponential", 3.0, STILL),
    "a leak that flows, every law": Case("+leak.exponential", 3.0, laws=_EVERY),
    "a leak that flows, slow modes": Case("+leak.exponential+relaxation.displacement+relaxation.force", 3.0),
    "a leak that flows, viscoelastic": Case("+leak.exponential+viscoelastic", 3.0),
    "a leak that flows, viscoelastic, every law": Case("+leak.exponential+viscoelastic", 3.0, laws=_EVERY),
    "a leak that flows and grows": Case("+leak.exponential+leak.slow", 3.0),
    "a leak that flows, clamped section": Case("+leak.exponential+clamp", 3.0),
}


def check(name: str, case: Case) -> float:
    """How far the run is from the same run by matrices, in parts of the peak; refuse to time what is wrong."""
    strip, fine = case.strip, 10
    volts = simulate(load_actuator("friend-2"), case.signal, duration=20, rate=RATE).voltage
    rows = np.arange(fine * len(volts)) / (fine * RATE)
    rest = dict.fromkeys(strip.state_names, 0.0)
    ours = changing_outputs(strip, rows[::fine], volts, "zero", case.air).values
    exact = changing_outputs(strip, rows, np.repeat(volts, fine), "zero", case.air, initial_state=rest).values
    error = float(np.max(np.abs(ours - exact[:, ::fine]).max(axis=1) / np.abs(exact).max(axis=1)))
    if not error <= 1e-4:
        raise SystemExit(f"{name}: the run is off by {error:.1e} of its peak")
    return error


def measured(name: str, case: Case, length: str, rounds: int) -> tuple[str, Ratio]:
    """A row of the table, and the ratio that has a bound."""
    strip = case.strip
    duration, still = LENGTHS[length], strip.at(case.air.at(0.0))

    def standing() -> Run:
        return simulate(still, case.signal, duration=duration, rate=RATE)

    def changing() -> Run:
        return simulate(strip, case.signal, duration=duration, rate=RATE, environment=case.air)

    standing(), simulate(strip.replace(), case.signal, duration=1, rate=RATE, environment=case.air)  # compiled
    first = processor_time(changing)
    found = interleave({"stands": standing, "changes": changing}, rounds=rounds)
    stands, changes = (1e3 * float(np.median(one)) for one in found.values())
    ratio = Ratio(f"{name}, {length}", found["changes"] / found["stands"], at_most=BOUND)
    times = f"{stands:.2f} ms | {changes:.2f} ms | {1e3 * first:.0f} ms"
    return f"| {name} | {length} | {times} | {ratio.median:.2f} |", ratio


def processor_time(work: Callable[[], Run]) -> float:
    """Of one call [s]."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/drift.md")
    options = parser.parse_args()
    errors = {name: check(name, case) for name, case in CASES.items()}
    found = [
        measured(name, case, length, options.rounds if length == "40 s" else max(5, options.rounds // 3))
        for name, case in CASES.items()
        for length in LENGTHS
    ]
    head = (
        "| strip | record | environment stands | changes | changes, the first time | ratio |\n|---|---|---|---|---|---|"
    )
    worst = max(errors, key=lambda name: errors[name])
    said = f"From the same rows by matrices, ten times as fine: {errors[worst]:.1e} of peak at most ({worst})."
    body = "\n".join([said, "", head, *(row for row, _ in found)])
    title = "A run in an environment that changes, beside the same run in one that stands"
    finish("drift", title, body, [ratio for _, ratio in found], record=options.record, gate=options.gate)


if __name__ == "__main__":
    main()
