"""Workers: frames, answers, errors, cancelling, a worker that dies."""

from __future__ import annotations

import csv
import gzip
import io
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import load_actuator, read_fit, simulate, write_run
from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.jobs import worker
from ipmclab.page.jobs.frames import Frame, pack, read_frame
from ipmclab.page.jobs.jobs import JobCancelled, Jobs
from ipmclab.page.jobs.tasks import LOOK, TASKS, Entry, Progress, find_task, room
from ipmclab.store.importers.unpacked import unpacked_size
from tests.waiting import until

PATIENCE = 180.0


@pytest.fixture(scope="module")
def jobs() -> Iterator[Jobs]:
    with Jobs() as these:
        yield these


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with runs of a strip that reads with noise."""
    folder = tmp_path_factory.mktemp("runs")
    rng = np.random.default_rng(20261121)
    strip = load_actuator("friend-2")
    from dataclasses import replace

    for name, signal in (("step", "step 1 V"), ("sine", "sine 1 V 0.1 Hz"), ("square", "square 1 V 0.1 Hz")):
        clean = simulate(strip, signal, duration=40.0, rate=50.0)
        assert clean.current is not None
        write_run(replace(clean, current=clean.current + rng.normal(0.0, 2e-4, len(clean))), folder / f"{name}.nc")
    return folder


@given(
    st.dictionaries(st.text(), st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text() | st.floats()),
    st.dictionaries(st.text(), st.lists(st.floats(width=64), max_size=20), max_size=4),
)
def test_a_frame_comes_back(document: dict[str, object], arrays: dict[str, list[float]]) -> None:
    document.pop("arrays", None)
    data = pack(document, {name: np.array(values) for name, values in arrays.items()})
    frame = read_frame(io.BytesIO(data))
    assert frame is not None
    for name, values in arrays.items():
        np.testing.assert_array_equal(frame.arrays[name], values)
    expected = {
        key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in document.items()
    }
    assert frame.document == expected
    assert read_frame(io.BytesIO(data[:-1])) is None


def test_it_simulates_what_the_model_says(jobs: Jobs) -> None:
    changes = {"circuit.sheet_resistance": 2.0}
    frame = jobs.submit(
        "simulate", {"actuator": "friend-2", "changes": changes, "signal": "sine 1 V 0.1 Hz"}
    ).future.result(PATIENCE)
    strip = load_actuator("friend-2").replace(**changes)
    run = simulate(strip, "sine 1 V 0.1 Hz", duration=40.0, rate=50.0)
    assert run.current is not None
    np.testing.assert_allclose(frame.arrays["current"], run.current, rtol=1e-12)
    at = frame.arrays["frequency"][50]
    response = strip.frequency_response([at], ["displacement"])[0, 0]
    assert frame.arrays["gain.displacement"][50] == pytest.approx(abs(response))
    # The strip as drawn: for the small bending of this signal its height at the laser is the displacement.
    about = frame.document["shape"]
    x = frame.arrays["shape.x"].reshape(about["pictures"], about["places"])
    y = frame.arrays["shape.y"].reshape(about["pictures"], about["places"])
    drawn = [np.interp(about["laser"], x[k], y[k]) for k in range(about["pictures"])]
    linear = np.interp(frame.arrays["shape.time"], frame.arrays["time"], frame.arrays["displacement"])
    assert np.max(np.abs(np.array(drawn) - linear)) < 0.02 * np.max(np.abs(linear))


def test_bad_input_comes_back_as_what_it_is(jobs: Jobs) -> None:
    job = jobs.submit("simulate", {"actuator": "friend-2", "signal": "sine 1 V"})
    with pytest.raises(InputError) as caught:
        job.future.result(PATIENCE)
    assert job.state == "failed"
    assert job.error is caught.value
    with pytest.raises(InputError, match="at most 20000 follow a slider"):
        jobs.submit("simulate", {"actuator": "friend-2", "signal": "step 1 V", "duration": 1e4}).future.result(PATIENCE)


def test_only_the_newest_position_of_a_slider_counts(jobs: Jobs) -> None:
    some = [
        jobs.submit("simulate", {"actuator": "friend-2", "signal": f"step {k} V"}, replaces="slider")
        for k in range(1, 30)
    ]
    assert some[-1].future.result(PATIENCE).arrays["voltage"][0] == 29.0
    assert sum(job.state == "cancelled" for job in some) > 5


def test_a_fit_tells_how_far_it_is_and_what_came_of_it(jobs: Jobs, runs: Path, tmp_path: Path) -> None:
    job = jobs.submit("identify", _fit(runs, tmp_path / "fit.toml"))
    told = set()
    while not job.is_over:
        told.add((job.sentence, job.fraction))
        time.sleep(0.005)
    frame = job.future.result(PATIENCE)
    told.add((job.sentence, job.fraction))  # the last, where all of it passed between two looks
    assert any(fraction for _, fraction in told)
    assert job.first is not None
    assert [row["name"] for row in job.first] == [
        *(row["name"] for row in frame.document["parameters"]),
        "residual of the current in step",
        "residual of the current in sine",
    ]
    assert frame.document["rank"] == frame.document["free"] == 5
    assert {row["name"] for row in frame.document["parameters"]} >= {"circuit.dc_resistivity"}
    assert "cannot be estimated" in frame.document["next_mounting_unknown"]
    assert frame.document["averaged"] == []
    assert frame.document["profiles"]["svg"].count("<title") >= 1
    assert "chi-square" in frame.document["profiles"]["caption"]
    files = frame.document["profiles"]["files"]
    assert "var(" not in files["svg"]  # it is looked at outside the page
    ElementTree.fromstring(files["svg"])
    points = list(csv.DictReader(io.StringIO(files["csv"])))
    written = read_fit(tmp_path / "fit.toml").profiles
    assert [(one["parameter"], float(one["value [SI]"]), float(one["excess of chi-square"])) for one in points] == [
        (name, *pair) for name, one in written.items() for pair in zip(one.values, one.excess, strict=True)
    ]
    residual = frame.arrays["0.current.residual"]
    assert np.nanstd(residual) == pytest.approx(2e-4, rel=0.1)  # A, the noise of the record
    models = {"models": [str(tmp_path / "fit.toml"), "friend-2"], "names": ["mine", "friend-2"]}
    held = jobs.submit("validate", {**models, "runs": [str(runs / "square.nc")]}).future.result(PATIENCE)
    assert [row["model"] for row in held.document["scores"]][:2] == ["mine", "friend-2"]
    assert held.document["used"] == [[False], [False]]


def test_a_fit_can_be_cancelled_and_its_worker_goes_on(jobs: Jobs, runs: Path, tmp_path: Path) -> None:
    job = jobs.submit("identify", _fit(runs, tmp_path / "fit.toml"))
    until(lambda: job.state == "running")
    jobs.cancel(job)
    with pytest.raises(JobCancelled):
        job.future.result(PATIENCE)
    assert job.state == "cancelled"
    assert not list(tmp_path.iterdir())
    waiting = jobs.submit("identify", _fit(runs, tmp_path / "fit.toml"))
    jobs.cancel(waiting)
    with pytest.raises(JobCancelled):
        waiting.future.result(PATIENCE)
    assert jobs.submit("identify", _fit(runs, tmp_path / "fit.toml")).future.result(PATIENCE).document["converged"]


def test_a_job_that_is_kept_ends_with_what_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its task is asked at a word of progress, as by Ctrl-C; of one that has nothing by then a sentence says so."""
    inbox, out = SimpleNamespace(taken_back=set(), kept=set()), io.BytesIO()

    def task(arguments: dict[str, object], progress: Progress) -> Frame:
        progress("searching", 0.5)
        progress("found", first=[{"name": "a"}])
        inbox.kept.add(1)
        try:
            progress("looking further", 0.9)
        except KeyboardInterrupt:
            if arguments["has"]:
                return Frame({"kept": True}, {})
            raise
        pytest.fail("it goes on")

    monkeypatch.setattr("ipmclab.page.jobs.tasks.find_task", lambda _: task)
    for has, last in ((True, {"id": 1, "done": {"kept": True}}), (False, {"id": 1, "error": worker._NOT_KEPT})):
        inbox.kept.clear()
        out.write(worker._answer({"id": 1, "task": "identify", "arguments": {"has": has}}, inbox, out))
        out.seek(0)
        told = [frame.document for frame in iter(lambda: read_frame(out), None)]
        assert told == [
            {"id": 1, "progress": "searching", "fraction": 0.5},
            {"id": 1, "progress": "searching", "fraction": 0.5, "first": [{"name": "a"}]},
            last,
        ]
        out.seek(0)
        out.truncate()


