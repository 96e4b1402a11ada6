"""A run on disk: one netCDF-4 file that MATLAB, Python, LabVIEW and HDFView open."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from ipmclab.destination import replacing
from ipmclab.errors import InputError, IpmclabError
from ipmclab.kinds import tell_kinds
from ipmclab.run import QUALITY_FLAGS, SLOW_CHANNELS, Run, raw_name
from ipmclab.store.document import checked, flat_attributes, from_document, to_document
from ipmclab.store.heap import refuse_endless_heap
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    import h5netcdf
    import h5py

_HDF5_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
CHUNK_ROWS: Final = 65536  # half a megabyte of float64: read whole in one piece, small enough to page


@tell_kinds
def write_run(run: Run, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write a run to a netCDF-4 file.

    The file is written next to its target, read back, compared, and only then renamed to it.

    Parameters
    ----------
    run : Run
    path : str or path
        A name that ends in ``.nc``, in a folder that exists.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        Another ending, no such folder, an existing file, or a run that could not be read back.
    IpmclabError
        The system refuses to write there, or what was read back differs.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> run = Run.from_arrays(time=[0.0, 0.02, 0.04], voltage=[0.0, 1.0, 1.0], current=[0.0, 0.06, 0.05])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_run(run, pathlib.Path(folder) / "step.nc")
    ...     read_run(pathlib.Path(folder) / "step.nc").current
    array([0.  , 0.06, 0.05])
    """
    target = Path(path)
    if target.suffix != ".nc":
        raise InputError(
            f"a run file ends in .nc, not in {target.suffix!r}",
            code="bad-ending",
            where=str(target),
            repair="name it .nc, or export the run to .csv, .xlsx or .mat",
        )
    run = checked(run)
    document = to_document(run)
    with replacing(target, overwrite=overwrite) as temporary:
        _write(run, document, temporary)
        _verify(run, temporary, target)


@tell_kinds
def read_run(path: str | os.PathLike[str]) -> Run:
    """Read a run from its netCDF-4 file.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    run : Run

    Raises
    ------
    InputError
        No such file, an empty, truncated or damaged one, a file that is not a run, a run of a
        newer format, or a checksum that does not match.

    Examples
    --------
    >>> read_run("nowhere.nc")
    Traceback (most recent call last):
    ipmclab.errors.InputError: nowhere.nc: no such file; see where the run was written
    """
    source = Path(path)
    where = str(source)
    _check_signature(source)
    refuse_endless_heap(source)
    import h5py  # h5netcdf would be slower to load, and prints a traceback when a file cannot be opened

    try:
        with h5py.File(source, "r") as file:
            document, checksum = _text(file, "metadata_json"), _text(file, "metadata_sha256")
            there = {name: item for name, item in file.items() if isinstance(item, h5py.Dataset)}
            arrays = {name: np.asarray(item[()]) for name, item in there.items() if _is_ours(name)}
    except Exception as error:  # a damaged file makes HDF5 raise nearly anything, from OSError to KeyError
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        cut = "truncated" in reason
        raise InputError(
            f"the file is {'truncated' if cut else 'damaged'}: {reason}",
            code="truncated-file" if cut else "damaged-file",
            where=where,
            repair="copy it again from where it was recorded",
        ) from error
    if document is None:
        raise InputError(
            f"a netCDF file, but no run: it has no attribute metadata_json (variables: {', '.join(there) or 'none'})",
            code="not-a-run",
            where=where,
            repair="import a foreign record with an import map",
        )
    if checksum != _sha256(document):
        raise InputError(
            f"the checksum of the metadata does not match: metadata_sha256 is {checksum!r} in the file "
            f"and {_sha256(document)!r} of what was read",
            code="checksum",
            where=f"{where}: metadata_json",
            repair="the metadata were changed after they were written: take another copy of the file",
        )
    return replace(from_document(document, arrays, where=where), file=source.name)


def peek(path: str | os.PathLike[str], names: Collection[str]) -> dict[str, str]:
    """Some of what a run notes, as its file has it for people; nothing is checked.

    Parameters
    ----------
    path : str or path
    names : collection of str
        Such as ``"purpose"`` and ``"signal"``.

    Returns
    -------
    noted : mapping of name to str
        Without what the run does not note; empty where this is no run that can be read.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from ipmclab.run import RunMetadata
    >>> run = Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 0.0], metadata=RunMetadata(signal="step 0 V"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_run(run, pathlib.Path(folder) / "still.nc")
    ...     peek(pathlib.Path(folder) / "still.nc", ("purpose", "signal"))
    {'signal': 'step 0 V'}
    """
    source = Path(path)
    try:
        refuse_endless_heap(source)
        import h5py

        with h5py.File(source, "r") as file:
            found = {name: _text(file, name) for name in names if name in file.attrs}
    except Exception:  # whoever reads the file learns it
        return {}
    return {name: text for name, text in found.items() if text is not None}


