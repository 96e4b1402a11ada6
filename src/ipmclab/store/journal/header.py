"""What a journal says of itself: the first frame, which alone is enough to know what was recorded."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Any, Final, get_args
from uuid import UUID

from ipmclab.errors import InputError
from ipmclab.run import SLOW_CHANNELS, Hold, RunMetadata
from ipmclab.store.document import metadata_table, parse_metadata
from ipmclab.units import CHANNELS

FORMAT: Final = "ipmclab journal"
FORMAT_VERSION: Final = 1

_FAST: Final = tuple(name for name in CHANNELS if name not in SLOW_CHANNELS)
COLUMNS: Final = (
    *_FAST,
    *(f"{name}_quality" for name in _FAST),
    *(f"{name}_raw" for name in CHANNELS),
    "output_raw",
)
"""The columns that a journal can have."""


@dataclass(frozen=True)
class JournalHeader:
    """What is recorded.

    Parameters
    ----------
    uuid : str
        Of the run.
    rate : float [Hz]
        Row k is read at ``k / rate``.
    columns : tuple of str
        ``"voltage"`` and the other channels in SI units; ``<channel>_raw`` and ``"output_raw"`` in V;
        ``<channel>_quality`` with bits of ``QUALITY_FLAGS`` as numbers. Temperature and humidity come as events.
    hold : "zero", "zero-before", "first" or "unknown"
    metadata : RunMetadata
        What is known before the first row.
    created_at : str
        ISO 8601.

    Raises
    ------
    InputError
        No uuid, no rate, an unknown or doubled column, no voltage.

    Examples
    --------
    >>> header = JournalHeader("3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee", 50.0, ("voltage", "current", "output_raw"))
    >>> JournalHeader.from_json(header.to_json(), where="it") == header
    True
    """

    uuid: str
    rate: float
    columns: tuple[str, ...]
    hold: Hold = "zero-before"
    metadata: RunMetadata = field(default_factory=RunMetadata)
    created_at: str = ""

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "uuid", str(UUID(self.uuid)))
        except (ValueError, AttributeError, TypeError) as error:
            raise _refusal("uuid", f"{self.uuid!r} is no UUID", "give str(uuid.uuid4())") from error
        if not 0.0 < self.rate < math.inf:
            raise _refusal("rate", f"the rate is {self.rate!r}, it must be above 0", "give it in Hz")
        if self.hold not in get_args(Hold):
            raise _refusal("hold", f"unknown hold {self.hold!r}", f"use one of {', '.join(get_args(Hold))}")
        object.__setattr__(self, "columns", tuple(self.columns))
        for name in self.columns:
            if name not in COLUMNS:
                raise _refusal("columns", f"unknown column {name!r}", f"known: {', '.join(COLUMNS)}")
            if self.columns.count(name) > 1:
                raise _refusal("columns", f"the column {name!r} is there twice", "give each once")
            if name.endswith("_quality") and name.removesuffix("_quality") not in self.columns:
                raise _refusal("columns", f"{name!r} without its channel", "add the channel, or leave it out")
        if "voltage" not in self.columns:
            raise _refusal("columns", "no column 'voltage'", "add it: without the voltage nothing can be computed")

    def to_json(self) -> bytes:
        """The header as the payload of the first frame.

        Raises
        ------
        InputError
            Metadata that no file can keep.
        """
        table = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "uuid": self.uuid,
            "rate": float(self.rate),
            "columns": list(self.columns),
            "hold": self.hold,
            "created_at": self.created_at,
            "metadata": metadata_table(self.metadata),
        }
        return json.dumps(table).encode()

    @classmethod
    def from_json(cls, payload: bytes, *, where: str) -> JournalHeader:
        """Read what ``to_json`` gave.

        Raises
        ------
        InputError
            No header of a journal, or one of a newer format.
        """
        table: Any = None
        try:
            table = json.loads(payload)
            if table["format"] != FORMAT:
                raise KeyError("format")
            if table["format_version"] > FORMAT_VERSION:
                raise InputError(
                    f"format version {table['format_version']!r}, this ipmclab reads versions up to {FORMAT_VERSION}",
                    code="newer-format",
                    where=where,
                    repair="update ipmclab",
                )
            return cls(
                uuid=table["uuid"],
                rate=table["rate"],
                columns=tuple(table["columns"]),
                hold=table["hold"],
                metadata=parse_metadata(table["metadata"], where=f"{where}: metadata"),
                created_at=str(table["created_at"]),
            )
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(
                "its first frame is no header of a journal",
                code="not-a-journal",
                where=where,
                repair="see which program wrote it",
            ) from error


def _refusal(key: str, message: str, repair: str) -> InputError:
    return InputError(message, code="bad-header", where=f"journal.{key}", repair=repair)
