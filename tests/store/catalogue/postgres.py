"""A PostgreSQL server of one's own, for as long as it is needed."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

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


@contextmanager
def cluster(binaries: Path) -> Iterator[Server]:
    """A cluster in a temporary folder, reachable on 127.0.0.1 only; PostgreSQL refuses to run as root."""
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    as_owner = ["runuser", "-u", "postgres", "--"] if is_root else []
    folder = Path(tempfile.mkdtemp(prefix="ipmclab-postgres-"))
    (folder / "password").write_text(PASSWORD, encoding="utf-8")
    if is_root:
        shutil.chown(folder, "postgres")
        shutil.chown(folder / "password", "postgres")

    def call(*words: object) -> None:
        command = [*as_owner, *map(str, words)]
        subprocess.run(command, check=True, capture_output=True, cwd=folder, timeout=180)

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
