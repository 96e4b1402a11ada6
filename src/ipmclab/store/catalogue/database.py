"""The database under the catalogue: how it is reached, its transactions, and what its errors mean."""

from __future__ import annotations

import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.extras import how_to_install

if TYPE_CHECKING:
    from sqlalchemy import URL, Connection, Engine
    from sqlalchemy.exc import DBAPIError

FILE_NAME: Final = "catalogue.db"

PATIENCE: Final = 10.0
"""How long [s] a transaction waits for that of another program; each is over in milliseconds."""

REFUSED_VALUE: Final = "refused-value"
"""The code of an error about what was to be written, not about the catalogue."""

_READ_ONLY: Final = "ipmclab_read_only"

_WRITERS: Final = 7310281144
"""The advisory lock of PostgreSQL that whoever writes holds; any number that no other program in the database takes."""

_HELD: Final = ("55P03", "40P01", "40001")
"""States of PostgreSQL in which another transaction stood in the way: of its lock's time, a deadlock, an order."""


def parse_url(text: str) -> URL:
    """The address of a catalogue.

    Parameters
    ----------
    text : str
        ``postgresql://USER@HOST/NAME``, ``sqlite:///PATH``, or the path of an SQLite file.

    Raises
    ------
    InputError
        Another database, or no address at all.

    Examples
    --------
    >>> parse_url("postgresql://ada@lab.example/runs").drivername
    'postgresql+psycopg'
    """
    from sqlalchemy import URL, make_url
    from sqlalchemy.exc import ArgumentError

    if "://" not in text:
        return URL.create("sqlite", database=os.path.abspath(text))
    try:
        url = make_url(text)
    except (ArgumentError, ValueError) as error:
        raise InputError(
            "this is not the address of a catalogue",
            code="bad-catalogue",
            where="catalogue",  # the text may hold a password
            repair="write postgresql://USER@HOST/NAME, or the path of an SQLite file",
        ) from error
    kind = url.drivername.partition("+")[0]
    if kind in ("postgresql", "postgres"):
        return url.set(drivername="postgresql+psycopg")
    if kind != "sqlite" or not url.database or url.database == ":memory:":
        raise InputError(
            f"a catalogue is kept in PostgreSQL or in an SQLite file, not in {kind!r}",
            code="bad-catalogue",
            where=url.render_as_string(hide_password=True),
            repair="write postgresql://USER@HOST/NAME, or the path of an SQLite file",
        )
    return url.set(drivername="sqlite")


