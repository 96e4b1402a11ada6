"""What a guardian brings to 0 V, and how it reaches that: through a connection of its own."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, Protocol, Self

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.channels import Channel, Converter, Output, Rig
from ipmclab.rig.safety.readback import channels_at_output, resistance_between


@dataclass(frozen=True)
class Target:
    """What the guardian brings to 0 V.

    Parameters
    ----------
    kind : "ni" or "file"
        A module of a chassis; or, to try the guardian without hardware, a file that gets a line for each reset.
    place : str
        The physical output, such as ``"cDAQ1Mod2/ao0"``; the path of the file.
    address : str, optional
        ``host:port`` of a gRPC server.
    channels : tuple of Channel
        Which together read what the output gives; none where nothing does.
    between : float [ohm]
        The resistance between the output and the place where the voltage is read.
    """

    kind: Literal["ni", "file"]
    place: str
    address: str | None = None
    channels: tuple[Channel, ...] = ()
    between: float = 0.0

    @classmethod
    def of(cls, rig: Rig) -> Target:
        """The output of a rig."""
        channels = tuple(rig[name] for name in channels_at_output(rig))
        return cls("ni", rig.output.physical, rig.address, channels, resistance_between(rig))

    @classmethod
    def from_json(cls, text: str) -> Self:
        """What ``to_json`` gave."""
        table = json.loads(text)
        channels = (Channel(**{**one, "converter": Converter(**one["converter"])}) for one in table["channels"])
        return cls(**{**table, "channels": tuple(channels)})

    def to_json(self) -> str:
        """For the command line of the guardian."""
        return json.dumps(asdict(self))


class Connection(Protocol):
    """How the output is reached."""

    def reset(self) -> None:
        """Bring it to 0 V."""

    def read(self) -> float:
        """What it gives [V]. Raises IpmclabError, of code ``"output-unread"`` where that can never be known."""

    def close(self) -> None:
        """Let go."""


def connect(target: Target) -> Connection:
    """Reach what is to be guarded.

    Raises
    ------
    InputError
        An unknown kind of target.
    IpmclabError
        It cannot be reached.
    """
    if target.kind == "file":
        return _FileConnection(target.place)
    if target.kind == "ni":
        from ipmclab.rig.daqmx.reset import Resetter

        output = Output(-10.0, 10.0, target.place)
        rig = Rig("guarded", target.channels, target.between, "electrodes", output, bench="ni", address=target.address)
        return Resetter(rig)
    raise InputError(
        f"unknown target {target.kind!r}", code="unknown-target", where="guardian", repair="use ni or file"
    )


class _FileConnection:
    """Writes a line for each reset: a guardian to try."""

    def __init__(self, path: str) -> None:
        self._path = path

    def reset(self) -> None:
        """Write the line."""
        try:
            with open(self._path, "a", encoding="utf-8") as stream:  # a path that may be a pipe
                stream.write(f"0 V at {time.time():.6f}\n")
        except OSError as error:
            raise IpmclabError(str(error), code="unwritable", where=self._path, repair="make its folder") from error

    def read(self) -> float:
        """What the last line says."""
        try:
            said = Path(self._path).read_text(encoding="utf-8").splitlines()[-1]
            return float(said.split(" V at ")[0])
        except (OSError, ValueError, IndexError) as error:
            raise IpmclabError(str(error), code="unreadable", where=self._path, repair="see what it is") from error

    def close(self) -> None:
        """Nothing is held."""
