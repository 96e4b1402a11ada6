"""Records as LabVIEW TDMS files, through npTDMS."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ipmclab.errors import InputError
from ipmclab.extras import package
from ipmclab.store.importers.columns import Clock, Columns, clocks_from, open_error
from ipmclab.store.strict import Strict


class TdmsFile(Strict):
    """A TDMS file. Its columns are named ``group/channel``; waveforms bring their sampling period."""

    format: Literal["tdms"]


def read(path: Path, options: TdmsFile) -> Columns:  # noqa: ARG001  # every importer takes its options
    """Read the channels of a TDMS file.

    Raises
    ------
    InputError
        npTDMS is not installed, or the file is damaged, truncated or without channels.
    """
    nptdms = package("nptdms", extra="tdms", where=str(path), known_as="npTDMS, which reads TDMS files,")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # npTDMS warns of what is refused below
            file = nptdms.TdmsFile.read(path)
        channels = [channel for group in file.groups() for channel in group.channels()]
        cells = tuple(np.asarray(channel[:]) for channel in channels)
        clocks = _clocks([channel.properties for channel in channels])
        cut = file.file_status.incomplete_final_segment
    except Exception as error:  # a damaged file raises whatever its reader stumbles over
        raise open_error(path, error, "TDMS") from error
    if cut:
        raise InputError(
            "the file is truncated: its last segment is not whole",
            code="truncated-file",
            where=str(path),
            repair="copy the file again from where it was recorded",
        )
    if not channels:
        raise InputError(
            "no channels in it", code="empty-file", where=str(path), repair="see that the record was saved"
        )
    names = tuple(f"{channel.group_name}/{channel.name}" for channel in channels)
    return Columns(
        file=str(path),
        names=names,
        cells=cells,
        place=lambda row, column: f"{names[column]}, sample {row}",
        clocks=clocks,
        units=tuple(str(channel.properties.get("unit_string", "")) for channel in channels),
    )


def _clocks(channels: list[dict[str, Any]]) -> tuple[Clock | None, ...]:
    """The clock of each channel that brings its sampling period."""
    started = [properties.get("wf_start_time") for properties in channels]
    first = next((time for time in started if time is not None), None)
    clocks = clocks_from(
        [float(properties.get("wf_start_offset", 0.0)) for properties in channels],
        [float(properties.get("wf_increment", 0.0)) for properties in channels],
        [None if time is None else float((time - first) / np.timedelta64(1, "s")) for time in started],
    )
    return tuple(clock if clock.period else None for clock in clocks)
