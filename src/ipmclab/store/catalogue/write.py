"""Rows of the catalogue, written so that two writers of the same run agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from ipmclab.errors import InputError
from ipmclab.store.catalogue.facts import FileFacts, problem_text

if TYPE_CHECKING:
    from sqlalchemy import Connection
    from sqlalchemy.dialects.postgresql import Insert

IDS_AT_ONCE: Final = 500
"""Databases bound how many values a statement may name."""

_OF_INSPECTION: Final = ("finding_codes", "series_resistance", "capacitance")


def put_run(connection: Connection, columns: Mapping[str, Any]) -> int:
    """Write a run, whether or not its row is there; its findings stay while its content does.

    Returns
    -------
    id : int
    """
    facts = {name: value for name, value in columns.items() if name != "document"}
    run_id = int(connection.execute(_run_statement(connection.dialect.name, tuple(facts)), facts).scalar_one())
    whole = {"run_id": run_id, "metadata": columns["document"]}
    connection.execute(_document_statement(connection.dialect.name), whole)
    return run_id


def put_new_run(connection: Connection, columns: Mapping[str, Any]) -> None:
    """Write a run that has just begun; a row that is there, also one written at this moment, knows more."""
    from sqlalchemy import insert, select

    from ipmclab.store.catalogue.tables import document, run

    facts = {name: value for name, value in columns.items() if name != "document"}
    if connection.execute(select(run.c.id).where(run.c.uuid == facts["uuid"]).limit(1)).first() is not None:
        return
    new = _insert(connection.dialect.name, run).on_conflict_do_nothing(index_elements=[run.c.identity])
    run_id = connection.execute(new.values(**facts).returning(run.c.id)).scalar()
    if run_id is not None:
        connection.execute(insert(document).values(run_id=run_id, metadata=columns["document"]))


# Making a statement takes ten times as long as running it, so each is made once.
@cache
def _run_statement(dialect: str, names: tuple[str, ...]) -> Any:
    from sqlalchemy import case

    from ipmclab.store.catalogue.tables import run

    statement = _insert(dialect, run)
    given = statement.excluded
    changes: dict[str, Any] = {name: given[name] for name in names if name != "identity"}
    for name in _OF_INSPECTION:
        if name not in names:
            changes[name] = case((run.c.content_sha256 == given.content_sha256, run.c[name]), else_=None)
    return statement.on_conflict_do_update(index_elements=[run.c.identity], set_=changes).returning(run.c.id)


@cache
def _run_of_file() -> Any:
    from sqlalchemy import bindparam, select

    from ipmclab.store.catalogue.tables import file

    return select(file.c.run_id).where(file.c.laboratory == bindparam("at"), file.c.path == bindparam("below"))


@cache
def _document_statement(dialect: str) -> Any:
    from ipmclab.store.catalogue.tables import document

    statement = _insert(dialect, document)
    changes = {"metadata": statement.excluded["metadata"]}
    return statement.on_conflict_do_update(index_elements=[document.c.run_id], set_=changes)


@cache
def _file_statement(dialect: str, names: tuple[str, ...]) -> Any:
    from ipmclab.store.catalogue.tables import file

    statement = _insert(dialect, file)
    key = ("laboratory", "path")
    changes = {name: statement.excluded[name] for name in names if name not in key}
    return statement.on_conflict_do_update(index_elements=[file.c[name] for name in key], set_=changes)


def put_run_file(
    connection: Connection, laboratory: str, path: str, facts: FileFacts | InputError, stamp: tuple[int, int]
) -> tuple[int | None, int | None]:
    """Write a run file with its run, or what is wrong with it; then ``choose_shown`` must follow.

    Returns
    -------
    now, before : int or None
        The ids of the run that the file holds and that it held, where they are known.
    """
    before: int | None = connection.execute(_run_of_file(), {"at": laboratory, "below": path}).scalar()
    now: int | None = None
    columns: dict[str, Any] = {"laboratory": laboratory, "path": path}
    code: str | None = None
    text: str | None = None
    if isinstance(facts, InputError):
        columns |= {"size": stamp[0], "mtime_ns": stamp[1], "sha256": None}
        code, text = problem_text(facts)
        if code != "not-a-run":  # which run a damaged file was is known from before
            now = before
    else:
        columns |= {"size": facts.size, "mtime_ns": facts.mtime_ns, "sha256": facts.sha256}
        other = _other_content(connection, laboratory, path, facts.run)
        if other is None:
            _take_over(connection, laboratory, path, facts.run)
            now = put_run(connection, {**facts.run, "home": laboratory})
        else:
            code = "same-uuid"
            text = f"it has the uuid of {other}, but other content; a changed copy needs a uuid of its own"
    columns |= {"run_id": now, "shown": False, "problem_code": code, "problem": text}
    connection.execute(_file_statement(connection.dialect.name, tuple(columns)), columns)
    return now, before


def _other_content(connection: Connection, laboratory: str, path: str, run_columns: Mapping[str, Any]) -> str | None:
    """Another file that is well and holds something else under the same uuid."""
    from sqlalchemy import not_, select

    from ipmclab.store.catalogue.tables import file, run

    if run_columns["uuid"] is None:
        return None
    statement = (
        select(file.c.path)
        .join(run, file.c.run_id == run.c.id)
        .where(
            run.c.uuid == run_columns["uuid"],
            run.c.content_sha256 != run_columns["content_sha256"],
            file.c.problem_code.is_(None),
            not_((file.c.laboratory == laboratory) & (file.c.path == path)),
        )
    )
    found = connection.execute(statement.limit(1)).scalar()
    return None if found is None else str(found)


def _take_over(connection: Connection, laboratory: str, path: str, run_columns: Mapping[str, Any]) -> None:
    """Let the row of this run that no other file holds be that of this file: it was recorded, or changed in its place.

    A row that another file holds is another version of the run.
    """
    from sqlalchemy import not_, select, update

    from ipmclab.store.catalogue.tables import file, run

    if run_columns["uuid"] is None:
        return
    rows = select(run.c.id, run.c.identity).where(run.c.uuid == run_columns["uuid"]).order_by(run.c.id)
    known = connection.execute(rows).all()
    if any(identity == run_columns["identity"] for _, identity in known):
        return
    here = (file.c.laboratory == laboratory) & (file.c.path == path)
    for run_id, _ in known:
        others = select(file.c.id).where(file.c.run_id == run_id, not_(here)).limit(1)
        if connection.execute(others).first() is None:
            connection.execute(update(run).where(run.c.id == run_id).values(identity=run_columns["identity"]))
            return


def clear_file(connection: Connection, laboratory: str, path: str) -> int | None:
    """Forget a file that is gone; its run, whose id is returned, stays."""
    from sqlalchemy import delete

    from ipmclab.store.catalogue.tables import file

    gone = delete(file).where(file.c.laboratory == laboratory, file.c.path == path).returning(file.c.run_id)
    return connection.execute(gone).scalar()


def choose_shown(connection: Connection, *run_ids: int | None) -> None:
    """Of the files of each of these runs, let one stand for it: a sound one before a damaged one, then the first."""
    from sqlalchemy import select, update

    from ipmclab.store.catalogue.tables import file

    ids = sorted({run_id for run_id in run_ids if run_id is not None})
    other = file.alias("other")
    best = (
        select(other.c.id)
        .where(other.c.run_id == file.c.run_id)
        .order_by(other.c.problem_code.is_not(None), other.c.id)
        .limit(1)
        .correlate(file)
        .scalar_subquery()
    )
    for start in range(0, len(ids), IDS_AT_ONCE):
        some = file.c.run_id.in_(ids[start : start + IDS_AT_ONCE])
        connection.execute(update(file).where(some).values(shown=file.c.id == best))


def put_findings(
    connection: Connection, run_id: int, columns: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]
) -> None:
    """Write the findings of a run in place of those it has."""
    from sqlalchemy import delete, insert, update

    from ipmclab.store.catalogue.tables import finding, run

    connection.execute(update(run).where(run.c.id == run_id).values(**columns))
    connection.execute(delete(finding).where(finding.c.run_id == run_id))
    if rows:
        connection.execute(insert(finding), [{**row, "run_id": run_id} for row in rows])


def _insert(dialect: str, table: Any) -> Insert:
    """``INSERT`` of the database at hand: both know ``ON CONFLICT``, each in its own module."""
    from sqlalchemy.dialects import postgresql, sqlite

    # The two have the same methods, but no common type.
    return (sqlite.insert if dialect == "sqlite" else postgresql.insert)(table)  # type: ignore[return-value]
