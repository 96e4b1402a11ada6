"""Runs as people name them: by what they say of themselves, else by their file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ipmclab.run import Run
from ipmclab.store.run_file import read_run


def read_named_run(path: str | Path) -> Run:
    """Read a run; one that says neither its source nor its signal is known by its file in tables and findings.

    Raises
    ------
    InputError
        A file that is no run.
    """
    run = read_run(path)
    if run.metadata.source_file is None and run.metadata.signal is None:
        return replace(run, metadata=replace(run.metadata, source_file=Path(path).name))
    return run
