"""Two rigs record at once into one catalogue, each a process of its own: no row is lost, on either database."""

from __future__ import annotations

import subprocess
import sys
import uuid
from pathlib import Path

import pytest

from ipmclab.errors import IpmclabError
from ipmclab.run import Finding
from ipmclab.store.catalogue import database as catalogue_database
from ipmclab.store.catalogue.catalogue import Catalogue, RunQuery

RUNS = 12

WRITER = """
import sys
from pathlib import Path
from ipmclab.run import Finding, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.catalogue.catalogue import Catalogue, RunQuery
folder, address, rig = sys.argv[1:4]
print("ready", flush=True)
sys.stdin.readline()  # both start together, also with making the tables
for path in sorted(Path(folder).glob(f"{rig}-*.nc")):
    name = path.stem.partition("-")[2]
    catalogue = Catalogue(folder, address or None)
    catalogue.begin(name, RunMetadata(sample=Sample(rig)))
    assert catalogue.query(RunQuery(sample=rig, state="recording")), "its own row is there at once"
    catalogue.add(path, [Finding("first", "info", "one"), Finding("second", "info", "two")])
"""


def start(folder: Path, address: str | None, rig: str, code: str = WRITER) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", code, str(folder), address or "", rig],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def go(*writers: subprocess.Popen[str]) -> None:
    for writer in writers:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        assert writer.stdin is not None
        writer.stdin.write("go\n")
        writer.stdin.flush()


def fill(folder: Path, write, rigs: tuple[str, ...]) -> set[str]:
    template = write("template.nc", sample="template")
    content = template.read_bytes()
    template.unlink()
    names = set()
    for rig in rigs:
        for k in range(RUNS):
            # A whole run file costs more than what is measured here: a few are written, the others are copies of one.
            name = str(uuid.uuid4())
            names.add(name)
            if k < 4:
                write(f"{rig}-{name}.nc", sample=rig, uuid=name, state="complete")
            else:
                (folder / f"{rig}-{name}.nc").write_bytes(content)
    return names


def test_two_rigs_at_once(folder: Path, address: str | None, write) -> None:
    names = fill(folder, write, ("rig1", "rig2"))
    writers = [start(folder, address, rig) for rig in ("rig1", "rig2")]
    go(*writers)
    for writer in writers:
        _, errors = writer.communicate(timeout=300)
        assert writer.returncode == 0, errors
    catalogue = Catalogue(folder, address)
    rows = catalogue.query()
    assert {row.uuid for row in rows if row.uuid} == names
    complete = catalogue.query(RunQuery(state="complete"))
    assert len(complete) == 8
    assert all(row.codes == ("first", "second") for row in complete)
    assert all(len(found) == 2 for found in catalogue.findings(complete).values())
    found = catalogue.sweep()
    assert (found.files, found.added, found.changed, found.problems) == (2 * RUNS, 0, 0, ())


def test_two_sweeps_and_a_rebuild_at_once(folder: Path, address: str | None, write) -> None:
    names = fill(folder, write, ("rig1",))
    code = WRITER.partition("for path")[0]
    sweep = code + "for _ in range(3): Catalogue(folder, address or None).sweep(lambda run: [])"
    rebuild = code + "for _ in range(3): Catalogue(folder, address or None).rebuild(lambda run: [])"
    writers = [start(folder, address, "rig1", what) for what in (sweep, sweep, rebuild)]
    go(*writers)
    for writer in writers:
        _, errors = writer.communicate(timeout=300)
        assert writer.returncode == 0, errors
    catalogue = Catalogue(folder, address)
    recorded = [row for row in catalogue.query() if row.uuid]
    assert len(recorded) == 4
    assert {str(row.uuid) for row in recorded} <= names
    assert all(row.codes == () for row in catalogue.query())


def test_a_writer_is_alone_from_its_first_statement_on(
    folder: Path, address: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two that took the same rows in two orders would otherwise block each other, which looked like damage."""
    monkeypatch.setattr(catalogue_database, "PATIENCE", 0.3)
    first, second = (Catalogue(folder, address) for _ in range(2))
    first.sweep()
    with first._database.write():
        with pytest.raises(IpmclabError, match="another program") as caught, second._database.write():
            pass
        assert caught.value.code == "catalogue-busy"
        assert second.query() == []  # readers go on
    with second._database.write():
        pass


KILLED = """
import sys
from ipmclab.run import RunMetadata
from ipmclab.store.catalogue.catalogue import Catalogue
folder, address, name = sys.argv[1:4]
catalogue = Catalogue(folder, address or None)
catalogue.begin(name, RunMetadata())
with catalogue._database.write() as connection:
    connection.exec_driver_sql("UPDATE ipmclab_run SET sample = 'half done'")
    print("ready", flush=True)
    sys.stdin.readline()
"""


def test_a_rig_that_is_killed_in_a_transaction_holds_nobody_up(folder: Path, address: str | None, write) -> None:
    name = str(uuid.uuid4())
    writer = start(folder, address, name, KILLED)
    assert writer.stdout is not None
    assert writer.stdout.readline() == "ready\n"
    writer.kill()
    writer.communicate(timeout=300)
    catalogue = Catalogue(folder, address)
    path = write("a.nc", sample="S1", uuid=name, state="recovered")
    catalogue.add(path, [Finding("first", "info", "one")])
    assert [(row.uuid, row.sample, row.state) for row in catalogue.query()] == [(name, "S1", "recovered")]


def test_the_server_is_a_postgresql_on_this_computer_only(server) -> None:
    import psycopg

    assert int(server.version) >= 15
    with psycopg.connect(server.address("postgres")) as connection:
        shown = connection.execute("SHOW listen_addresses").fetchone()
    assert shown == ("127.0.0.1",)
    with pytest.raises(psycopg.OperationalError):
        psycopg.connect(server.address("postgres").replace("only-of-the-tests", "")).close()
