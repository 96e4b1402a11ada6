"""A foreign record becomes a run of the lab folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.tasks.room import refuse_large_here

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Import the file ``path`` with the table ``map``; written to ``out`` where that is given, else only tried.

    ``name`` is what its owner calls the file, where it was sent and is kept under another name.

    Raises
    ------
    InputError
        What ``import_run`` refuses, with the key of the map; or it holds too much.
    """
    from ipmclab.page.jobs.tasks.given import finding_row
    from ipmclab.quality import check
    from ipmclab.run import SLOW_CHANNELS
    from ipmclab.store.import_map import ImportMap
    from ipmclab.store.importing import import_run, unmet_sentinels
    from ipmclab.store.run_file import write_run

    progress("importing")
    refuse_large_here(Path(arguments["path"]))
    table = arguments["map"]
    import_map = ImportMap.from_table(table, where="map") if table else None
    imported = import_run(arguments["path"], import_map)
    if table and arguments.get("name"):
        imported = replace(imported, metadata=replace(imported.metadata, source_file=arguments["name"]))
    if arguments.get("out"):
        write_run(imported, arguments["out"], overwrite=bool(arguments.get("overwrite")))
    progress("checking the run")
    document = {
        "rows": len(imported),
        "duration": imported.time[-1] - imported.time[0],
        "rate": imported.rate,
        "findings": [finding_row(one, imported) for one in check(imported)],
        "unmet": unmet_sentinels(imported, import_map) if import_map else [],
        "out": arguments.get("out"),
    }
    slow = SLOW_CHANNELS if imported.time_environment is not None else ()
    at_rows = {name: values for name, values in imported.channels.items() if name not in slow}
    return Frame(document, {"time": imported.time, **at_rows})
