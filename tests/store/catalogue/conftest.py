"""A PostgreSQL server of the tests' own, and folders of runs that both databases are tried on."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab.run import Run, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.catalogue import Catalogue
from ipmclab.store.run_file import write_run

PASSWORD = "only-of-the-tests"


@dataclass(frozen=True)
class Server:
    """A running PostgreSQL on this computer."""

    port: int
    version: str

    def address(self, database: str) -> str:
        return f"postgresql://ipmclab:{PASSWORD}@127.0.0.1:{self.port}/{database}"

    def new_database(self) -> str:
        import psycopg

        name = f"t{uuid.uuid4().hex}"
        with psycopg.connect(self.address("postgres"), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}")
        return self.address(name)


def programs() -> Path | None:
    """The folder of initdb; distributions keep it off the path."""
    found = shutil.which("initdb")
    if found:
        return Path(found).parent
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    return folders[-1].parent if folders else None


@pytest.fixture(scope="session")
def server(require: Callable[[str, object], None]) -> Iterator[Server]:
    """A cluster in a temporary folder, reachable on 127.0.0.1 only; it refuses to run as root."""
    binaries = programs()
    require("postgres", binaries)
    assert binaries is not None
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    as_owner = ["runuser", "-u", "postgres", "--"] if is_root else []
    folder = Path(tempfile.mkdtemp(prefix="ipmclab-postgres-"))
    (folder / "password").write_text(PASSWORD, encoding="utf-8")
    if is_root:
        shutil.chown(folder, "postgres")
        shutil.chown(folder / "password", "postgres")

    def call(*words: object) -> None:
        command = [*as_owner, *map(str, words)]
        subprocess.run(command, check=True, capture_output=True, cwd=folder, timeout=60)

    try:
        call(
            binaries / "initdb", "-D", folder / "data", "-U", "ipmclab", "-A", "scram-sha-256",
            "--pwfile", folder / "password", "--encoding", "UTF8", "--locale", "C", "--no-sync",
        )  # fmt: skip
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        options = f"-c listen_addresses=127.0.0.1 -c fsync=off -p {port} -k {folder}"
        call(binaries / "pg_ctl", "-D", folder / "data", "-w", "-l", folder / "log", "-o", options, "start")
        try:
            yield Server(port, (folder / "data" / "PG_VERSION").read_text(encoding="utf-8").strip())
        finally:
            call(binaries / "pg_ctl", "-D", folder / "data", "-m", "immediate", "-w", "stop")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(params=["sqlite", "postgresql"])
def address(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str | None:
    """The url of an empty catalogue: None for the one beside the runs, or one on the server."""
    monkeypatch.delenv("IPMCLAB_CATALOGUE", raising=False)
    monkeypatch.delenv("PGOPTIONS", raising=False)
    return None if request.param == "sqlite" else request.getfixturevalue("server").new_database()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder for runs."""
    made = tmp_path / "lab"
    made.mkdir()
    return made


@pytest.fixture
def catalogue(folder: Path, address: str | None) -> Catalogue:
    """The catalogue of the folder, on each database."""
    return Catalogue(folder, address)


WriteRun = Callable[..., Path]


@pytest.fixture
def write(folder: Path) -> WriteRun:
    """Write a small run file, with metadata as given; ``current`` tells runs apart."""

    def write(name: str, *, current: float = 0.05, channels: dict[str, Any] | None = None, **metadata: Any) -> Path:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        time = np.arange(50) / 50.0
        sample = metadata.pop("sample", None)
        run = Run.from_arrays(
            time=time,
            voltage=np.ones(50),
            current=current * np.exp(-time),
            metadata=RunMetadata(sample=Sample(sample) if sample else None, **metadata),
            **(channels or {}),
        )
        write_run(run, path, overwrite=True)
        return path

    return write
