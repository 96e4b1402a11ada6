"""The stand-in chassis with the virtual strip behind its terminals: in this process, or in one that can be killed."""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ipmclab.rig.channels import THESIS_RIG, Rig
from ipmclab.rig.plant import StripPlant
from virtual_cdaq.levels import LevelFile, read_levels
from virtual_cdaq.model.chassis import Chassis
from virtual_cdaq.model.clock import make_clock
from virtual_cdaq.model.faults import Fault, parse_fault
from virtual_cdaq.model.task import State
from virtual_cdaq.server import Server

OUTPUT = THESIS_RIG.output.physical


@dataclass(frozen=True)
class StandIn:
    """A stand-in in this process."""

    address: str
    chassis: Chassis
    plant: StripPlant

    @property
    def rig(self) -> Rig:
        """The rig of the thesis on it."""
        return replace(THESIS_RIG, bench="ni", address=self.address)

    @property
    def level(self) -> float:
        """What its output gives [V]."""
        with self.chassis.lock:
            return self.chassis.levels[OUTPUT]

    @property
    def reserved(self) -> list[str]:
        """The tasks that hold something of the chassis."""
        with self.chassis.lock:
            return [task.name for task in self.chassis.tasks if task.state >= State.RESERVED]

    def rest(self) -> None:
        """Let the strip discharge."""
        with self.chassis.lock:
            self.plant.rest()


def happen(chassis: StandIn, kind: str, **values: object) -> None:
    """Let a fault happen now."""
    with chassis.chassis.lock:
        chassis.chassis.suffer(Fault(kind, **values), chassis.chassis.clock.now())  # type: ignore[arg-type]


def compiled() -> StripPlant:
    """A strip that has compiled what it needs: the first call of a client would wait for it, longer than it may."""
    plant = StripPlant(THESIS_RIG)
    plant.advance([0.0], {})
    return plant


@contextmanager
def serve(clock: str = "lock-step", *, faults: Sequence[str] = ()) -> Iterator[StandIn]:
    """Serve while the context lasts."""
    plant = compiled()
    chassis = Chassis(plant, make_clock(clock), faults=[parse_fault(text) for text in faults])
    server = Server(chassis)
    try:
        yield StandIn(server.start(), chassis, plant)
    finally:
        server.stop()


class Process:
    """A stand-in in a process of its own."""

    def __init__(self, folder: Path, clock: str = "real", *, port: int = 0, faults: Sequence[str] = ()) -> None:
        self._levels = folder / "levels.json"
        command = [sys.executable, __file__, "--clock", clock, "--port", str(port), "--levels", str(self._levels)]
        for fault in faults:
            command += ["--fault", fault]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        assert self.address.startswith("127.0.0.1:"), self.address
        self.port = int(self.address.split(":")[1])

    @property
    def rig(self) -> Rig:
        """The rig of the thesis on it."""
        return replace(THESIS_RIG, bench="ni", address=self.address)

    @property
    def level(self) -> float:
        """What its output gives, or gave when it died [V]."""
        return read_levels(self._levels)[OUTPUT].volts

    def send(self, name: str) -> None:
        """Send it a signal, such as ``"SIGSTOP"``."""
        self.process.send_signal(getattr(signal, name))

    def end(self) -> None:
        """End it, whatever state it is in."""
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def main() -> None:
    """Serve until killed."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int)
    parser.add_argument("--clock")
    parser.add_argument("--levels", type=Path)
    parser.add_argument("--fault", action="append", default=[])
    chosen = parser.parse_args()
    faults = [parse_fault(text) for text in chosen.fault]
    chassis = Chassis(compiled(), make_clock(chosen.clock), faults=faults)
    chassis.on_level = LevelFile(chosen.levels, chassis.levels).write
    server = Server(chassis, chosen.port)
    sys.stdout.write(server.start() + "\n")
    sys.stdout.flush()
    server.wait()


if __name__ == "__main__":
    main()
