"""Runs on disk: the run file, importers of foreign records, and exports."""

from __future__ import annotations

from ipmclab.store.exporting import export_run as export_run
from ipmclab.store.guess import Guess as Guess
from ipmclab.store.guess import guess_map as guess_map
from ipmclab.store.import_map import ImportMap as ImportMap
from ipmclab.store.import_map import load_import_map as load_import_map
from ipmclab.store.importing import import_run as import_run
from ipmclab.store.run_file import read_run as read_run
from ipmclab.store.run_file import write_run as write_run

__all__ = ["Guess", "ImportMap", "export_run", "guess_map", "import_run", "load_import_map", "read_run", "write_run"]