def _check_signature(source: Path) -> None:
    where = str(source)
    try:
        if source.is_dir():
            raise InputError(
                "this is a folder",
                code="is-a-folder",
                where=where,
                repair=f"name a run file in it; commands take {source.as_posix()}/**/*.nc for all of them",
            )
        with source.open("rb") as stream:
            start = stream.read(len(_HDF5_SIGNATURE))
    except FileNotFoundError as error:
        raise InputError(
            "no such file", code="no-such-file", where=where, repair="see where the run was written"
        ) from error
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(
            f"it cannot be opened: {error}", code="unreadable-file", where=where, repair="see that you may read it"
        ) from error
    if not start:
        raise InputError(
            "the file is empty (0 bytes)",
            code="empty-file",
            where=where,
            repair="copy it again from where it was recorded",
        )
    if len(start) < len(_HDF5_SIGNATURE) and _HDF5_SIGNATURE.startswith(start):
        raise InputError(
            f"the file is truncated: {len(start)} bytes",
            code="truncated-file",
            where=where,
            repair="copy it again from where it was recorded",
        )
    if start != _HDF5_SIGNATURE:
        raise InputError(
            "this is not a netCDF-4 file",
            code="not-a-run",
            where=where,
            repair="import a foreign record with an import map",
        )


def _verify(run: Run, written: Path, target: Path) -> None:
    try:
        same = read_run(written).content_sha256 == run.content_sha256
    except InputError:
        same = False
    if not same:
        raise IpmclabError(
            "what was read back differs from what was written",
            code="write-failed",
            where=str(target),
            repair="see that the disk is sound and has room",
        )


def _is_ours(name: str) -> bool:
    if name.endswith("_raw"):
        return name.removesuffix("_raw") in (*CHANNELS, "output")
    return name.removesuffix("_quality") in CHANNELS or name in ("time", "time_environment")


def _text(file: h5py.File, attribute: str) -> str | None:
    value = file.attrs.get(attribute)
    return value.decode() if isinstance(value, bytes) else value if isinstance(value, str) else None


def _sha256(text: str) -> str:
    # HDF5 passes bytes that are no UTF-8 (a damaged file) as surrogates: they are counted as those bytes.
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()


def _write(run: Run, document: str, path: Path) -> None:
    import h5netcdf

    with h5netcdf.File(path, "w") as file:
        lengths = {name: len(values) for name, values in run.arrays.items()}
        add_variables(file, lengths)
        for name, values in run.arrays.items():
            file[name][:] = values
        file.attrs.update(attributes_in_file(document, flat_attributes(run)))


def add_variables(file: h5netcdf.File, lengths: Mapping[str, int]) -> None:
    """Make the dimensions and the variables of a run in an empty file.

    Parameters
    ----------
    file : h5netcdf.File
    lengths : mapping of name to int
        Of every array, under its name in files.
    """
    file.dimensions["time"] = lengths["time"]
    if "time_environment" in lengths:
        file.dimensions["time_environment"] = lengths["time_environment"]
    slow = ("time_environment", *SLOW_CHANNELS) if "time_environment" in lengths else ()
    for name, length in lengths.items():
        channel = name.removesuffix("_quality")
        variable = file.create_variable(
            name,
            ("time_environment" if channel in slow else "time",),
            np.uint8 if name.endswith("_quality") else np.float64,
            chunks=(min(length, CHUNK_ROWS),),
            compression="gzip",
            compression_opts=1,
            shuffle=True,
            fletcher32=True,
        )
        if name in CHANNELS:
            variable.attrs["units"] = CHANNELS[name].unit
            variable.attrs["long_name"] = CHANNELS[name].name
        elif channel in CHANNELS:
            variable.attrs["flag_masks"] = np.array(list(QUALITY_FLAGS.values()), dtype=np.uint8)
            variable.attrs["flag_meanings"] = " ".join(QUALITY_FLAGS)
        elif name.endswith("_raw"):
            variable.attrs["units"] = "V"
            variable.attrs["long_name"] = raw_name(name.removesuffix("_raw"))
        else:
            variable.attrs["units"] = "s"
            variable.attrs["long_name"] = "time"


def attributes_in_file(document: str, texts: Mapping[str, str]) -> dict[str, str]:
    """What the file of a run says it is, attribute by attribute: its metadata for people, and as one document."""
    shown = {name: text.replace("\0", "\N{REPLACEMENT CHARACTER}") for name, text in texts.items()}
    return {"Conventions": "CF-1.11", **shown, "metadata_json": document, "metadata_sha256": _sha256(document)}
