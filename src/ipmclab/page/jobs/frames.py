"""Frames: a JSON document and arrays of floats on their way between the server and its workers."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from typing import IO, Any, Final, NamedTuple

import numpy as np

from ipmclab.page import wire
from ipmclab.page.wire import FloatArray

_LENGTH: Final = struct.Struct("<I")


class Frame(NamedTuple):
    """A document with its arrays."""

    document: dict[str, Any]
    arrays: dict[str, FloatArray]


def pack(document: Mapping[str, Any], arrays: Mapping[str, FloatArray] | None = None) -> bytes:
    """The length of a message of ``wire``, and the message.

    Parameters
    ----------
    document : mapping
        JSON values; numbers that are not finite become null.
    arrays : mapping of name to float array, shape (n,), optional

    Examples
    --------
    >>> import io
    >>> frame = read_frame(io.BytesIO(pack({"a": float("inf")}, {"t": np.array([0.0, 0.02])})))
    >>> frame.document, frame.arrays["t"].tolist()
    ({'a': None}, [0.0, 0.02])
    """
    message = wire.pack(finite(document), arrays or {})
    return _LENGTH.pack(len(message)) + message


def read_frame(stream: IO[bytes]) -> Frame | None:
    """The next frame of a stream; None where it ends, also in the middle of a frame."""
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(head)
    message = stream.read(length)
    return _frame(message) if len(message) == length else None


def _frame(message: bytes) -> Frame:
    (length,) = _LENGTH.unpack_from(message)
    at = _LENGTH.size + length
    document = json.loads(message[_LENGTH.size : at])
    arrays: dict[str, FloatArray] = {}
    for name, count in document.pop("arrays"):
        arrays[name] = np.frombuffer(message, dtype="<f8", count=count, offset=at)
        at += 8 * count
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