def test_a_fit_is_cancelled_while_its_worker_starts(runs: Path, tmp_path: Path, monkeypatch) -> None:
    begun, told = threading.Event(), threading.Event()
    start = subprocess.Popen

    def slow(*given, **more):
        begun.set()
        told.wait(PATIENCE)
        return start(*given, **more)

    monkeypatch.setattr("ipmclab.page.jobs.jobs.subprocess.Popen", slow)
    with Jobs() as jobs:
        job = jobs.submit("identify", _fit(runs, tmp_path / "fit.toml"))
        assert begun.wait(PATIENCE)
        jobs.cancel(job)
        told.set()
        with pytest.raises(JobCancelled):
            job.future.result(PATIENCE)


def test_a_worker_that_is_deaf_or_dies_is_replaced(runs: Path) -> None:
    with Jobs() as jobs:
        starting = jobs.submit("inspect", {"folder": str(runs)})
        until(lambda: starting.state == "running")  # its worker is loading libraries, and hears nothing
        lane = jobs._lanes["look"]
        until(lambda: lane._child is not None)
        lane._child.kill()
        with pytest.raises(IpmclabError) as caught:
            starting.future.result(PATIENCE)
        assert caught.value.code == "worker-died"
        again = jobs.submit("inspect", {"folder": str(runs)}).future.result(PATIENCE)
        assert again.document["files"] == 3
        child = lane._child
        assert child is not None
    child.wait(PATIENCE)


