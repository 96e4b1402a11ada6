"""Every benchmark of speed, one process each: ``python -m benchmarks [--gate] [--record]``; with ``--gate`` those that
have one.

``python -m benchmarks --stale`` lists the results that are older than the sources that they hang on; it fails where
the changelog calls its newest version released.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from benchmarks.sources import is_release, stale

GATED = ("core", "fit", "start")
REPORTED = (*GATED, "batch", "peers")
"""What the page of the docs on speed is made of."""

MEASUREMENTS = 3
"""A gate is missed by so many in a row: on one machine they differ by a tenth, and more where others share it."""


def tell_stale() -> None:
    """List the stale results; a release has none."""
    names = stale()
    for name in names:
        print(f"stale: benchmarks/results/{name}.md; run: uv run python -m benchmarks.{name} --record")
    if names and is_release():
        sys.exit(f"a release has no stale results, and here are {len(names)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gate", action="store_true", help="exit 1 when a ratio is missed")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/")
    parser.add_argument("--stale", action="store_true", help="list the results that are to be measured again")
    options = parser.parse_args()
    if options.stale:
        tell_stale()
        return
    flags = [f"--{name}" for name, value in vars(options).items() if value]
    missed = []
    for name in GATED if options.gate else REPORTED:
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
