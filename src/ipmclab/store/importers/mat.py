"""Records as MATLAB files: version 5 (``-v6``, ``-v7``) through SciPy, version 7.3 through h5py."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.store.heap import refuse_endless_heap
from ipmclab.store.importers.columns import Columns, open_error
from ipmclab.store.strict import Strict

_NUMERIC: Final = frozenset(
    ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
)


class MatFile(Strict):
    """A MATLAB file of either version.

    Its columns are the vectors in it. Column k of a matrix ``data`` is ``data[k]``, counted from 0 along
    its shorter side; field ``current`` of a structure ``run`` is ``run.current``.
    """

    format: Literal["mat"]


def read(path: Path, options: MatFile) -> Columns:  # noqa: ARG001  # every importer takes its options
    """Read the vectors of a MATLAB file.

    Raises
    ------
    InputError
        Not a MATLAB file, a damaged one, or one without numbers.
    """
    with path.open("rb") as stream:
        version_7_3 = b"MATLAB 7.3" in stream.read(128)
    if version_7_3:
        refuse_endless_heap(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about variables that SciPy cannot read, which no map can name
            arrays = _read_7_3(path) if version_7_3 else _read_5(path)
    except Exception as error:  # a damaged file raises whatever its reader stumbles over
        raise open_error(path, error, "a MATLAB file") from error
    columns: dict[str, npt.NDArray[Any]] = {}
    for name, array in arrays.items():
        columns.update(_vectors(name, array))
    if not columns:
        raise InputError(
            "no vectors of numbers in it",
            code="empty-file",
            where=str(path),
            repair="save the arrays themselves: a timetable or an object can be read by MATLAB only",
        )
    names = tuple(columns)
    return Columns(
        file=str(path),
        names=names,
        cells=tuple(columns.values()),
        place=lambda row, column: f"{names[column]}, element {row} counted from 0",
    )


def _vectors(name: str, array: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    squeezed = np.squeeze(array)
    if squeezed.ndim == 1:
        return {name: squeezed}
    if squeezed.ndim == 2:
        table = squeezed if squeezed.shape[0] >= squeezed.shape[1] else squeezed.T
        return {f"{name}[{k}]": table[:, k] for k in range(table.shape[1])}
    return {}


def _read_5(path: Path) -> dict[str, npt.NDArray[Any]]:
    import scipy.io

    found: dict[str, npt.NDArray[Any]] = {}

    def collect(name: str, value: Any) -> None:
        if not isinstance(value, np.ndarray):
            return
        if value.dtype.names and value.size == 1:
            for field in value.dtype.names:
                collect(f"{name}.{field}", value.item()[value.dtype.names.index(field)])
        elif value.dtype.kind in "iufb":
            found[name] = value

    for name, value in scipy.io.loadmat(str(path), appendmat=False).items():
        if not name.startswith("__"):
            collect(name, value)
    return found


def _read_7_3(path: Path) -> dict[str, npt.NDArray[Any]]:
    import h5py

    found: dict[str, npt.NDArray[Any]] = {}

    def collect(name: str, item: Any) -> None:
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode() if isinstance(kind, bytes) else str(kind)
        if isinstance(item, h5py.Dataset) and kind in _NUMERIC and not item.attrs.get("MATLAB_empty", 0):
            found[name.replace("/", ".")] = np.asarray(item[()]).T  # MATLAB stores the first dimension last

    with h5py.File(path, "r") as file:
        file.visititems(lambda name, item: None if name.startswith("#") else collect(name, item))
    return found
