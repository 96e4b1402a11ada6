"""A run as one table: its headings, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.run import SLOW_CHANNELS, Run
from ipmclab.store.document import flag_text, from_document
from ipmclab.store.importers.columns import Columns
from ipmclab.units import CHANNELS


def heading(name: str) -> str:
    """The heading of an array in a table: its name with its unit."""
    if name.endswith("_quality"):
        return name
    return f"{name} ({unit_of(name)})"


def unit_of(name: str) -> str:
    """The unit of an array that has one."""
    return "V" if name.endswith("_raw") else CHANNELS[name].unit if name in CHANNELS else "s"


def notes_of(run: Run) -> dict[str, str]:
    """What a reader of the table has to know of its columns, and no attribute of the run says."""
    slow = [name for name in SLOW_CHANNELS if name in run.arrays] if "time_environment" in run.arrays else []
    notes = {"quality bits": flag_text()} if run.quality else {}
    if slow:
        notes["times"] = (
            f"{' and '.join(slow)}: read at the times in time_environment, not at those in time beside them"
        )
    return notes


def run_of_table(document: str, columns: Columns) -> Run:
    """The run of an exported table, whose columns end with blanks where they are shorter."""
    arrays: dict[str, npt.NDArray[Any]] = {
        name.partition(" (")[0]: columns.numbers(number) for number, name in enumerate(columns.names)
    }
    slow = ("time_environment", *SLOW_CHANNELS) if "time_environment" in arrays else ()
    trimmed = {}
    for name, values in arrays.items():
        times = arrays.get("time_environment" if name.removesuffix("_quality") in slow else "time", values)
        length = int(np.count_nonzero(~np.isnan(times)))
        trimmed[name] = _bits(name, values[:length], columns.file) if name.endswith("_quality") else values[:length]
    return from_document(document, trimmed, where=columns.file)


def _bits(name: str, values: npt.NDArray[Any], where: str) -> npt.NDArray[np.uint8]:
    wrong = np.flatnonzero(~((values >= 0) & (values <= 255) & (values == np.floor(values))))
    if len(wrong):
        raise InputError(
            f"{values[wrong[0]]:g} in row {wrong[0]} is not a set of quality bits",
            code="bad-quality",
            where=f"{where}: {name}",
            repair="export the run again",
        )
    return values.astype(np.uint8)
