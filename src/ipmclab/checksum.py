"""The checksum of a run's numbers: one for each array, which a long record gives piece by piece, then one of these."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt


class ArrayChecksum:
    """SHA-256 of an array of float64 or uint8 that comes in pieces.

    Examples
    --------
    >>> whole, pieces = ArrayChecksum(), ArrayChecksum()
    >>> whole.update(np.array([0.0, 1.0, 2.0]))
    >>> pieces.update(np.array([0.0]))
    >>> pieces.update(np.array([1.0, 2.0]))
    >>> whole.digest() == pieces.digest()
    True
    """

    def __init__(self) -> None:
        self._sha256 = hashlib.sha256()
        self._kind = ""
        self._length = 0

    def update(self, values: npt.NDArray[Any]) -> None:
        """Add the values that follow."""
        piece = np.ascontiguousarray(values)
        if piece.dtype == np.float64:
            missing = np.isnan(piece)
            if missing.any():  # NaN has many bit patterns (-nan differs), and texts keep only one
                piece = np.where(missing, np.nan, piece)
        self._kind = piece.dtype.newbyteorder("<").str
        self._length += len(piece)
        self._sha256.update(piece.astype(self._kind, copy=False).data)

    def digest(self) -> str:
        """Kind, length and checksum of the values so far."""
        return f"{self._kind} {self._length} {self._sha256.hexdigest()}"


def file_checksum(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def content_checksum(hold: str, digests: Mapping[str, str]) -> str:
    """SHA-256 of a run's hold and of the digests of its arrays, by their names.

    Parameters
    ----------
    hold : str
    digests : mapping of name to str
        What ``ArrayChecksum.digest`` gives for each array, under its name in files.
    """
    lines = [f"ipmclab run, hold {hold}", *(f"{name} {digests[name]}" for name in sorted(digests))]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
