"""A sampled voltage from a file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.csv_file import read_lines, split_heading
from ipmclab.errors import InputError, suggest
from ipmclab.units import TIME, VOLTAGE, Quantity, parse_quantity

FloatArray = npt.NDArray[np.float64]

_COLUMNS: Final[dict[str, Quantity]] = {"time": TIME, "voltage": VOLTAGE}


def read_samples(path: str | Path) -> tuple[FloatArray, FloatArray]:
    """Read the time [s] and the voltage [V] of a sampled signal.

    Parameters
    ----------
    path : str or Path
        A CSV file, or a run (``.nc``). The CSV has either two columns without a heading, time
        in s and voltage in V, or a heading with the columns ``time`` and ``voltage``, each with its
        unit in brackets (``time (ms)``; s and V when there is none); other columns are left out.
        Cells are separated by commas, semicolons or tabs, numbers have a decimal point, and lines
        that start with ``#`` are left out.

    Returns
    -------
    time, voltage : float array, shape (n_time,) [s], [V]

    Raises
    ------
    InputError
        A missing or empty file, or a cell that is not a number, with its line.
    """
    file = Path(path)
    try:
        there = file.is_file()
    except OSError:  # a name that is too long, a folder that is closed
        there = False
    missing = InputError(
        "there is no such file",
        code="missing-file",
        where=str(path),
        repair="check the path; quote it if it has blanks",
    )
    if not there:
        raise missing
    return _read_run(file) if file.suffix.lower() == ".nc" else _read_csv(file, missing)


def _read_run(file: Path) -> tuple[FloatArray, FloatArray]:
    import h5py  # h5netcdf prints a traceback when a file cannot be opened

    try:
        with h5py.File(file, "r") as content:
            time, voltage = (np.asarray(content[name][()], dtype=np.float64) for name in _COLUMNS)
    except Exception as error:  # a damaged file makes HDF5 raise nearly anything, from OSError to RuntimeError
        raise InputError(
            "this is no run with a time and a voltage",
            code="not-a-run",
            where=str(file),
            repair="give a run, or a CSV file of time and voltage",
        ) from error
    return time, voltage


def _read_csv(file: Path, missing: InputError) -> tuple[FloatArray, FloatArray]:
    lines = read_lines(file, missing=missing)
    if not lines:
        raise InputError(
            "the file is empty", code="empty-file", where=str(file), repair="write one line for each time and voltage"
        )
    first = lines[0]
    columns = {name: (place, quantity.unit) for place, (name, quantity) in enumerate(_COLUMNS.items())}
    width = len(first.cells)
    if any(re.search(r"[A-Za-z]", cell) and not _is_number(cell) for cell in first.cells):
        columns = _read_heading(first.cells, where=f"{file}, line {first.number}")
        lines = lines[1:]
    elif width != len(_COLUMNS):
        raise InputError(
            f"{width} columns without a heading",
            code="bad-columns",
            where=f"{file}, line {first.number}",
            repair="give two columns, time in s and voltage in V, or a heading that names them; numbers have a "
            "decimal point",
        )
    values: dict[str, list[float]] = {name: [] for name in _COLUMNS}
    for k, _, cells in lines:
        if len(cells) > width:
            raise InputError(
                f"{len(cells)} cells, the first line has {width}",
                code="bad-columns",
                where=f"{file}, line {k}",
                repair="write numbers with a decimal point, and one cell for each column",
            )
        for name, (place, unit) in columns.items():
            where = f"{file}, line {k}, {name}"
            cell = cells[place].strip() if place < len(cells) else ""
            values[name].append(parse_quantity(f"{cell} {unit}", _COLUMNS[name], where=where))
    return np.array(values["time"]), np.array(values["voltage"])


def _read_heading(cells: list[str], *, where: str) -> dict[str, tuple[int, str]]:
    found: dict[str, tuple[int, str]] = {}
    for place, cell in enumerate(cells):
        written, unit = split_heading(cell)
        name = written.lower()
        if name in found:
            raise InputError(f"two columns are called {name!r}", code="bad-columns", where=where, repair="rename one")
        if name in _COLUMNS:
            found[name] = (place, unit or _COLUMNS[name].unit)
    for name in _COLUMNS:
        if name not in found:
            raise InputError(
                f"no column is called {name!r}", code="bad-columns", where=where, repair=suggest(name, cells)
            )
    return {name: found[name] for name in _COLUMNS}


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
