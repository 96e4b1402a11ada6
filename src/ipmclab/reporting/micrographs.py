"""The micrographs of a sample, carried in its report."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from ipmclab.sample import Sample

_KINDS: Final = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
_LARGEST: Final = 5_000_000
"""Of one picture [bytes]: a report is to be sent by mail."""


@dataclass(frozen=True)
class Micrograph:
    """A picture, or why it is not there.

    Parameters
    ----------
    name : str
        As the sample names it.
    source : str
        The picture itself as a ``data:`` address; empty where it is not there.
    remark : str
        Its checksum, or why it is not there.
    """

    name: str
    source: str
    remark: str


def micrographs(sample: Sample | None) -> Iterator[Micrograph]:
    """Read the pictures of a sample, below the folder where the program was started.

    A run that came from elsewhere may name any file of this computer: others are not read.

    Examples
    --------
    >>> from ipmclab.sample import Sample
    >>> [one.remark for one in micrographs(Sample(id="a", micrographs=("not there.png",)))]
    ['the file is not here']
    """
    for name in () if sample is None else sample.micrographs:
        path = Path(name)
        kind = _KINDS.get(path.suffix.lower())
        if kind is None:
            yield Micrograph(name, "", f"only {', '.join(_KINDS)} are shown")
        elif path.anchor or ".." in path.parts:  # on Windows \\a.png and C:a.png are not absolute, and elsewhere
            yield Micrograph(name, "", "only pictures below the folder of the program are shown")
        elif not path.is_file():
            yield Micrograph(name, "", "the file is not here")
        elif path.stat().st_size > _LARGEST:
            yield Micrograph(name, "", f"larger than {_LARGEST // 1_000_000} MB")
        else:
            content = path.read_bytes()
            text = b64encode(content).decode("ascii")
            yield Micrograph(name, f"data:{kind};base64,{text}", f"SHA-256 {sha256(content).hexdigest()}")
