"""``python -m virtual_cdaq``: the stand-in with a resistor and a capacitor behind its terminals."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path

from virtual_cdaq.levels import LevelFile
from virtual_cdaq.model.chassis import SEED, Chassis
from virtual_cdaq.model.clock import make_clock
from virtual_cdaq.model.faults import parse_fault
from virtual_cdaq.model.plant import RcPlant
from virtual_cdaq.server import Server


def main(arguments: list[str] | None = None) -> int:
    """Serve until interrupted.

    Returns
    -------
    int
        0, or 2 when it could not begin.
    """
    parser = argparse.ArgumentParser(prog="python -m virtual_cdaq", description=__doc__)
    parser.add_argument("--port", type=int, default=0, help="on 127.0.0.1; 0 (default) for a free one")
    parser.add_argument("--clock", default="real", help="real, x10, lock-step")
    parser.add_argument("--seed", type=int, default=SEED, help="of the converters' noise")
    parser.add_argument("--levels", type=Path, help="keep the level of every output in this file")
    parser.add_argument("--fault", action="append", default=[], help="such as 'freeze at 2 s'; may be repeated")
    chosen = parser.parse_args(arguments)
    try:
        clock = make_clock(chosen.clock)
        faults = [parse_fault(text) for text in chosen.fault]
        chassis = Chassis(RcPlant(), clock, seed=chosen.seed, faults=faults)
        if chosen.levels is not None:
            chassis.on_level = LevelFile(chosen.levels, chassis.levels).write
        server = Server(chassis, chosen.port)
        address = server.start()
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: server.stop())
    print(address, flush=True)
    server.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())
