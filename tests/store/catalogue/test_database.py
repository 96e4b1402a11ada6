"""What becomes of a catalogue that is damaged, locked, out of reach or misspelled: a message that says what to do."""

from __future__ import annotations

import sqlite3
import sys
from pathlib import Path

import pytest

from ipmclab.errors import InputError, IpmclabError
from ipmclab.run import RunMetadata
from ipmclab.store.catalogue import database as catalogue_database
from ipmclab.store.catalogue.catalogue import Catalogue, RunQuery, safely
from ipmclab.store.catalogue.database import parse_url


@pytest.fixture(autouse=True)
def no_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("IPMCLAB_CATALOGUE", raising=False)


def filled(folder: Path, write) -> Catalogue:
    for k in range(30):
        write(f"{k}.nc", sample=f"S{k}")
    catalogue = Catalogue(folder)
    catalogue.sweep()
    return catalogue


@pytest.mark.parametrize("damage", ["not a database", "cut", "overwritten", "empty page"])
def test_a_damaged_file_is_made_anew_and_kept_aside(folder: Path, write, damage: str) -> None:
    filled(folder, write)
    database = folder / "catalogue.db"
    content = bytearray(database.read_bytes())
    if damage == "not a database":
        content = bytearray(b"A catalogue is not a text. " * 100)
    elif damage == "cut":
        del content[len(content) // 3 :]
    elif damage == "overwritten":
        content[4096:] = b"\xa5" * (len(content) - 4096)
    else:
        content[:100] = bytes(100)
    database.write_bytes(content)
    catalogue = Catalogue(folder)
    with pytest.raises(IpmclabError, match=r"nothing is lost, .* --rebuild") as caught:
        catalogue.query(RunQuery(sample="S7"))
    assert caught.value.code == "catalogue-broken"
    assert caught.value.where == str(database)
    assert caught.value.exit_status == 1
    catalogue.rebuild()
    assert len(catalogue.query()) == 30
    (aside,) = folder.glob("catalogue.broken-*.db")
    assert aside.read_bytes() == bytes(content)


def test_an_emptied_file_fills_again_by_itself(folder: Path, write) -> None:
    filled(folder, write)
    (folder / "catalogue.db").write_bytes(b"")
    catalogue = Catalogue(folder)
    assert catalogue.sweep().added == 30


def test_a_lock_that_is_never_released(folder: Path, write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue_database, "PATIENCE", 0.2)
    filled(folder, write)
    held = sqlite3.connect(folder / "catalogue.db", isolation_level=None)
    held.execute("BEGIN IMMEDIATE")
    catalogue = Catalogue(folder)
    with pytest.raises(IpmclabError, match="another program") as caught:
        catalogue.begin("3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee", RunMetadata())
    assert caught.value.code == "catalogue-busy"
    assert len(catalogue.query()) == 30  # readers go on
    held.close()
    catalogue.begin("3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee", RunMetadata())
    assert len(catalogue.query()) == 31


def test_what_is_committed_is_synced_and_nothing_stays_open(folder: Path, write) -> None:
    catalogue = filled(folder, write)
    with catalogue._database.write() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2  # FULL
        # A second writer is kept out from the first statement on.
        other = sqlite3.connect(folder / "catalogue.db", timeout=0.0, isolation_level=None)
        with pytest.raises(sqlite3.OperationalError, match="locked"):
            other.execute("BEGIN IMMEDIATE")
        other.close()
    assert sorted(path.name for path in folder.glob("catalogue*")) == ["catalogue.db"]  # no -wal, no -shm


def test_a_folder_that_cannot_hold_it(folder: Path) -> None:
    (folder / "catalogue.db").mkdir()
    with pytest.raises(IpmclabError) as caught:
        Catalogue(folder).query()
    assert caught.value.code == "catalogue-unwritable"
    assert "--catalogue PATH" in caught.value.repair
    with pytest.raises(InputError, match="no such folder"):
        Catalogue(folder / "nowhere")


def test_a_catalogue_in_a_file_elsewhere(folder: Path, tmp_path: Path, write) -> None:
    write("a.nc", sample="S1")
    catalogue = Catalogue(folder, str(tmp_path / "all.db"))
    catalogue.sweep()
    assert (tmp_path / "all.db").exists()
    assert not (folder / "catalogue.db").exists()
    (row,) = catalogue.query()
    assert catalogue.file_of(row) == str(folder / "a.nc")
    assert str(row.laboratory).endswith(folder.as_posix())


@pytest.mark.parametrize(
    "url", ["mysql://ada:secret@host/runs", "sqlite://", "sqlite:///:memory:", "http://host", "://x"]
)
def test_addresses_of_no_catalogue(url: str) -> None:
    with pytest.raises(InputError, match=r"write postgresql://USER@HOST/NAME") as caught:
        parse_url(url)
    assert caught.value.code == "bad-catalogue"
    assert "secret" not in str(caught.value)


def test_the_address_may_come_from_the_environment(folder: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("IPMCLAB_CATALOGUE", str(tmp_path / "group.db"))
    assert Catalogue(folder).where == str(tmp_path / "group.db")
    assert Catalogue(folder, str(tmp_path / "mine.db")).where == str(tmp_path / "mine.db")


def test_without_psycopg(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(InputError, match=r"uv tool install .*postgres") as caught:
        Catalogue(folder, "postgresql://ada@127.0.0.1/runs").query()
    assert caught.value.code == "missing-package"


def test_a_server_that_does_not_answer(folder: Path) -> None:
    with pytest.raises(IpmclabError, match="does not answer") as caught:
        Catalogue(folder, "postgresql://ada:secret@127.0.0.1:9/runs").query()
    assert caught.value.code == "catalogue-unreachable"
    assert "secret" not in str(caught.value)
    assert "IPMCLAB_CATALOGUE" in caught.value.repair


def test_a_server_that_refuses(folder: Path, server) -> None:
    wrong = server.address("postgres").replace("only-of-the-tests", "guessed")
    for address in (wrong, server.address("nowhere")):
        with pytest.raises(IpmclabError) as caught:
            Catalogue(folder, address).query()
        assert caught.value.code in ("catalogue-unreachable", "catalogue-refused")
        assert "guessed" not in str(caught.value)


def test_no_error_of_a_catalogue_reaches_a_recording(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "catalogue.db").write_bytes(b"no database" * 1000)
    error = safely(lambda: Catalogue(folder).begin("3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee", RunMetadata()))
    assert error is not None
    assert error.code == "catalogue-broken"
    assert safely(lambda: None) is None

    def fails() -> None:
        raise MemoryError("nothing that we foresaw")

    error = safely(fails)
    assert error is not None
    assert "the run is safe" in error.repair
