"""Every benchmark with a gate, one process each: ``python -m benchmarks [--gate] [--record]``."""

from __future__ import annotations

import argparse
import subprocess
import sys

NAMES = ("core", "fit", "start")

MEASUREMENTS = 3
"""A gate is missed by so many in a row: on one machine they differ by a tenth, and more where others share it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/")
    options = parser.parse_args()
    flags = [f"--{name}" for name, value in vars(options).items() if value]
    missed = []
    for name in NAMES:
        command = [sys.executable, "-m", f"benchmarks.{name}", *flags]
        for _ in range(MEASUREMENTS if options.gate else 1):
            if subprocess.run(command, check=False).returncode == 0:
                break
        else:
            missed.append(name)
    if missed:
        sys.exit(f"missed: {', '.join(missed)}")


if __name__ == "__main__":
    main()
