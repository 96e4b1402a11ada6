"""What a run in an environment that changes costs beside the same run in one that stands.

``python -m benchmarks.drift`` prints processor times. Both runs are the second of their kind, as those of a session
are: numbers that hang on the actuator and on the history of the air are kept. The first run is beside them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from ipmclab import load_actuator, simulate
from ipmclab.model import Actuator
from ipmclab.model.environment import EnvironmentHistory

_LAWS: Final = "+environment.coupling_gain+environment.permittivity"
STRIPS: Final = {
    "lumped": (f"friend-2{_LAWS}", 1),
    "line": (f"friend-2+line.segments=10{_LAWS}", 1),
    "leak": (f"friend-2+leak.exponential{_LAWS}", 1),
    "leak that flows": (f"friend-2+leak.exponential{_LAWS}", 3),
    "viscoelastic, flows": (f"friend-2+leak.exponential+viscoelastic{_LAWS}", 3),
    "slow leak, flows": (f"friend-2+leak.exponential+leak.slow{_LAWS}", 3),
    "clamp, flows": (f"friend-2+leak.exponential+clamp{_LAWS}", 3),
}
"""Strips, and the amplitude [V] that drives each: at 1 V nothing leaks."""

AIR: Final = EnvironmentHistory.of([(0.0, "20 degC, 80 %RH"), (600.0, "22 degC, 70 %RH"), (3600.0, "22 degC, 70 %RH")])
REPEATS: Final = 7


def processor_time(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """The least processor time [s] of some repeats."""
    found = []
    for _ in range(repeats):
        begun = time.process_time()
        work()
        found.append(time.process_time() - begun)
    return min(found)


def cost(strip: Actuator, volts: float, duration: float, repeats: int = REPEATS) -> tuple[float, float, float]:
    """Processor times [s]: in an environment that stands, in one that changes the first time, and again."""
    plain, signal = strip.at(AIR.at(0.0)), f"sine {volts:g} V 0.1 Hz"

    def standing() -> object:
        return simulate(plain, signal, duration=duration, rate=50)

    def changing() -> object:
        return simulate(strip, signal, duration=duration, rate=50, environment=AIR)

    standing(), simulate(strip.replace(), signal, duration=1, rate=50, environment=AIR)  # compiled
    first = processor_time(changing, 1)
    return processor_time(standing, repeats), first, processor_time(changing, repeats)


def main() -> None:
    """Print the table."""
    print(f"{'strip':20}{'record':>10}{'stands':>12}{'first':>12}{'again':>12}{'ratio':>8}")
    for name, (stages, volts) in STRIPS.items():
        for duration in (40.0, 3600.0):
            plain, first, again = cost(load_actuator(stages), volts, duration, 3 if name == "line" else REPEATS)
            times = "".join(f"{1e3 * one:>9.2f} ms" for one in (plain, first, again))
            print(f"{name:20}{duration:>8.0f} s{times}{again / plain:>8.2f}")


if __name__ == "__main__":
    main()
