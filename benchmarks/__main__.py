"""Every benchmark with a gate, one process each: ``python -m benchmarks [--gate] [--record]``."""

from __future__ import annotations

import argparse
import subprocess
import sys

NAMES = ("core", "fit", "start")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/")
    options = parser.parse_args()
    flags = [f"--{name}" for name, value in vars(options).items() if value]
    missed = []
    for name in NAMES:
        status = subprocess.run([sys.executable, "-m", f"benchmarks.{name}", *flags], check=False)
        if status.returncode:
            missed.append(name)
    if missed:
        sys.exit(f"missed: {', '.join(missed)}")


if __name__ == "__main__":
    main()
