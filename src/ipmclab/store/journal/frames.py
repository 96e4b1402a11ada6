"""The frames of a journal: a header with two checksums, then the payload. Only whole frames are ever believed."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, Final

DATA: Final = 0
HEADER: Final = 1
EVENT: Final = 2
END: Final = 4

MAGIC: Final = b"RUNF"
_FRAME: Final = struct.Struct(
    "<4sHHIIQQI"
)  # magic, kind, columns, rows, length, sequence, first row, CRC of the payload
_CRC: Final = struct.Struct("<I")  # of the 36 bytes before
HEADER_SIZE: Final = _FRAME.size + _CRC.size
_WINDOW: Final = 1 << 20


@dataclass(frozen=True)
class Frame:
    """A whole frame.

    Parameters
    ----------
    kind : int
        ``HEADER`` (JSON: what is recorded), ``DATA`` (rows x columns of little-endian float64), ``EVENT`` (JSON),
        or ``END`` (JSON: how it ended).
    payload : bytes
    sequence : int
        Counts the frames from 0.
    columns, rows, first_row : int
        Of ``DATA``: the row of the run that its first row is.
    offset : int [bytes]
        Where it starts in the file.
    """

    kind: int
    payload: bytes
    sequence: int
    columns: int = 0
    rows: int = 0
    first_row: int = 0
    offset: int = 0

    def __len__(self) -> int:
        return HEADER_SIZE + len(self.payload)

    def encode(self) -> bytes:
        """The bytes of the frame in the file."""
        start = _FRAME.pack(
            MAGIC,
            self.kind,
            self.columns,
            self.rows,
            len(self.payload),
            self.sequence,
            self.first_row,
            zlib.crc32(self.payload),
        )
        return start + _CRC.pack(zlib.crc32(start)) + self.payload


@dataclass(frozen=True)
class Damage:
    """Bytes from ``start`` to ``stop`` that are no whole frame, and what is wrong with the first of them."""

    start: int
    stop: int
    reason: str

    def __len__(self) -> int:
        return self.stop - self.start


def read_frames(stream: BinaryIO) -> Iterator[Frame | Damage]:
    """Every whole frame of a journal, in order, and the damage between and after them.

    A damaged frame takes none of its followers with it: reading continues at the next whole frame with a higher number.

    Parameters
    ----------
    stream : binary file
        Read from its start.
    """
    size = stream.seek(0, 2)
    place = least = 0
    while place < size:
        found = _frame_at(stream, place, size, least)
        if isinstance(found, Frame):
            yield found
            place, least = place + len(found), found.sequence + 1
            continue
        following = _next_frame(stream, place + 1, size, least)
        yield Damage(place, following, found)
        place = following


def _frame_at(stream: BinaryIO, place: int, size: int, least: int) -> Frame | str:
    """The frame that starts there, with this number or a higher one, or why there is none."""
    stream.seek(place)
    head = stream.read(HEADER_SIZE)
    if len(head) < HEADER_SIZE:
        return "it ends inside the head of a frame"
    magic, kind, columns, rows, length, sequence, first_row, checksum = _FRAME.unpack_from(head)
    if magic != MAGIC or zlib.crc32(head[: _FRAME.size]) != _CRC.unpack_from(head, _FRAME.size)[0]:
        return "the head of a frame is damaged"
    if place + HEADER_SIZE + length > size:
        return "it ends inside a frame"
    payload = stream.read(length)
    if zlib.crc32(payload) != checksum:
        return "the content of a frame is damaged"
    if sequence < least or (kind == DATA and rows * columns * 8 != length):
        return "a frame is out of order"
    return Frame(kind, payload, sequence, columns, rows, first_row, place)


def _next_frame(stream: BinaryIO, start: int, size: int, least: int) -> int:
    """Where the next whole frame starts; the end of the file when there is none."""
    while True:
        stream.seek(start)
        window = stream.read(_WINDOW)
        for letters in re.finditer(MAGIC, window):
            place = start + letters.start()
            if isinstance(_frame_at(stream, place, size, least), Frame):
                return place
        if len(window) < _WINDOW:
            return size
        start += len(window) - len(MAGIC)  # the letters may stand in two windows
