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

STRIPS: Final = {
    "lumped": "friend-2+environment.coupling_gain+environment.permittivity",
    "line": "friend-2+line.segments=10+environment.coupling_gain+environment.permittivity",
    "leak": "friend-2+leak.exponential+environment.coupling_gain+environment.permittivity",
}
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


def cost(strip: Actuator, duration: float, repeats: int = REPEATS) -> tuple[float, float, float]:
    """Processor times [s]: in an environment that stands, in one that changes the first time, and again."""
    plain = strip.at(AIR.at(0.0))

    def standing() -> object:
        return simulate(plain, "sine 1 V 0.1 Hz", duration=duration, rate=50)

    def changing() -> object:
        return simulate(strip, "sine 1 V 0.1 Hz", duration=duration, rate=50, environment=AIR)

    standing(), simulate(strip.replace(), "sine 1 V 0.1 Hz", duration=1, rate=50, environment=AIR)  # compiled
    first = processor_time(changing, 1)
    return processor_time(standing, repeats), first, processor_time(changing, repeats)


def main() -> None:
    """Print the table."""
    print(f"{'strip':10}{'record':>10}{'stands':>12}{'first':>12}{'again':>12}{'ratio':>8}")
    for name, stages in STRIPS.items():
        for duration in (40.0, 3600.0):
            plain, first, again = cost(load_actuator(stages), duration, 3 if name == "line" else REPEATS)
            times = "".join(f"{1e3 * one:>9.2f} ms" for one in (plain, first, again))
            print(f"{name:10}{duration:>8.0f} s{times}{again / plain:>8.2f}")


if __name__ == "__main__":
    main()
