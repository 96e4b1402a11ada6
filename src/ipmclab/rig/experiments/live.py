"""What an experiment reports while a run is recorded."""

from __future__ import annotations

import math
import time
from typing import Any, Final

from ipmclab.rig.experiments.operator import Operator
from ipmclab.rig.process.messages import Message
from ipmclab.rig.recording.keeping import Rows
from ipmclab.rig.recording.slow import Air
from ipmclab.run import Mark

_BETWEEN_REPORTS: Final = 0.2
"""How often [s] it is reported how far a run has come."""


class Live:
    """What a run reports while it is recorded: its readings as they come, and how many rows are safe."""

    def __init__(self, operator: Operator, rows: int) -> None:
        self._operator = operator
        self._rows = rows
        self._seen = 0
        self._safe = 0
        self._told = 0.0

    def block(self, rows: Rows) -> None:
        """Some rows were read."""
        self._seen = rows.first_row + len(rows)
        self._operator.tell(Message("block", {"first_row": rows.first_row}, dict(rows.values)))
        if time.monotonic() - self._told > _BETWEEN_REPORTS:
            self._report()

    def air(self, air: Air) -> None:
        """The air around the strip was read."""
        known = {name: value for name, value in air.values.items() if math.isfinite(value)}
        self._operator.tell(Message("air", {"time": air.time, **known}))

    def mark(self, mark: Mark) -> None:
        """Something happened."""
        self._operator.tell(Message("event", _told(mark)))

    def ends(self, mark: Mark, ending: str, rows: int) -> None:
        """An operator, or a limit, is ``ending`` the run, which will have so many rows."""
        self._rows = rows
        self._operator.tell(Message("event", {**_told(mark), "ending": ending}))
        self._report()

    def committed(self, acknowledged: int) -> None:
        """So many rows are on the disk."""
        self._safe = acknowledged
        self._report()

    def _report(self) -> None:
        self._told = time.monotonic()
        progress = {"rows": self._seen, "acknowledged": self._safe, "of": self._rows}
        self._operator.tell(Message("progress", progress))


def _told(mark: Mark) -> dict[str, Any]:
    return {"event": mark.kind, "time": mark.time, "text": mark.text}
