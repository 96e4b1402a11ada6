"""The keeper's process: when the pipe from the recorder breaks, it sets the chamber to standby.

``python -m ipmclab.rig.chambers.keeper_process SETTINGS LOG`` is started by the recorder. The line to the chamber is
the recorder's as long as that lives. Once it is gone, killed too, the system has closed its line; the keeper then opens
one of its own, and tries until the chamber has taken the word.
"""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import IpmclabError
from ipmclab.platform import own_stdin
from ipmclab.rig.chambers.chamber import Chamber
from ipmclab.rig.chambers.drivers import open_chamber
from ipmclab.rig.chambers.settings import ChamberSettings

GIVE_UP: Final = 600.0
"""How long [s] it continues trying."""

_PAUSE: Final = 2.0  # s between two attempts


def watch(words: Iterable[str], reach: Callable[[], Chamber], log: Callable[[str], None], pause: float = _PAUSE) -> int:
    """Hear words until there are none, and let the chamber stand by where it regulates then.

    Parameters
    ----------
    words : iterable of str
        ``"hold"``: it regulates; ``"safe"``: it is in standby.
    reach : callable
        Opens a line to the chamber.
    log : callable of str
    pause : float [s]
        Between two attempts.

    Returns
    -------
    status : int
        1 where the chamber could not be reached.
    """
    regulates = False
    for word in words:
        regulates = word == "hold"
    if not regulates:
        return 0
    log("chamber: the recorder is gone, standby is asked for")
    until = time.monotonic() + GIVE_UP
    while True:
        try:
            chamber = reach()
            try:
                chamber.safe()
            finally:
                chamber.close()
        except Exception as error:  # whatever it is, nobody else is left to try again
            said = str(error) if isinstance(error, IpmclabError) else f"{type(error).__name__}: {error}"
            log(f"chamber: standby could not be asked for: {said}")
            if time.monotonic() >= until:
                log("chamber: IT MAY STILL HOLD ITS SET POINTS: bring it to standby at its panel")
                return 1
            time.sleep(pause)
        else:
            log("chamber: it is in standby")
            return 0


def settings_from(text: str) -> ChamberSettings:
    """The settings of a chamber from their JSON."""
    values: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value for key, value in json.loads(text).items()
    }
    return ChamberSettings(**values)


def main(arguments: list[str]) -> int:
    """The keeper process.

    Parameters
    ----------
    arguments : list of str
        The settings as JSON, and the log.
    """
    for name in ("SIGINT", "SIGHUP", "SIGTERM"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)  # it ends with its pipe, and never before
    settings = settings_from(arguments[0])
    path = Path(arguments[1]) if arguments[1] else None

    def log(text: str) -> None:
        if path is not None:
            with suppress(OSError), path.open("a", encoding="utf-8") as stream:
                stream.write(f"{datetime.now().astimezone().isoformat('T', 'milliseconds')} {text}\n")

    words = (line.decode(errors="replace").strip() for line in iter(own_stdin().readline, b""))
    return watch(words, lambda: open_chamber(settings), log)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
