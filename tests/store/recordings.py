"""Journals of recordings that have ended, for tests of what becomes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from ipmclab.run import QUALITY_FLAGS, Run, RunMetadata
from ipmclab.store.journal.finalise import finish_here
from ipmclab.store.journal.journal import Journal, JournalHeader
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.run_file import read_run

COLUMNS = ("voltage", "current", "force", "current_quality", "force_quality", "force_raw", "output_raw")


def values(count: int) -> np.ndarray:
    noise = np.random.default_rng(20261121).normal(size=(count, len(COLUMNS)))
    noise[:, COLUMNS.index("current_quality")] = 0.0
    noise[:, COLUMNS.index("force_quality")] = np.arange(count) % 3 * QUALITY_FLAGS["clipped"]
    noise[::7, COLUMNS.index("force")] = np.nan
    return noise


def recorded(root: Path, table: np.ndarray | None = None, *, end: str | None = "complete", **about: Any) -> Path:
    """A journal of these rows."""
    table = values(200) if table is None else table
    header = JournalHeader(str(uuid4()), 50.0, COLUMNS, metadata=RunMetadata(**about))
    journal = Journal.create(root, header, ballast=0)
    for first in range(0, len(table), 70):
        journal.append(first, table[first : first + 70])
    if end is None:
        journal.close()
        return journal.path
    return journal.end(end, "")  # type: ignore[arg-type]


def finished(journal: Path) -> Run:
    """The run of a journal, finished in this process."""
    return read_run(finish_here(journal, Laboratory.open(journal.parent.parent)).path)
