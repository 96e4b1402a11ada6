"""Arrays on their way to a browser: a JSON head and float64 columns in one binary message, aligned for JavaScript."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

MEDIA: Final = "application/octet-stream"
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
