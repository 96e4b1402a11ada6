"""How much a foreign record holds once it is unpacked: looked at before it is read, since a worker's memory is not."""

from __future__ import annotations

import gzip
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import InputError

MOST_UNPACKED: Final = 128 * 1024 * 1024
"""Bytes of a record: read as text it takes a worker up to 25 times as much."""

_PIECE: Final = 1 << 20
_COMPRESSED: Final = 15  # type of an element of a MATLAB file of version 5
_HEAD: Final = 128


def refuse_large(path: Path) -> None:
    """Refuse a record that would unpack to more than a worker should hold, however small its file is.

    Raises
    ------
    InputError
        It holds more than ``MOST_UNPACKED`` bytes, or is not there any more.
    """
    try:
        size = unpacked_size(path)
    except FileNotFoundError as error:
        raise InputError(
            "this record is not kept any more", code="no-such-file", where=path.name, repair="choose it once more"
        ) from error
    except Exception:  # what cannot be unpacked is told by its importer
        size = path.stat().st_size
    if size > MOST_UNPACKED:
        raise InputError(
            f"unpacked it has more than {MOST_UNPACKED // 2**20} MiB, the most that is read here",
            code="too-large",
            where=path.name,
            repair="save a part of it; or use ipmclab import at the terminal, which has no bound",
        )


def unpacked_size(path: Path) -> int:
    """The bytes of a file when it is unpacked; counted no further than to what is too much."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        start = stream.read(_HEAD)
        if start.startswith(b"\x1f\x8b"):
            stream.seek(0)
            return _gzip(stream)
        if start.startswith(b"MATLAB 5.0"):
            return size + _matlab_5(stream, "<" if start.endswith(b"IM") else ">")
    if start.startswith(b"PK\x03\x04"):
        with zipfile.ZipFile(path) as book:
            return sum(part.file_size for part in book.infolist())
    if start.startswith((b"MATLAB 7.3", b"\x89HDF")):
        return _hdf5(path)
    return size


def _gzip(stream: Any) -> int:
    size = 0
    with gzip.open(stream) as text:
        while size <= MOST_UNPACKED and (piece := text.read(_PIECE)):
            size += len(piece)
    return size


def _matlab_5(stream: Any, order: str) -> int:
    """What the compressed elements of a MATLAB file hold."""
    size = 0
    while size <= MOST_UNPACKED and len(tag := stream.read(8)) == 8:
        kind, length = struct.unpack(f"{order}II", tag)
        if kind != _COMPRESSED:
            stream.seek(length + -length % 8, 1)
            continue
        unpacker = zlib.decompressobj()
        packed = stream.read(length)
        while packed and size <= MOST_UNPACKED:
            size += len(unpacker.decompress(packed, _PIECE))
            packed = unpacker.unconsumed_tail
    return size


def _hdf5(path: Path) -> int:
    import h5py

    sizes: list[int] = []
    with h5py.File(path, "r") as file:
        file.visititems(lambda _, item: sizes.append(item.nbytes) if isinstance(item, h5py.Dataset) else None)
    return sum(sizes)
