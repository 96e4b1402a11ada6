"""Who lets a chamber stand by when the recorder no longer can, as the recorder holds it."""

from __future__ import annotations

import json
import subprocess
import threading
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Final

from ipmclab.platform import detached, python_child
from ipmclab.rig.chambers.chamber import ChamberError
from ipmclab.rig.chambers.settings import ChamberSettings

_END: Final = 5.0  # s for a keeper that has nothing to do to end


class Keeper:
    """A process of its own that waits at the end of a pipe: when it breaks, the chamber is set to standby.

    It is not the guardian of the output: that must act within half a second, and a chamber takes up to half a minute.

    Parameters
    ----------
    settings : ChamberSettings
        The chamber, which it reaches by itself once the recorder's own line to it is gone.
    log : Path, optional
        A file that gets a line, with the time, for everything that happens.
    """

    def __init__(self, settings: ChamberSettings, log: Path | None = None) -> None:
        arguments = (json.dumps(asdict(settings)), str(log or ""))
        command = python_child("ipmclab.rig.chambers.keeper_process", *arguments)
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, bufsize=0, **detached())

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def hold(self, regulates: bool) -> None:
        """Say that the chamber regulates for this program, or that it is in standby again.

        Raises
        ------
        ChamberError
            The keeper is gone, and the chamber would regulate on without anybody.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(b"hold\n" if regulates else b"safe\n")
        except (OSError, ValueError) as error:
            if regulates:
                raise ChamberError(
                    f"nobody would let the chamber stand by if this program ended: its keeper is gone ({error})",
                    code="keeper-lost",
                    where="chamber",
                    repair="see guardian.log in the laboratory folder, and record again",
                ) from error

    def close(self) -> None:
        """Let it go. While the chamber still regulates, it lets it stand by first. May be called twice."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(_END)
        except subprocess.TimeoutExpired:  # somebody has to take note of its end, where it ends first
            threading.Thread(target=self._process.wait, name="keeper's end", daemon=True).start()
