"""``ipmclab page`` for tests of a browser, forked from a process that has imported it: most of a start is imports.

``tests/page/test_server.py`` and ``tests/cli`` start it as a shell does.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path

LONG = 180_000
"""Milliseconds that a machine may take over what a worker or a recorder does: one that is busy takes long."""

PROCESSES = multiprocessing.get_context("forkserver" if os.name == "posix" else "spawn")
PROCESSES.set_forkserver_preload(
    [__name__, "uvicorn", "ipmclab.cli.page", "ipmclab.page.server", "ipmclab.page.curves", "ipmclab.page.live.routes"]
    + [f"ipmclab.page.sections.{name}" for name in ("run", "runs", "identify", "simulate", "report")]
)


@contextmanager
def served(folder: Path, *options: str) -> Iterator[str]:
    """``ipmclab page`` on a folder: its address."""
    words = (str(folder), "--no-open", *options)
    told, says = PROCESSES.Pipe(duplex=False)
    with tempfile.TemporaryDirectory() as place, told:
        errors = Path(place, "errors.txt")
        errors.touch()
        process = PROCESSES.Process(target=_serve, args=(words, dict(os.environ), says, errors))
        process.start()
        says.close()
        try:
            with os.fdopen(told.fileno(), encoding="utf-8", closefd=False) as lines:
                address = lines.readline().strip()
            assert address.startswith("http"), errors.read_text("utf-8")
            yield address
        finally:
            process.terminate()
            process.join(LONG / 1000)
            assert process.exitcode is not None, "the server does not end"
            written = errors.read_text("utf-8")
    assert "Traceback" not in written, written


def _serve(words: tuple[str, ...], environment: dict[str, str], says: Connection, errors: Path) -> None:
    """The command line in the environment of the test, with a pipe and a file for what it prints."""
    os.environ.clear()
    os.environ.update(environment)
    os.dup2(says.fileno(), 1)
    with errors.open("w", encoding="utf-8") as file:
        os.dup2(file.fileno(), 2)
    sys.stdout, sys.stderr = (os.fdopen(one, "w", encoding="utf-8", closefd=False) for one in (1, 2))
    sys.argv = ["ipmclab", "page", *words]
    from ipmclab.cli import main

    main()
