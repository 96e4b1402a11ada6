"""How much a foreign record holds once it is unpacked: looked at before it is read, since memory has an end."""

from __future__ import annotations

import gzip
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import InputError

_MOST_TEXT: Final = 512 * 1024 * 1024
_MOST_NUMBERS: Final = 4 * 1024 * 1024 * 1024
"""Bytes of a packed record: of one that is text, which takes up to 25 times as much once it is read, and of numbers."""

_PIECE: Final = 1 << 20
_COMPRESSED: Final = 15  # type of an element of a MATLAB file of version 5
_HEAD: Final = 128


def refuse_large(path: Path, most: int | None = None) -> None:
    """Refuse a record that would unpack to more than can be held, however small its file is.

    Parameters
    ----------
    path : Path
    most : int, optional [bytes]
        What can be held; without it what a computer of today can, for a file that is packed.

    Raises
    ------
    InputError
        It holds more.
    """
    try:
        with path.open("rb") as stream:
            is_matlab = stream.read(6) in (b"MATLAB", b"\x89HDF\r\n")
        bound = most if most is not None else _MOST_NUMBERS if is_matlab else _MOST_TEXT
        size = unpacked_size(path, bound)
    except FileNotFoundError as error:
        raise InputError(
            "this record is not kept any more", code="no-such-file", where=path.name, repair="choose it once more"
        ) from error
    except Exception:  # what cannot be unpacked is reported by its importer
        return
    if size > bound and (most is not None or size > path.stat().st_size):
        raise InputError(
            f"unpacked it has more than {bound // 2**20} MiB, the most that is read here",
            code="too-large",
            where=path.name,
            repair="save it in parts"
            + ("; or use ipmclab import at the terminal, which reads more" if most is not None else ""),
        )


def unpacked_size(path: Path, most: int) -> int:
    """The bytes of a file when it is unpacked; counted no further than to what is too much."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        start = stream.read(_HEAD)
        if start.startswith(b"\x1f\x8b"):
            stream.seek(0)
            return _gzip(stream, most)
        if start.startswith(b"MATLAB 5.0"):
            return size + _matlab_5(stream, "<" if start.endswith(b"IM") else ">", most)
    if start.startswith(b"PK\x03\x04"):
        with zipfile.ZipFile(path) as book:
            return sum(part.file_size for part in book.infolist())
    if start.startswith((b"MATLAB 7.3", b"\x89HDF")):
        return _hdf5(path)
    return size


def _gzip(stream: Any, most: int) -> int:
    size = 0
    with gzip.open(stream) as text:
        while size <= most and (piece := text.read(_PIECE)):
            size += len(piece)
    return size


def _matlab_5(stream: Any, order: str, most: int) -> int:
    """What the compressed elements of a MATLAB file hold."""
    size = 0
    while size <= most and len(tag := stream.read(8)) == 8:
        kind, length = struct.unpack(f"{order}II", tag)
        if kind != _COMPRESSED:
            stream.seek(length + -length % 8, 1)
            continue
        unpacker = zlib.decompressobj()
        packed = stream.read(length)
        while packed and size <= most:
            size += len(unpacker.decompress(packed, _PIECE))
            packed = unpacker.unconsumed_tail
    return size


def _hdf5(path: Path) -> int:
    import h5py

    sizes: list[int] = []
    with h5py.File(path, "r") as file:
        file.visititems(lambda _, item: sizes.append(item.nbytes) if isinstance(item, h5py.Dataset) else None)
    return sum(sizes)
