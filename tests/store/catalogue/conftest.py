"""A PostgreSQL server of the tests' own, and folders of runs that both databases are tried on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab.run import Run, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.catalogue.catalogue import Catalogue
from ipmclab.store.run_file import write_run
from tests.store.catalogue.postgres import Server, cluster, programs


@pytest.fixture(scope="session")
def server(require: Callable[[str, object], None]) -> Iterator[Server]:
    """A PostgreSQL of the tests' own."""
    binaries = programs()
    require("postgres", binaries)
    assert binaries is not None
    with cluster(binaries) as running:
        yield running


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
