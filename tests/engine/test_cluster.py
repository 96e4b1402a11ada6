"""A Dask scheduler and three worker processes, of which two are killed in mid-run, and the last one later."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from ipmclab import InputError, run_sweep
from ipmclab.engine import cluster, in_order, task
from ipmclab.platform import PROCESSORS
from ipmclab.sweep.sweep_file import sweep_from_text
from ipmclab.sweep.template import TEMPLATE
from tests.engine import tasks
from tests.waiting import until

ROOT = Path(__file__).resolve().parents[2]
SWEEP = sweep_from_text(
    TEMPLATE.replace("base = 512", "base = 32").replace("\n[design]", "\nsets_per_file = 23\n[design]")
)


@dataclass
class Machines:
    """A scheduler and its workers."""

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)


def start(module: str, *words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"distributed.cli.{module}", *words, "--host", "127.0.0.1", "--no-dashboard"]
    told = {**os.environ, "PYTHONPATH": str(ROOT), PROCESSORS: "1"}
    return subprocess.Popen(command, env=told, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machines]:
    folder = tmp_path_factory.mktemp("dask")
    told = folder / "scheduler.json"
    scheduler = start("dask_scheduler", "--port", "0", "--scheduler-file", str(told))
    found = Machines("", scheduler)
    try:
        until(lambda: told.is_file() and told.read_text().endswith("}"))
        found.address = json.loads(told.read_text())["address"]
        words = (found.address, "--nthreads", "1", "--no-nanny", "--local-directory", str(folder))
        found.workers += [start("dask_worker", *words) for _ in range(3)]
        yield found
    finally:
        for process in (*found.workers, scheduler):
            process.kill()
            process.wait()


def test_a_cluster_gives_what_one_process_gives_whoever_dies(
    machines: Machines, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    run_sweep(SWEEP, tmp_path / "here")
    with cluster.cluster(machines.address, patience=1.0) as engine:
        until(lambda: len(engine._client.nthreads()) == 3)
        killed = []

        def kill(sentence: str, done: float) -> None:
            if done > 0.0 and not killed:
                killed.extend(machines.workers[:2])
                for worker in killed:
                    worker.kill()

        swept = run_sweep(SWEEP, tmp_path / "there", engine=engine, progress=kill)
        assert (len(killed), swept.found, swept.parts.files) == (2, 0, 7)
        for part in range(swept.parts.files):
            name = swept.parts.path(part).name
            assert (tmp_path / "there" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()

        assert in_order(engine, tasks.power, 2, range(20)) == [2**k for k in range(20)]
        with pytest.raises(InputError, match="exponent -1: it is below 0; give 0 or more"):
            list(engine.map(tasks.power, 2, [-1]))

        with monkeypatch.context() as other:
            other.setattr(cluster, "software", lambda: {**task.software(), "numpy": "1.0"})
            with pytest.raises(InputError, match=r"other software: numpy is .* there and 1\.0 here; install the same"):
                list(engine.map(tasks.power, 2, [1]))

        machines.workers[2].kill()
        with pytest.raises(InputError, match=r"no worker for 1 s; start workers \(dask worker tcp://127.0.0.1:"):
            list(engine.map(tasks.power, 2, [1]))

        machines.scheduler.kill()
        with pytest.raises(InputError, match=r"the scheduler does not answer any more; start it and its workers again"):
            list(engine.map(tasks.power, 2, [1]))
    assert "Traceback" not in capfd.readouterr().err


class Told:
    """A client of a cluster whose machines have these packages."""

    def __init__(self, **workers: dict[str, str | None]) -> None:
        self._workers = workers

    def get_versions(self, packages: list[str]) -> dict[str, object]:
        mine = {"packages": dict.fromkeys([*packages, *cluster._SAME], "1")}
        of_workers = {name: {"packages": mine["packages"] | its} for name, its in self._workers.items()}
        return {"client": mine, "scheduler": mine, "workers": of_workers}


def test_other_software_is_refused_before_any_work() -> None:
    cluster._same_software(Told(one={}, two={}), "tcp://a")
    with pytest.raises(InputError, match=r"tcp://a, two: .*ipmclab is not installed there and 1 here; install"):
        cluster._same_software(Told(one={}, two={"ipmclab": None}), "tcp://a")


def test_no_scheduler_and_no_dask_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "ANSWER", 0.5)
    for address in ("tcp://127.0.0.1:1", "127.0.0.1", "post://here:1"):
        with pytest.raises(InputError, match=r"no Dask scheduler answers: .*dask scheduler --host 127\.0\.0\.1"):  # noqa: SIM117
            with cluster.cluster(address):
                pass

    def lacking(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", lacking)
    with pytest.raises(InputError, match=r"Dask is not installed; in the folder of ipmclab, write: uv tool install "):  # noqa: SIM117
        with cluster.cluster("tcp://127.0.0.1:1"):
            pass
