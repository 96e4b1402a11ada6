"""One importer per file format: each gives the columns of a file, and knows nothing of what they mean."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from pydantic import Field

from ipmclab.errors import InputError
from ipmclab.store.importers import binary, csv, lvm, mat, tdms, xlsx
from ipmclab.store.importers.columns import Columns

File = Annotated[
    binary.BinaryFile | csv.CsvFile | lvm.LvmFile | mat.MatFile | tdms.TdmsFile | xlsx.XlsxFile,
    Field(discriminator="format"),
]
"""How a file is written: the ``[file]`` table of an import map."""


_FIRST_BYTES: Final = (
    (b"PK\x03\x04", "an Excel workbook (.xlsx)", "xlsx"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook of the old kind (.xls)", ""),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file (.mat)", "mat"),
    (b"MATLAB 7.3 MAT-file", "a MATLAB file (.mat)", "mat"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file, such as a run (.nc), which needs no import", ""),
    (b"TDSm", "a LabVIEW TDMS file", "tdms"),
)
"""How files begin that are not text: what they are, and their format in a map where it has one."""


def format_of_start(start: bytes, where: str) -> str:
    """The format of a file that begins so; an empty text where it may be a text table.

    Raises
    ------
    InputError
        A file of a kind that no importer reads.
    """
    for signature, kind, name in _FIRST_BYTES:
        if start.startswith(signature):
            if not name:
                raise InputError(f"this is {kind}", code="other-format", where=where, repair="save it as .xlsx or .csv")
            return name
    return "lvm" if b"LabVIEW Measurement" in start else ""


def read_columns(path: Path, file: File) -> Columns:
    """Read the columns of a file with the importer of its format.

    Raises
    ------
    InputError
        The file is of another kind, by its first bytes, or its importer refuses it.
    """
    with path.open("rb") as stream:
        start = stream.read(32)
    for signature, kind, name in _FIRST_BYTES:
        if start.startswith(signature) and name != file.format:
            raise InputError(
                f"this is {kind}, the map says format = {file.format!r}",
                code="other-format",
                where=str(path),
                repair=f'write format = "{name}" under [file] of the map' if name else "save it as .xlsx or .csv",
            )
    match file:
        case binary.BinaryFile():
            return binary.read(path, file)
        case csv.CsvFile():
            return csv.read(path, file)
        case lvm.LvmFile():
            return lvm.read(path, file)
        case mat.MatFile():
            return mat.read(path, file)
        case tdms.TdmsFile():
            return tdms.read(path, file)
        case xlsx.XlsxFile():
            return xlsx.read(path, file)