def test_workers_end_with_the_server(runs: Path) -> None:
    server = subprocess.Popen(
        [sys.executable, "-m", "ipmclab.page.jobs.worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert server.stdin is not None
    server.stdin.close()
    assert server.wait(PATIENCE) == 0
    assert server.stdout is not None
    server.stdout.close()


def test_a_foreign_record_is_seen_and_imported(jobs: Jobs, tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    rows = "".join(f"{k / 50:.2f};{k % 7};{k % 5},5\n".replace(".", ",") for k in range(100))
    path.write_text("made by a rig\nZeit [s];Spannung [V];Strom [mA]\n" + rows, encoding="latin-1")
    seen = jobs.submit("preview", {"path": str(path)}).future.result(PATIENCE).document
    assert seen["file"] == {"format": "csv", "separator": ";", "decimal": ",", "skip_lines": 1}
    assert seen["guesses"] == ["time", "voltage", "current"]
    assert seen["rows"][1] == ["0,02", "1", "1,5"]
    table = {"file": seen["file"], "channels": {name: {"column": place} for place, name in enumerate(seen["guesses"])}}
    frame = jobs.submit("import", {"path": str(path), "map": table}).future.result(PATIENCE)
    assert frame.arrays["current"][1] == pytest.approx(1.5e-3)
    assert frame.arrays["time"][1] == pytest.approx(0.02)
    table["channels"]["voltage"]["column"] = "U"
    with pytest.raises(InputError, match="no column 'U'"):
        jobs.submit("import", {"path": str(path), "map": table}).future.result(PATIENCE)


def test_a_preview_goes_as_far_as_the_longest_column(tmp_path: Path) -> None:
    path = tmp_path / "record.mat"
    scipy.io.savemat(path, {"t": np.arange(9) / 50.0, "U": np.arange(3.0)})
    seen = find_task("preview")({"path": str(path)}, lambda *_: None).document
    assert seen["count"] == 9
    assert [row[seen["names"].index("U")] for row in seen["rows"]] == ["0", "1", "2", *[""] * 6]


def test_a_short_job_that_takes_long_is_ended_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "record.csv"
    path.write_text("time,voltage\n0,1\n1,2\n")
    monkeypatch.setitem(TASKS, "preview", Entry("preview", LOOK, 0.01))  # no worker starts as quickly
    with Jobs() as jobs:
        job = jobs.submit("preview", {"path": str(path)}, title="import")
        with pytest.raises(IpmclabError, match=r"longer than 0\.01 s, so it was ended") as caught:
            job.future.result(PATIENCE)
        assert (caught.value.code, caught.value.where) == ("too-long", "import")
        assert "shorter record" in caught.value.repair
        monkeypatch.undo()
        assert jobs.submit("preview", {"path": str(path)}).future.result(PATIENCE).document["count"] == 2


def test_what_a_bad_upload_could_ask_is_limited_and_a_fit_is_not() -> None:
    assert {name for name, entry in TASKS.items() if entry.limit is None} == {
        "inspect",
        "identify",
        "validate",
        "report",
        "propose",
    }


@pytest.mark.parametrize("ending", ["csv.gz", "xlsx", "5.mat", "7.mat"])
def test_a_small_file_that_holds_too_much_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    monkeypatch.setattr(room, "MOST_UNPACKED", 2**21)
    for rows, is_refused in ((1000, False), (600_000, True)):
        path = tmp_path / f"{rows}.{ending}"
        _write_zeros(path, rows)
        assert path.stat().st_size < 2**19
        if is_refused:
            with pytest.raises(InputError, match="more than 2 MiB") as refused:
                room.refuse_large_here(path)
            assert "ipmclab import" in refused.value.repair
        else:
            assert unpacked_size(path, 2**21) >= 2 * rows
            room.refuse_large_here(path)


def test_the_worker_looks_at_the_size_of_a_record_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "record.csv"
    path.write_text("time,voltage\n0,1\n1,2\n")
    monkeypatch.setattr(room, "MOST_UNPACKED", 10)
    for task in ("preview", "import"):
        with pytest.raises(InputError, match="the most that is read here"):
            find_task(task)({"path": str(path), "map": {}}, lambda *_: None)


def _write_zeros(path: Path, rows: int) -> None:
    """A record of zeros, which packs well."""
    if path.name.endswith("gz"):
        path.write_bytes(gzip.compress(b"0,0\n" * rows))
    elif path.name.endswith("xlsx"):
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
            book.writestr("xl/worksheets/sheet1.xml", b"<c>0</c>" * rows)
    elif path.name.endswith("5.mat"):
        scipy.io.savemat(path, {"data": np.zeros(rows)}, do_compression=True)
    else:
        with h5py.File(path, "w", userblock_size=512) as file:
            file.create_dataset("data", data=np.zeros(rows), compression="gzip")
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file")


def _fit(runs: Path, out: Path) -> dict[str, object]:
    return {
        "actuator": "friend-2",
        "runs": [str(runs / "step.nc"), str(runs / "sine.nc")],
        "labels": ["step", "sine"],
        "free": ["electrical"],
        "out": str(out),
    }
