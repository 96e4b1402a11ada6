"""Where the rows of a run go while it is recorded: into memory, or into a journal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.rig.recording.slow import Air
from ipmclab.run import Mark, Run, RunMetadata

if TYPE_CHECKING:
    from ipmclab.store.journal.header import JournalHeader

FloatArray = npt.NDArray[np.float64]
FlagArray = npt.NDArray[np.uint8]

State = Literal["complete", "aborted"]


@dataclass(frozen=True)
class Rows:
    """Some rows of a run, scaled.

    Parameters
    ----------
    first_row : int
    values : mapping of channel to float array, shape (n_rows,) [SI]
    flags : mapping of channel to uint8 array, shape (n_rows,)
    raw : mapping of channel, or ``"output"``, to float array, shape (n_rows,) [V]
    """

    first_row: int
    values: Mapping[str, FloatArray]
    flags: Mapping[str, FlagArray]
    raw: Mapping[str, FloatArray]

    def __len__(self) -> int:
        return len(self.raw["output"])


class Keeper(Protocol):
    """Keeps what comes."""

    def rows(self, rows: Rows) -> None:
        """Keep rows."""

    def air(self, air: Air) -> None:
        """Keep what the air was like."""

    def mark(self, mark: Mark) -> None:
        """Keep that something happened."""

    def end(self, state: State, reason: str, metadata: RunMetadata) -> None:
        """The recording is over."""


class JournalLike(Protocol):
    """The calls of a journal: see ``ipmclab.store.journal.journal``."""

    def append(self, first_row: int, columns: npt.ArrayLike) -> None:
        """Add rows."""

    def event(self, kind: str, time: float, text: str = "", **values: float | str | None) -> None:
        """Add something that happened."""

    def end(self, state: State, reason: str = "", metadata: RunMetadata | None = None) -> Any:
        """Write what is left, and how the recording ended."""


class InJournal:
    """Every row goes to a journal; the run is what is made of it later.

    Parameters
    ----------
    journal : Journal
    header : JournalHeader
        That of the journal.
    """

    def __init__(self, journal: JournalLike, header: JournalHeader) -> None:
        self._journal = journal
        self._columns = header.columns

    def rows(self, rows: Rows) -> None:
        """Keep rows."""
        columns: dict[str, npt.NDArray[Any]] = dict(rows.values)
        columns |= {f"{name}_quality": flags for name, flags in rows.flags.items()}
        columns |= {f"{name}_raw": volts for name, volts in rows.raw.items()}
        self._journal.append(rows.first_row, np.column_stack([columns[name] for name in self._columns]))

    def air(self, air: Air) -> None:
        """Keep what the air was like."""
        known: dict[str, Any] = {name: value for name, value in air.values.items() if math.isfinite(value)}
        self._journal.event("environment", air.time, **known)

    def mark(self, mark: Mark) -> None:
        """Keep that something happened. A gap shows in the rows, and is marked when the run is made."""
        if mark.kind != "gap":
            self._journal.event(mark.kind, mark.time, mark.text)

    def end(self, state: State, reason: str, metadata: RunMetadata) -> None:
        """The recording is over."""
        self._journal.end(state, reason, metadata)


class InMemory:
    """Every row stays in memory.

    Parameters
    ----------
    rate : float [Hz]
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._rows: list[Rows] = []
        self._air: list[Air] = []
        self._marks: list[Mark] = []
        self.run: Run | None = None

    def rows(self, rows: Rows) -> None:
        """Keep rows."""
        self._rows.append(rows)

    def air(self, air: Air) -> None:
        """Keep what the air was like."""
        self._air.append(air)

    def mark(self, mark: Mark) -> None:
        """Keep that something happened."""
        self._marks.append(mark)

    def end(self, state: State, reason: str, metadata: RunMetadata) -> None:
        """The recording is over: ``run`` is there, where there are rows enough for one."""
        if sum(len(rows) for rows in self._rows) < 2:
            return
        numbers = np.concatenate([np.arange(rows.first_row, rows.first_row + len(rows)) for rows in self._rows])
        flags = _joined([rows.flags for rows in self._rows])
        air = _air_columns(self._air)
        self.run = Run.from_arrays(
            time=numbers / self._rate,
            hold="zero-before",
            quality={name: bits for name, bits in flags.items() if bits.any()},
            raw=_joined([rows.raw for rows in self._rows]),
            metadata=replace(
                metadata,
                marks=(*metadata.marks, *self._marks),
                state=state,
                state_reason=reason or None,
            ),
            **_joined([rows.values for rows in self._rows]),
            **air,
        )


def _joined(parts: Sequence[Mapping[str, npt.NDArray[Any]]]) -> dict[str, npt.NDArray[Any]]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _air_columns(air: Sequence[Air]) -> dict[str, FloatArray]:
    if not air:
        return {}
    names = [name for name in air[0].values if any(math.isfinite(one.values[name]) for one in air)]
    columns = {name: np.array([one.values[name] for one in air]) for name in names}
    return {"time_environment": np.array([one.time for one in air]), **columns}