class Database:
    """One database with the catalogue's tables. Nothing stays open between transactions."""

    def __init__(self, url: URL, patience: float | None = None) -> None:
        self.url = url
        self._patience = PATIENCE if patience is None else patience
        self.where = (url.database or "") if self.is_sqlite else url.render_as_string(hide_password=True)
        self._prepared = False

    @property
    def is_sqlite(self) -> bool:
        return self.url.get_backend_name() == "sqlite"

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A transaction that only reads."""
        with self._transaction(read_only=True) as connection:
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """A transaction that writes: alone from its first statement on, on the disk when it ends."""
        with self._transaction(read_only=False) as connection:
            yield connection

    def reset(self) -> None:
        """Drop the tables of the catalogue, whatever their version, and make them again.

        Raises
        ------
        IpmclabError
            The database cannot be used at all.
        """
        from sqlalchemy import text

        from ipmclab.store.catalogue import tables

        with self._translated(), self._engine.begin() as connection:
            self._alone(connection)
            for table in reversed(tables.metadata.sorted_tables):
                cascade = "" if self.is_sqlite else " CASCADE"
                connection.execute(text(f"DROP TABLE IF EXISTS {table.name}{cascade}"))
            # In the same transaction: a program that reads meanwhile finds the old tables or the new ones, never none.
            _make_tables(connection)
        self._prepared = True

    def move_aside(self) -> Path | None:
        """Give a damaged SQLite file another name, so that a new one can be made; None where there is none."""
        path = Path(self.url.database or "")
        if not path.exists():
            return None
        aside = path.with_name(f"{path.stem}.broken-{time.strftime('%Y%m%dT%H%M%S')}{path.suffix}")
        for ending in ("", "-wal", "-shm"):
            part = path.with_name(path.name + ending)
            if part.exists():
                part.replace(aside.with_name(aside.name + ending))
        self._prepared = False
        return aside

    @contextmanager
    def _transaction(self, *, read_only: bool) -> Iterator[Connection]:
        with self._translated():
            if not self._prepared:
                self._prepare()
                self._prepared = True
            with self._engine.execution_options(**{_READ_ONLY: read_only}).begin() as connection:
                if not read_only:
                    self._alone(connection)
                yield connection

    def _alone(self, connection: Connection) -> None:
        """Wait until no other program writes: two that take the same rows in two orders would block each other."""
        from sqlalchemy import text

        if not self.is_sqlite:  # SQLite has one writer at a time by itself
            connection.execute(text(f"SELECT pg_advisory_xact_lock({_WRITERS})"))

    def _prepare(self) -> None:
        """Make the tables where there are none; refuse those of another version."""
        from sqlalchemy import inspect, select

        from ipmclab.store.catalogue import tables

        def version(connection: Connection) -> int | None:
            there = inspect(connection).has_table(tables.about.name)
            return connection.execute(select(tables.about.c.version)).scalar() if there else None

        with self._engine.execution_options(**{_READ_ONLY: True}).begin() as connection:
            found = version(connection)
        if found is None:
            with self._engine.begin() as connection:
                self._alone(connection)  # of two programs that start at once the second finds the tables of the first
                found = version(connection)
                if found is None:
                    found = _make_tables(connection)
        if found != tables.VERSION:
            newer = found > tables.VERSION
            first = "update ipmclab, or let this version make it again" if newer else "let this version make it again"
            raise IpmclabError(
                f"the catalogue is of version {found}, this ipmclab reads version {tables.VERSION}",
                code="catalogue-newer" if newer else "catalogue-older",
                where=self.where,
                repair=f"{first} from the run files: ipmclab runs FOLDER --rebuild",
            )

    @cached_property
    def _engine(self) -> Engine:
        from sqlalchemy import create_engine, event
        from sqlalchemy.pool import NullPool

        if self.is_sqlite:
            engine = create_engine(self.url, poolclass=NullPool, connect_args={"timeout": self._patience})
            event.listen(engine, "connect", partial(_set_up_sqlite, patience=self._patience))
            event.listen(engine, "begin", _begin_sqlite)
            return engine
        arguments: dict[str, Any] = {}
        if "connect_timeout" not in self.url.query:
            arguments["connect_timeout"] = max(2, min(5, round(self._patience)))  # 2 s is the least of libpq
        if "options" not in self.url.query:
            arguments["options"] = f"-c lock_timeout={int(1000 * self._patience)}"
        try:
            return create_engine(self.url, poolclass=NullPool, connect_args=arguments)
        except ImportError as error:
            raise InputError(
                "a catalogue in PostgreSQL needs the package psycopg, which is not installed",
                code="missing-package",
                where=self.where,
                repair=how_to_install("postgres"),
            ) from error

    @contextmanager
    def _translated(self) -> Iterator[None]:
        from sqlalchemy.exc import DataError, DBAPIError, IntegrityError, SQLAlchemyError

        try:
            yield
        except (DataError, IntegrityError) as error:
            raise IpmclabError(
                f"the catalogue refuses a value: {' '.join(str(error.orig).split())}",
                code=REFUSED_VALUE,
                where=self.where,
                repair="this is a fault in ipmclab: please report it; the run is safe in its file",
            ) from error
        except DBAPIError as error:
            raise (self._sqlite_error(error) if self.is_sqlite else self._server_error(error)) from error
        except SQLAlchemyError as error:
            raise self._broken(error) from error

    def _sqlite_error(self, error: DBAPIError) -> IpmclabError:
        name = getattr(error.orig, "sqlite_errorname", "")
        kinds: dict[str, tuple[str, str, str]] = {
            "SQLITE_BUSY": (
                "catalogue-busy",
                f"another program has held the catalogue for {self._patience:g} s",
                "see which other ipmclab does not answer, end it and try again",
            ),
            "SQLITE_READONLY": (
                "catalogue-unwritable",
                "the catalogue cannot be written",
                "ask for the right to write there, or keep a catalogue elsewhere: --catalogue PATH",
            ),
            "SQLITE_CANTOPEN": (
                "catalogue-unwritable",
                "the catalogue cannot be opened or made",
                "see that its folder exists and that you may write there, or keep a catalogue elsewhere: "
                "--catalogue PATH",
            ),
            "SQLITE_FULL": ("catalogue-full", "the disk is full", "make room, then try again"),
        }
        for start, (code, message, repair) in kinds.items():
            if name.startswith(start):
                return IpmclabError(f"{message} ({error.orig})", code=code, where=self.where, repair=repair)
        return self._broken(error.orig or error)

    def _server_error(self, error: DBAPIError) -> IpmclabError:
        reason = " ".join(str(error.orig).split())
        state = getattr(error.orig, "sqlstate", None)
        if state is None and not isinstance(error.orig, ValueError):
            return IpmclabError(
                f"the server of the catalogue does not answer: {reason}",
                code="catalogue-unreachable",
                where=self.where,
                repair="see that the server runs and that the address, the user and the password are right; "
                "without --catalogue and IPMCLAB_CATALOGUE the catalogue in the folder of the runs is used",
            )
        if state in _HELD:
            return IpmclabError(
                f"another program has held the catalogue for {self._patience:g} s ({reason})",
                code="catalogue-busy",
                where=self.where,
                repair="see which other ipmclab does not answer, end it and try again",
            )
        if str(state).startswith(("28", "3D", "42501")):
            return IpmclabError(
                f"the server refuses: {reason}",
                code="catalogue-refused",
                where=self.where,
                repair="ask whoever runs the server for the right to connect and to make tables",
            )
        return self._broken(error.orig or error)

    def _broken(self, error: BaseException) -> IpmclabError:
        return IpmclabError(
            f"the catalogue is damaged: {' '.join(str(error).split())}",
            code="catalogue-broken",
            where=self.where,
            repair="nothing is lost, the runs are in their files; make it again: ipmclab runs FOLDER --rebuild",
        )


def _make_tables(connection: Connection) -> int:
    """Make the tables of this version; returns the version."""
    from sqlalchemy import insert

    from ipmclab.store.catalogue import tables

    tables.metadata.create_all(connection)
    connection.execute(insert(tables.about).values(version=tables.VERSION))
    return tables.VERSION


def url_in_folder(root: Path) -> URL:
    """The catalogue that lies in a folder of runs."""
    from sqlalchemy import URL

    return URL.create("sqlite", database=os.fspath(root / FILE_NAME))


def _set_up_sqlite(connection: sqlite3.Connection, record: object, *, patience: float) -> None:  # noqa: ARG001  # SQLAlchemy gives both
    connection.isolation_level = None  # transactions begin where _begin_sqlite says, not where Python guesses
    deadline = time.monotonic() + patience
    while True:
        try:
            # What was committed survives a power cut. The change to WAL does not wait for other programs by itself.
            connection.execute("PRAGMA journal_mode=WAL")
            connection.execute("PRAGMA synchronous=FULL")
            connection.execute("PRAGMA foreign_keys=ON")
        except sqlite3.OperationalError as error:
            if not error.sqlite_errorname.startswith("SQLITE_BUSY") or time.monotonic() > deadline:
                raise
            time.sleep(0.02)
        else:
            return


def _begin_sqlite(connection: Connection) -> None:
    # A deferred transaction that reads and then writes fails at once when another writer came in between.
    read_only = connection.get_execution_options().get(_READ_ONLY, False)
    connection.exec_driver_sql("BEGIN" if read_only else "BEGIN IMMEDIATE")
