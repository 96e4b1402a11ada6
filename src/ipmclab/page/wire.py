"""What goes between page and browser: arrays under a JSON head, aligned for JavaScript, and JSON that was asked."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError

if TYPE_CHECKING:
    from fastapi import Request

FloatArray = npt.NDArray[np.float64]

MEDIA: Final = "application/octet-stream"
BAD_REQUEST: Final = "bad-request"
"""Code of the error of a request that no page of ours makes: 400."""

_MOST_ASKED: Final = 256 * 1024
_LENGTH: Final = struct.Struct("<I")


def pack(head: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> bytes:
    """One message: length of the head (uint32, little-endian), the head, then the arrays as float64.

    The head is padded with spaces so that the first array starts at a multiple of 8 bytes; under ``"arrays"`` it has
    the name and length of each, in their order.

    Examples
    --------
    >>> message = pack({"kind": "rows"}, {"time": np.array([0.0, 0.5])})
    >>> len(message) % 8, message[4:20]
    (0, b'{"kind": "rows",')
    """
    columns = {name: np.ascontiguousarray(array, dtype="<f8") for name, array in arrays.items()}
    text = json.dumps({**head, "arrays": [[name, len(one)] for name, one in columns.items()]}).encode()
    text += b" " * (-(len(text) + _LENGTH.size) % 8)
    return b"".join([_LENGTH.pack(len(text)), text, *(one.tobytes() for one in columns.values())])


async def read_object(request: Request) -> dict[str, Any]:
    """The JSON object that was asked; empty where nothing was sent.

    Raises
    ------
    InputError
        Too long, no JSON object, or no text.
    """
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > _MOST_ASKED:
            break
    try:
        found = json.loads(body or b"{}") if len(body) <= _MOST_ASKED else None
        json.dumps(found, ensure_ascii=False).encode()  # half a pair of UTF-16 is no text: nobody could write it down
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise InputError(
            f"this is no JSON object of at most {_MOST_ASKED // 1024} KiB of text in UTF-8",
            code=BAD_REQUEST,
            where="request",
            repair="reload the page",
        )
    return found
