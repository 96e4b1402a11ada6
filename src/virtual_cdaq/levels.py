"""The levels of the outputs in a file, for somebody who must not disturb the chassis to learn them."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Level:
    """What an output gives.

    Parameters
    ----------
    volts : float [V]
    since : float [s]
        Wall time (``time.time()``) of its last change.
    """

    volts: float
    since: float


class LevelFile:
    """A small JSON file that is replaced as a whole at every change of a level.

    Parameters
    ----------
    path : Path
    levels : mapping of physical channel to float [V]
        To begin with.
    """

    def __init__(self, path: Path, levels: Mapping[str, float]) -> None:
        self._path = path
        self._beside = path.with_name(path.name + ".new")
        now = time.time()
        self._levels = {physical: Level(volts, now) for physical, volts in levels.items()}
        self._replace()

    def write(self, levels: Mapping[str, float]) -> None:
        """Keep these levels."""
        now = time.time()
        for physical, volts in levels.items():
            if volts != self._levels[physical].volts:
                self._levels[physical] = Level(volts, now)
        self._replace()

    def _replace(self) -> None:
        content = {physical: {"volts": level.volts, "since": level.since} for physical, level in self._levels.items()}
        self._beside.write_text(json.dumps(content), encoding="utf-8")
        for _ in range(50):
            try:
                os.replace(self._beside, self._path)
                return
            except PermissionError:  # Windows, while somebody reads it
                time.sleep(0.001)


def read_levels(path: Path) -> dict[str, Level]:
    """The levels that a stand-in keeps in a file.

    Parameters
    ----------
    path : Path
        What its ``--levels`` named.

    Returns
    -------
    dict of physical channel to Level

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "levels.json"
    >>> LevelFile(path, {"cDAQ1Mod2/ao0": 0.0}).write({"cDAQ1Mod2/ao0": 1.5})
    >>> read_levels(path)["cDAQ1Mod2/ao0"].volts
    1.5
    """
    content = json.loads(path.read_text(encoding="utf-8"))
    return {physical: Level(each["volts"], each["since"]) for physical, each in content.items()}
