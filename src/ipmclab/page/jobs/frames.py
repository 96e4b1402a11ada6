"""Frames: a JSON document and arrays of floats as bytes, for workers and for browsers.

Eight bytes (two little-endian uint32: length of the document, length of the arrays), the document as UTF-8, then the
arrays one after another. The document is padded with blanks so that the arrays begin at a multiple of eight bytes, and
``arrays`` in it lists name and length of each: a browser lays a ``Float64Array`` over them without a copy.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from typing import IO, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_LENGTHS: Final = struct.Struct("<II")


class Frame(NamedTuple):
    """A document with its arrays."""

    document: dict[str, Any]
    arrays: dict[str, FloatArray]


def pack(document: Mapping[str, Any], arrays: Mapping[str, npt.ArrayLike] | None = None) -> bytes:
    """A document and its arrays as bytes; numbers of the document that are not finite become null.

    Parameters
    ----------
    document : mapping
        JSON values.
    arrays : mapping of name to float array, shape (n,), optional

    Examples
    --------
    >>> frame = unpack(pack({"a": float("inf")}, {"t": [0.0, 0.02]}))
    >>> frame.document, frame.arrays["t"].tolist()
    ({'a': None}, [0.0, 0.02])
    """
    columns = {name: np.ascontiguousarray(values, dtype="<f8") for name, values in (arrays or {}).items()}
    listed = [[name, len(values)] for name, values in columns.items()]
    text = json.dumps({**finite(document), "arrays": listed}, ensure_ascii=False, allow_nan=False).encode()
    text += b" " * (-len(text) % 8)
    body = b"".join(values.tobytes() for values in columns.values())
    return _LENGTHS.pack(len(text), len(body)) + text + body


def unpack(data: bytes) -> Frame:
    """What ``pack`` made.

    Raises
    ------
    ValueError
        No frame, or not the whole of one.
    """
    if len(data) < _LENGTHS.size:
        raise ValueError("shorter than the head of a frame")
    length, rest = _LENGTHS.unpack_from(data)
    start = _LENGTHS.size + length
    if len(data) != start + rest:
        raise ValueError(f"a frame of {start + rest} bytes in {len(data)}")
    return _frame(data[_LENGTHS.size : start], data[start:])


def read_frame(stream: IO[bytes]) -> Frame | None:
    """The next frame of a stream; None where it ends, also in the middle of a frame."""
    head = stream.read(_LENGTHS.size)
    if len(head) < _LENGTHS.size:
        return None
    length, rest = _LENGTHS.unpack(head)
    text, body = stream.read(length), stream.read(rest)
    return _frame(text, body) if len(text) == length and len(body) == rest else None


def _frame(text: bytes, body: bytes) -> Frame:
    document = json.loads(text)
    arrays: dict[str, FloatArray] = {}
    at = 0
    for name, length in document.pop("arrays"):
        arrays[name] = np.frombuffer(body, dtype="<f8", count=length, offset=at)
        at += 8 * length
    return Frame(document, arrays)


def finite(value: Any) -> Any:
    """A value as JSON can hold it: plain numbers, None for one that is not finite, lists, text."""
    if isinstance(value, Mapping):
        return {str(key): finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [finite(one) for one in value]
    if isinstance(value, np.ndarray | np.generic):
        return finite(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    return str(value)
