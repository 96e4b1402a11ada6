"""A damage that HDF5 never comes back from: its texts lie in heaps, and it walks a broken one for ever."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path
from typing import Final

from ipmclab.errors import InputError

_SIGNATURE: Final = b"GCOL\x01\0\0\0"  # with the version of the format and three bytes that are 0
_HEADER: Final = struct.Struct("<8sQ")  # of a heap: signature, size
_OBJECT: Final = struct.Struct("<HHIQ")  # of an object in it: number, references, nothing, size
_SMALLEST: Final = 4096


def refuse_endless_heap(path: Path) -> None:
    """Refuse an HDF5 file from which the library would read a text for ever.

    Objects of a heap follow each other; number 0 is the free rest, and says how long it is. Where that is 0 the library
    (2.0 and before) steps on by nothing, again and again. One flipped bit in the length of a text leads there.

    Parameters
    ----------
    path : Path
        Of a file that is not empty.

    Raises
    ------
    InputError
        It is such a file.
    """
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        at = content.find(_SIGNATURE)
        while at >= 0:
            if _is_endless(content, at):
                raise InputError(
                    f"the file is damaged: the ends of its texts are lost (heap at byte {at})",
                    code="damaged-file",
                    where=str(path),
                    repair="copy it again from where it was recorded",
                )
            at = content.find(_SIGNATURE, at + 1)


def _is_endless(content: mmap.mmap, at: int) -> bool:
    """Whether a walk over the heap that begins there never ends."""
    if at + _HEADER.size > len(content):
        return False
    size = _HEADER.unpack_from(content, at)[1]
    end = at + size
    if size < _SMALLEST or end > len(content):
        return False  # no heap, or one that the library itself refuses
    place = at + _HEADER.size
    while place + _OBJECT.size <= end:
        number, _, _, length = _OBJECT.unpack_from(content, place)
        step = _OBJECT.size + (length + 7) // 8 * 8 if number else length
        if step % 2**64 == 0:
            return True
        place += step
    return False
