"""The tables of the catalogue, the same in SQLite and PostgreSQL."""

from __future__ import annotations

from typing import Final

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    Table,
    Text,
    UniqueConstraint,
)
from sqlalchemy.dialects.postgresql import JSONB

VERSION: Final = 2
"""Of these tables. A catalogue of another version is made again from the run files: no row is ever migrated."""

_JSON = JSON(none_as_null=True).with_variant(JSONB(none_as_null=True), "postgresql")
_INTEGER = BigInteger().with_variant(Integer(), "sqlite")  # SQLite counts rows by itself only for INTEGER
# SQLite keeps doubles in REAL; PostgreSQL's double precision is Float(53).
_DOUBLE = Float(53)

metadata = MetaData()

about = Table("ipmclab_catalogue", metadata, Column("version", Integer, nullable=False))
"""One row: the version of the tables."""

run = Table(
    "ipmclab_run",
    metadata,
    Column("id", _INTEGER, primary_key=True),
    # The uuid of a run that a recorder made, and the SHA-256 of its document: each corrected copy has a row of its own.
    Column("identity", Text, nullable=False, unique=True),
    Column("uuid", Text, index=True),
    Column("content_sha256", Text, index=True),
    Column("state", Text),
    Column("state_reason", Text),
    # The laboratory that it was last found in, or where it is being recorded.
    Column("home", Text),
    Column("recorded_at", Text),
    Column("recorded", _DOUBLE, index=True),  # s since 1970
    Column("rows", BigInteger),
    Column("duration", _DOUBLE),  # s
    Column("rate", _DOUBLE),  # Hz
    Column("origin", Text),
    Column("sample", Text),
    Column("mounting", Text),
    Column("run_number", BigInteger),
    Column("purpose", Text),
    Column("signal", Text),
    Column("drive", Text),  # the signal without its rests
    Column("signal_words", Text),  # " sine step "
    Column("amplitude", _DOUBLE),  # V
    Column("frequency", _DOUBLE),  # Hz
    Column("channels", Text),  # " voltage current force "
    Column("temperature", _DOUBLE),  # degC, mean
    Column("relative_humidity", _DOUBLE),  # percent, mean
    Column("minutes_out_of_water", _DOUBLE),
    Column("minutes_in_environment", _DOUBLE),
    Column("operator", Text),
    Column("rig", Text),
    Column("series_resistance", _DOUBLE),  # ohm, of a fingerprint
    Column("capacitance", _DOUBLE),  # F, of a fingerprint
    Column("finding_codes", Text),  # " clipped spike "; NULL until the run was inspected
    Index("ipmclab_run_question", "sample", "amplitude"),
)

document = Table(
    "ipmclab_document",
    metadata,
    Column("run_id", _INTEGER, ForeignKey("ipmclab_run.id", ondelete="CASCADE"), primary_key=True, autoincrement=False),
    Column("metadata", _JSON),
)
"""The whole metadata of each run: separate, so that a list of runs need not read past them."""

file = Table(
    "ipmclab_file",
    metadata,
    Column("id", _INTEGER, primary_key=True),
    # The computer and folder; empty where the catalogue lies in the folder itself, which may be moved.
    Column("laboratory", Text, nullable=False),
    Column("path", Text, nullable=False),  # below the folder, with "/"
    Column("size", BigInteger, nullable=False),
    Column("mtime_ns", BigInteger, nullable=False),
    Column("sha256", Text),
    Column("run_id", _INTEGER, ForeignKey("ipmclab_run.id", ondelete="CASCADE"), index=True),
    # Whether it represents its run: one of several copies, a sound one where there is one.
    Column("shown", Boolean, nullable=False, default=False),
    Column("problem_code", Text),
    Column("problem", Text),
    UniqueConstraint("laboratory", "path"),
)
"""Every netCDF file of a folder. A file without ``run_id`` is none of ours or too damaged to say which it is."""

finding = Table(
    "ipmclab_finding",
    metadata,
    Column("id", _INTEGER, primary_key=True),
    Column("run_id", _INTEGER, ForeignKey("ipmclab_run.id", ondelete="CASCADE"), nullable=False, index=True),
    Column("code", Text, nullable=False, index=True),
    Column("severity", Text, nullable=False),
    Column("channel", Text),
    Column("message", Text, nullable=False),
    Column("numbers", _JSON),
)
