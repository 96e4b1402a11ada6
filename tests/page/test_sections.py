"""What the sections stand on: rows of the table, curves, names of files, maps of columns, downloads."""

from __future__ import annotations

import asyncio
import shlex
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest
from fastapi import FastAPI
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import Allowance, Run, load_actuator, propose_runs, read_fit, read_run, simulate, write_run
from ipmclab.errors import InputError
from ipmclab.page import curves
from ipmclab.page.commands import (
    identify_step,
    import_step,
    next_step,
    report_step,
    simulate_step,
    smooth_step,
    validate_step,
)
from ipmclab.page.curves import CurveStore, Panel, Series, compared_panels, run_panels
from ipmclab.page.elements.column_map import Said, channel_tables
from ipmclab.page.fit_cards import FitRequest
from ipmclab.page.jobs.tasks import find_task
from ipmclab.page.jobs.tasks.given import finding_row
from ipmclab.page.lab import Lab
from ipmclab.page.routes import header_name, routes
from ipmclab.page.run_table import MOST_SHOWN, RunFilter, runs_in_words, table_rows
from ipmclab.page.workshop import Workshop
from ipmclab.prediction.bands import Bands
from ipmclab.rig.safety.limits import Limits
from ipmclab.run import Finding
from ipmclab.store.catalogue.catalogue import Catalogue
from ipmclab.store.catalogue.query import CatalogueRow
from ipmclab.store.guess.guess import guess_channels, guess_file
from ipmclab.store.importers import read_columns
from ipmclab.store.importers.csv import CsvFile
from ipmclab.units import CURRENT
from tests.waiting import HANGS

BLANK = {"unit": "", "factor": "", "sign": "1", "zero_at": "", "sentinels": ""}


class Client:
    """Asks an application without a network."""

    def __init__(self, app: FastAPI) -> None:
        self._app = app

    def get(self, address: str, **more: Any) -> httpx.Response:
        return self._ask("GET", address, **more)

    def post(self, address: str, **more: Any) -> httpx.Response:
        return self._ask("POST", address, **more)

    def _ask(self, method: str, address: str, **more: Any) -> httpx.Response:
        async def ask() -> httpx.Response:
            transport = httpx.ASGITransport(app=self._app)
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1", timeout=HANGS) as client:
                return await client.request(method, address, **more)

        return asyncio.run(ask())


@pytest.fixture
def workshop(tmp_path: Path) -> Iterator[Workshop]:
    strip = load_actuator("friend-2")
    (tmp_path / "runs").mkdir()
    for name, signal in (("step", "step 1 V"), ("sine", "sine 1 V 0.1 Hz")):
        write_run(simulate(strip, signal, duration=10.0, rate=50.0), tmp_path / "runs" / f"{name}.nc")
    made = Workshop(Lab.open(tmp_path))
    yield made
    made.close()


@pytest.fixture
def client(workshop: Workshop) -> Client:
    app = FastAPI()
    app.include_router(routes(workshop))
    return Client(app)


def row(**values: object) -> CatalogueRow:
    empty = dict.fromkeys(CatalogueRow._fields)
    return CatalogueRow(**{**empty, "id": 1, "version": 1, "path": "a.nc", "finding_codes": " ", **values})  # type: ignore[arg-type]


def test_the_table_filters_by_what_is_known_of_a_run() -> None:
    rows = [
        row(id=1, path="runs/a.nc", sample="strip-1", channels=" voltage current ", finding_codes=" clipped spike "),
        row(id=2, path="runs/b.nc", sample="strip-2", channels=" voltage force ", finding_codes=" fingerprint "),
        row(id=3, path="runs/c.nc", sample="strip-2", channels=" voltage force ", finding_codes=None, state="aborted"),
        row(id=4, path="runs/d.nc", mounting="m7", problem="it is damaged", finding_codes=None),
    ]

    def found(**wanted: str) -> list[int]:
        return sorted(one["id"] for one in table_rows(rows, RunFilter(**wanted))[0])

    assert found() == [1, 2, 3, 4]
    assert found(sample="strip-2") == [2, 3]
    assert found(measured="force", text="B.NC strip") == [2]
    assert found(finding="none") == [2]
    assert found(finding="any") == [1]
    assert found(finding="spike") == [1]
    assert found(state="aborted") == [3]
    assert found(text="m7") == [4]
    assert found(text="nothing has this") == []
    assert found(text="none") == [2]  # not what is left empty
    assert found(text="4") == []  # nor what nobody sees
    shown = {one["id"]: one for one in table_rows(rows, RunFilter())[0]}
    assert shown[1]["findings"] == "clipped, spike"
    assert shown[2]["findings"] == "none"
    assert shown[3]["findings"] == "aborted; not checked yet"
    assert shown[4]["key"] == ""
    assert "it is damaged" in shown[4]["findings"]


def test_runs_that_are_called_alike_are_told_apart() -> None:
    rows = [
        row(id=1, path="a/step.nc", drive="step 1 V", sample="strip-1", recorded=0.0),
        row(id=2, path="b/step.nc", drive="step 1 V"),
        row(id=3, path="c/sine.nc", problem="it is damaged"),
        row(id=4, path="c/mute.nc"),
        row(id=5, path=None, state="missing"),
        row(id=6, path=None, state="missing"),
    ]
    assert [one["name"] for one in table_rows(rows, RunFilter())[0]] == ["–", "–", "mute", "sine", "b/step", "a/step"]
    told = runs_in_words(rows)
    assert list(told) == ["c/mute.nc", "b/step.nc", "a/step.nc"]
    assert told["c/mute.nc"] == ""
    assert told["b/step.nc"] == "step 1 V"
    assert told["a/step.nc"].startswith("step 1 V, strip-1, 19")


def test_the_table_sends_no_more_rows_than_a_browser_can_use() -> None:
    rows, count = table_rows([row(id=k) for k in range(3 * MOST_SHOWN)], RunFilter())
    assert (len(rows), count) == (MOST_SHOWN, 3 * MOST_SHOWN)
    assert rows[0]["id"] == 3 * MOST_SHOWN - 1


def test_runs_are_compared_channel_by_channel(workshop: Workshop) -> None:
    runs = {name: workshop.runs.read(f"runs/{name}.nc") for name in ("step", "sine")}
    slow = replace(runs["sine"], temperature=np.array([20.0, 21.0]), time_environment=np.array([0.0, 9.0]), force=None)
    panels = {panel.key: panel for panel in run_panels({"a": runs["step"], "b": slow})}
    assert [one.label for one in panels["current"].series] == ["a", "b"]
    assert len({(one.colour, one.style) for one in panels["current"].series}) == 2
    assert [one.label for one in panels["force"].series] == ["a"]
    assert len(panels["temperature"].series[0].time) == 2
    assert panels["current"].factor == 1000.0


def test_measured_stands_beside_each_model_and_what_is_left_over() -> None:
    time = np.arange(3.0)
    arrays = {
        f"{prefix}.force.{what}": np.full(3, value)
        for prefix, value in (("0.1", 1.0), ("1.1", 2.0))
        for what in ("measured", "model", "residual")
    } | {f"{prefix}.force.time": time for prefix in ("0.1", "1.1")}
    above, below = compared_panels(arrays, {"0.1": "mine", "1.1": "other"}, residuals=True)
    assert [one.label for one in above.series] == ["measured", "mine", "other"]
    assert [one.label for one in below.series] == ["mine", "other"]


def test_curves_are_bounded_in_memory_and_the_oldest_go() -> None:
    store = CurveStore(most_bytes=10_000)
    addresses = []
    for _ in range(4):
        time = np.arange(500.0)
        addresses.append(store.add([Panel.of("current", CURRENT, [Series("c", "c", time, time)])]))
        store.get(addresses[0].rpartition("/")[2])  # looked at all the time
    kept = [store.get(one.rpartition("/")[2]) is not None for one in addresses]
    assert kept == [True, False, False, True]


def test_curves_come_thinned_and_whole() -> None:
    store = CurveStore()
    time = np.arange(100_000) / 100.0
    values = np.zeros(100_000)
    values[31_415] = 0.06
    values[60_000:61_000] = np.nan
    app = FastAPI()
    app.include_router(curves.routes(store))
    client = Client(app)
    address = store.add([Panel.of("current", CURRENT, [Series("c", "", time, values)])])
    whole = client.get(address, params={"points": 1000}).content
    assert len(whole) < 40_000
    assert b"c.value" in whole
    part = client.get(address, params={"begin": 314.0, "end": 315.0}).content
    assert len(part) < 8 * 2 * 110 + 300
    lines = client.get(address, params={"csv": 'a"\r\nb'}).text.splitlines()
    assert len(lines) == 100_001
    assert lines[31_416] == "314.15,60"
    assert lines[60_001] == "600,"
    assert client.get("/curves/unknown").status_code == 404


@given(st.text(max_size=30))
def test_a_name_in_a_header_is_always_one(name: str) -> None:
    kept = header_name(name)
    assert kept
    assert kept.isascii()
    assert not set(kept) & set('"\\/\r\n; ')


@pytest.mark.parametrize("key", ["../secret.nc", "/etc/passwd", "runs/../../secret.nc", "runs/nothing.nc", "a\0b"])
def test_no_run_outside_the_folder_is_sent(client: Client, workshop: Workshop, key: str) -> None:
    (workshop.lab.root.parent / "secret.nc").write_bytes(b"secret")
    for address in ("/runs/file", "/runs/export", "/runs/figure"):
        answer = client.get(address, params={"run": key})
        assert answer.status_code in (404, 422)
        assert b"secret" not in answer.content or key.encode() in answer.content
    answer = client.post("/simulate", json={"actuator": "friend-2", "changes": {}, "run": key})
    assert answer.status_code == 422
    answer = client.post(
        "/simulate", json={"actuator": "../x.toml", "changes": {}, "signal": "", "duration": 1, "rate": 1}
    )
    assert answer.json()["code"] == "outside-folder"


def test_a_figure_has_as_many_runs_as_can_be_told_apart(client: Client) -> None:
    """Eight colours: more are refused before anybody looks for their files."""
    for count, told in ((8, "there is no run 'runs/0.nc'"), (9, "9 runs, at most 8 fit on a figure")):
        answer = client.get("/runs/figure", params={"run": [f"runs/{k}.nc" for k in range(count)], "kind": "svg"})
        assert answer.status_code in (404, 422)
        assert told in answer.text


def test_a_figure_tells_runs_apart_that_are_called_alike(client: Client, workshop: Workshop, monkeypatch) -> None:
    """Its legend has the folder of each, as the plot of the page has."""
    copy = workshop.lab.root / "step.nc"
    copy.write_bytes((workshop.lab.root / "runs" / "step.nc").read_bytes())
    asked: list[dict[str, Any]] = []

    def submit(task: str, arguments: dict[str, Any], **_: object) -> SimpleNamespace:
        asked.append(arguments)
        return SimpleNamespace(future=Future(), number=0)

    monkeypatch.setattr(workshop.jobs, "submit", submit)
    monkeypatch.setattr(workshop.jobs, "cancel", lambda _: None)
    monkeypatch.setattr("ipmclab.page.routes._PATIENCE", 0.0)
    client.get("/runs/figure", params={"run": ["runs/step.nc", "step.nc", "runs/sine.nc"]})
    assert asked[0]["labels"] == ["runs/step", "step", "sine"]


def test_a_name_that_no_file_can_have_is_none_of_the_folder(client: Client) -> None:
    for key in (300 * "a" + ".nc", 5000 * "a" + ".nc", 3000 * "a/" + "b.nc"):
        for address in ("/runs/file", "/runs/export", "/runs/figure"):
            assert client.get(address, params={"run": key}).status_code in (404, 422)
        answer = client.post("/simulate", json={"actuator": "friend-2", "changes": {}, "run": key})
        assert answer.status_code == 422
    assert client.get(f"/reports/{5000 * 'a'}.html").status_code == 404
    asked = {"actuator": 5000 * "a" + ".toml", "changes": {}, "signal": "step 1 V", "duration": 1, "rate": 10}
    assert client.post("/simulate", json=asked).status_code == 422


@pytest.mark.parametrize("name", ["/etc/passwd", "../secret.csv", "'../secret.csv'"])
def test_a_signal_takes_samples_from_the_folder_only(client: Client, workshop: Workshop, name: str) -> None:
    for folder in (workshop.lab.root, workshop.lab.root.parent):
        (folder / "secret.csv").write_text("time,voltage\n0,0\n1,1\n")
    asked = {"actuator": "friend-2", "changes": {}, "duration": 2, "rate": 10}
    refused = client.post("/simulate", json={**asked, "signal": f"step 1 V for 1 s then file {name}"})
    assert (refused.status_code, refused.json()["code"]) == (422, "outside-folder")
    assert refused.json()["where"] == "signal"  # the field that it stands in
    if name.startswith("'"):  # wherever the server was started
        assert client.post("/simulate", json={**asked, "signal": "file secret.csv"}).status_code == 200


def test_a_run_is_downloaded_as_it_is_and_in_other_formats(client: Client, workshop: Workshop) -> None:
    sent = client.get("/runs/file", params={"run": "runs/step.nc"})
    assert sent.content == (workshop.lab.root / "runs" / "step.nc").read_bytes()
    table = client.get("/runs/export", params={"run": "runs/step.nc", "kind": "csv"})
    assert 'filename="step.csv"' in table.headers["content-disposition"]
    copy = workshop.lab.root / "copy.csv"
    copy.write_bytes(table.content)
    from ipmclab import import_run

    again, first = import_run(copy).current, read_run(workshop.lab.root / "runs" / "step.nc").current
    assert again is not None
    assert first is not None
    np.testing.assert_array_equal(again, first)
    figure = client.get("/runs/figure", params={"run": ["runs/step.nc", "runs/sine.nc"], "kind": "svg"})
    assert figure.text.lstrip().startswith("<?xml")
    assert client.get("/runs/export", params={"run": "runs/step.nc", "kind": "exe"}).status_code == 404
    assert not list(workshop.scratch.iterdir())  # what was sent is not kept


def test_an_upload_is_bounded(client: Client, workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    told = client.post("/uploads", params={"name": "../../a b.csv"}, content=b"1;2").json()
    assert told["name"] == "a b.csv"
    assert told["key"].endswith("-ab.csv")
    assert (workshop.scratch / told["key"]).read_bytes() == b"1;2"
    monkeypatch.setattr("ipmclab.page.routes.MOST_BYTES", 1000)
    before = list(workshop.scratch.iterdir())
    refused = client.post("/uploads", params={"name": "large.csv"}, content=b"x" * 2000)
    assert refused.status_code == 413
    assert list(workshop.scratch.iterdir()) == before


@pytest.mark.parametrize(
    ("name", "kept"), [("данные.xlsx", "data.xlsx"), (f"{'x' * 150}.mat", f"{'x' * 80}.mat"), ("测量", "data")]
)
def test_a_record_keeps_its_ending_whatever_it_is_called(client: Client, name: str, kept: str) -> None:
    """By its ending a workbook is known."""
    told = client.post("/uploads", params={"name": name}, content=b"1;2").json()
    assert told["key"].partition("-")[2] == kept
    assert told["name"] == name


def test_a_run_says_from_which_file_it_was_imported(tmp_path: Path) -> None:
    """As its owner called it, not as the server did while it was here."""
    kept = tmp_path / "0123456789abcdef-data.csv"
    kept.write_text("t,U\n0,0\n1,1\n2,1\n")
    channels = {"time": {"column": "t", "unit": "s"}, "voltage": {"column": "U", "unit": "V"}}
    asked = {"path": str(kept), "map": {"channels": channels, "file": {"format": "csv"}}, "out": str(tmp_path / "a.nc")}
    find_task("import")({**asked, "name": "данные.csv"}, lambda *_: None)
    assert read_run(tmp_path / "a.nc").metadata.source_file == "данные.csv"


def test_lost_readings_that_the_file_has_not_are_said(tmp_path: Path) -> None:
    """A comma in one makes two of it: what the laser says when it has lost the strip then counts as a reading."""
    (tmp_path / "a.csv").write_text("t,U,x\n0,0,1\n1,1,-99.5\n2,1,2\n")
    for lost, told in (("-99,5", ["No reading of the displacement is -99 or 5"]), ("-99.5; 7", [])):
        columns = [{**BLANK, "channel": "time", "unit": "s"}, {**BLANK, "channel": "voltage", "unit": "V"}]
        columns.append({**BLANK, "channel": "displacement", "unit": "mm", "sentinels": lost})
        table = {"channels": channel_tables(["t", "U", "x"], columns), "file": {"format": "csv"}}
        answer = find_task("import")({"path": str(tmp_path / "a.csv"), "map": table}, lambda *_: None)
        assert answer.document["unmet"] == told


@pytest.mark.parametrize(
    ("rows", "times"),
    [
        ([(500, 501), (10, 12), (13, 14), (999, 1000)], [[1.0, 1.4], [50.0, 50.1], [99.9, 99.9]]),
        ([(100, 300), (120, 150)], [[10.0, 30.0]]),
        ([(0, 800)], [[0.0, 80.0]]),
        ([(0, 950)], []),
        ([], []),
    ],
)
def test_a_finding_is_marked_where_it_is(rows: list[tuple[int, int]], times: list[list[float]]) -> None:
    """What no screen shows apart is one mark; what is nearly everywhere has none, which would hide what it marks."""
    time = np.arange(1000) / 10.0
    finding = Finding("spike", "warning", "m", "r", channel="current", samples=tuple(rows))
    assert finding_row(finding, Run.from_arrays(time=time, voltage=time))["times"] == times
    assert "times" not in finding_row(finding)


def test_a_report_is_shown_without_anything_that_runs(client: Client, workshop: Workshop) -> None:
    (workshop.lab.root / "report.html").write_text("<p>well</p>", encoding="utf-8")
    (workshop.lab.root / "note.txt").write_text("no report", encoding="utf-8")
    answer = client.get("/reports/report.html")
    assert "well" in answer.text
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert client.get("/reports/report.html", params={"save": True}).headers["content-disposition"].startswith("attach")
    assert client.get("/reports/note.txt").status_code == 404
    assert client.get("/reports/..%2Freport.html").status_code == 404


@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{}", b'{"actuator": "friend-2", "changes": {"x": "y"}}', b"\xff", b"[" * 200_000]
)
def test_a_question_that_is_none_is_refused(client: Client, body: bytes) -> None:
    assert client.post("/simulate", content=body).status_code in (400, 422)


def test_who_still_waits_when_the_server_ends_is_told(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    waited_for: list[Future[None]] = []

    def submit(*_: object, **__: object) -> SimpleNamespace:
        waited_for.append(Future())  # of a job that is never done
        return SimpleNamespace(future=waited_for[-1])

    monkeypatch.setattr(workshop.jobs, "submit", submit)
    app = FastAPI()
    app.include_router(routes(workshop))
    question = {"actuator": "friend-2", "changes": {}, "signal": "step 1 V", "duration": 1, "rate": 10}

    async def ended() -> list[int]:
        transport = httpx.ASGITransport(app=app)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            asked = [client.post("/simulate", json=question), client.get("/runs/export?run=runs/step.nc")]
            waiting = [asyncio.create_task(one) for one in asked]
            async with asyncio.timeout(60.0):
                while len(waited_for) < len(asked):
                    await asyncio.sleep(0.01)
            for one in waiting:
                one.cancel()
            return [(await one).status_code for one in waiting]

    assert asyncio.run(ended()) == [503, 503]


def test_what_was_said_of_a_column_outlasts_another_layout() -> None:
    names, guesses = ("time", "U", "I"), ("time", "voltage", "current")
    said = Said()
    time, voltage, current = said.begin(names, guesses)
    assert [one["channel"] for one in (time, voltage, current)] == list(guesses)
    said.keep([time, {**voltage, "channel": ""}, {**current, "unit": "mA"}])
    whole = said.begin(("0.0;1.0;2.0",), (None,))  # read by a wrong separator
    said.keep(whole)
    assert [one["unit"] for one in said.begin(names, guesses)] == ["", "", "mA"]
    unnamed = said.begin(("", "", ""), (None, None, None))  # its first line is no heading
    assert [(one["channel"], one["unit"]) for one in unnamed] == [("", ""), ("", ""), ("current", "mA")]
    said.keep(unnamed)
    # A heading that was not read gives no guess; what nobody said is guessed anew, and no channel twice.
    again = said.begin(("time", "I", "I of the shunt"), ("time", None, "current"))
    assert [(one["channel"], one["unit"]) for one in again] == [("time", ""), ("current", "mA"), ("", "")]
    said.keep([again[0], {**again[1], "unit": "A"}, again[2]])
    assert said.begin(names, guesses)[2]["unit"] == "A"


def test_what_a_column_is_said_to_be_becomes_a_map() -> None:
    names = ("t", "U", "U", "laser")
    columns = [
        {**BLANK, "channel": "time", "unit": "ms"},
        {**BLANK, "channel": "voltage", "sign": "-1"},
        {**BLANK, "channel": ""},
        {
            **BLANK,
            "channel": "displacement",
            "unit": "mm",
            "factor": "2.5",
            "zero_at": "12.3 mm",
            "sentinels": "99; -1",
        },
    ]
    assert channel_tables(names, columns) == {
        "time": {"column": "t", "unit": "ms"},
        "voltage": {"column": 1, "sign": -1},
        "displacement": {
            "column": "laser",
            "unit": "mm",
            "factor": 2.5,
            "zero_at": "12.3 mm",
            "sentinels": [99.0, -1.0],
        },
    }
    with pytest.raises(InputError, match="two columns are said to be the voltage"):
        channel_tables(names, [{**BLANK, "channel": "voltage"}] * 2 + [{**BLANK, "channel": ""}] * 2)
    with pytest.raises(InputError, match=r"the factor, '1,5', is no plain number; write a point .*1\.5") as caught:
        channel_tables(("U",), [{**BLANK, "channel": "voltage", "factor": "1,5"}])
    assert caught.value.where == "channels.voltage"


@pytest.mark.parametrize(
    ("text", "layout"),
    [
        ("t,U\n0,1\n0.02,1\n", {"format": "csv", "separator": ","}),
        ("t;U\n0,0;1,5\n0,2;1,5\n", {"format": "csv", "separator": ";", "decimal": ","}),
        ("0\t1\n1\t1\n", {"format": "csv", "separator": "\t", "header": False}),
        ("# a rig\nt,U\ns,V\n0,1\n1,1\n", {"format": "csv", "separator": ",", "units_row": True, "skip_lines": 1}),
        ("\na rig\n\nt,U\n0,1\n1,2\n", {"format": "csv", "separator": ",", "skip_lines": 3}),
    ],
)
def test_how_a_text_is_written_is_guessed(tmp_path: Path, text: str, layout: dict[str, object]) -> None:
    path = tmp_path / "record.txt"
    path.write_text(text)
    assert guess_file(path) == layout


def test_a_binary_file_of_no_known_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "record.bin"
    path.write_bytes(bytes(100))
    with pytest.raises(InputError, match="write a map that describes it"):
        guess_file(path)


def test_headings_say_what_columns_are(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    for names, rows, expected in (
        ("Time [s],Voltage,I / mA,load cell", "0,0,1,2", ["time", "voltage", "current", "force"]),
        ("t,U,I", "0,1,broken", ["time", "voltage", None]),
        (",notes", "1,2", [None, None]),
    ):
        path.write_text(f"{names}\n{rows}\n{rows.replace('0', '3', 1)}\n")
        columns = read_columns(path, CsvFile(format="csv"))
        assert guess_channels(path, {"format": "csv"}, columns) == expected


def test_each_step_is_one_command_and_its_python_runs(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    """The Python of a step does what it says, and the command line takes its command."""
    from ipmclab.cli.app import run as run_command

    monkeypatch.chdir(workshop.lab.root)
    fit = identify_step("friend-2", ["runs/step.nc"], ["circuit.dc_resistivity"], out="fitted.toml")
    exec(fit.python, {})
    assert run_command([*shlex.split(fit.command)[1:-1], "again.toml"]) == 0
    assert Path("again.toml").read_text().splitlines()[:20] == Path("fitted.toml").read_text().splitlines()[:20]
    assert run_command(shlex.split(validate_step(["fitted.toml", "friend-2"], ["runs/sine.nc"]).command)[1:]) == 0
    assert run_command(shlex.split(report_step("fitted.toml", ["runs/step.nc"], [], "r.html").command)[1:]) == 0
    limits = {"voltage": "1 V", "current": "200 mA"}
    asked = next_step("fitted.toml", "prediction", 4.0, limits=limits, longest="10 s", inputs=["step 1 V for 5 s"])
    exec(asked.python, {})
    assert run_command(shlex.split(asked.command)[1:]) == 0
    arguments = {"fit": "fitted.toml", "goal": "prediction", "minutes": 4.0, "limits": limits, "longest": 10.0}
    told = find_task("propose")({**arguments, "inputs": ["step 1 V for 5 s"], "rival": ""}, lambda *_: None).document
    proposed = propose_runs(
        read_fit("fitted.toml"),
        goal="prediction",
        minutes=4.0,
        allowed=Allowance(limits=Limits.from_table(limits), longest=10.0),
        inputs=["step 1 V for 5 s"],
    )
    assert [row["signal"] for row in told["runs"]] == [str(one.candidate.signal) for one in proposed.runs]
    assert [row["name"] for row in told["expected"]] == ["circuit.dc_resistivity"]
    simulated = simulate_step("friend-2", {"beam.modulus": 2e9}, signal="step 1 V", duration=1.0, rate=50.0)
    exec(simulated.python, {})
    first = read_run("run.nc")
    Path("run.nc").unlink()
    assert run_command(shlex.split(simulated.command)[1:]) == 0
    np.testing.assert_array_equal(read_run("run.nc").force, first.force)
    Path("run.nc").unlink()
    known: dict[str, object] = {}
    exec(simulate_step("fitted.toml", {}, signal="step 1 V", duration=1.0, rate=50.0, is_fit=True).python, known)
    assert isinstance(known["bands"], Bands)
    assert isinstance(known["run"], Run)
    np.testing.assert_array_equal(known["bands"].predicted["current"], known["run"].current)
    assert import_step("a.csv", "a.map.toml", "a.nc").command == "ipmclab import a.csv --map a.map.toml --out a.nc"


@pytest.mark.parametrize("number", [33.3333333, 1.0 / 3.0, 50.0, 1e-7])
def test_a_command_says_the_very_number(number: float) -> None:
    told = shlex.split(simulate_step("friend-2", {}, signal="step 1 V", duration=number, rate=number).command)
    told += shlex.split(smooth_step("a.nc", number, "b.nc").command)
    for option in ("--duration", "--rate", "--below"):
        assert float(told[told.index(option) + 1].split()[0]) == number


def test_a_command_that_takes_a_changed_actuator_says_where_its_file_comes_from() -> None:
    changed = simulate_step("friend-2", {"beam.modulus": 2e9}, signal="step 1 V")
    assert "simulate changed.toml" in changed.command
    assert "changed.toml" in changed.note
    assert simulate_step("friend-2", {}, signal="step 1 V").note == ""


def test_a_parameter_of_each_mounting_is_one_in_command_python_and_worker(workshop: Workshop, monkeypatch) -> None:
    monkeypatch.chdir(workshop.lab.root)
    contact = "circuit.contact_resistance"
    asked = FitRequest(
        name="each", actuator="friend-2", runs=("a.nc", "b.nc"), free=(), per_mounting=(contact,), prior=()
    )
    for name, source, mounting in (("a", "step", "one"), ("b", "sine", "two")):
        run = read_run(workshop.lab.root / "runs" / f"{source}.nc")
        write_run(replace(run, metadata=replace(run.metadata, mounting_id=mounting)), f"{name}.nc")
    names = [f"{contact}[mounting one]", f"{contact}[mounting two]"]
    told = workshop.identify(asked).job.future.result(HANGS).document
    assert [row["name"] for row in told["parameters"]] == names
    step = identify_step("friend-2", asked.runs, (), (), (contact,), out="each.toml")
    assert f"--free {contact} --per-mounting {contact}" in step.command
    exec(step.python, {})
    assert list(read_fit("each.toml").parameters) == names
    failed = workshop.identify(replace(asked, name="unsaid", runs=("runs/step.nc",))).job.future.exception(60.0)
    assert isinstance(failed, InputError)
    assert failed.code == "no-mounting"
    assert "this run does not say of which it is" in failed.message


def test_fits_are_bounded_and_the_oldest_that_is_over_goes(workshop: Workshop) -> None:
    def ask(name: str) -> FitRequest:
        return FitRequest(name=name, actuator="friend-2+no-such-stage", runs=("runs/step.nc",), free=("electrical",))

    first = workshop.identify(ask("0"))
    assert first.job.future.exception(60.0) is not None
    assert (first.job.state, first.frame) == ("failed", None)
    for number in range(1, 22):
        workshop.identify(ask(str(number))).job.future.exception(60.0)
    assert [one.asked.name for one in workshop.fits] == [str(number) for number in range(2, 22)]
    with pytest.raises(InputError, match="there is no run"):
        workshop.identify(FitRequest(name="x", actuator="friend-2", runs=("runs/none.nc",), free=("electrical",)))


def test_the_runs_of_a_fit_are_found_by_their_content(workshop: Workshop) -> None:
    from ipmclab import identify, write_fit

    root = workshop.lab.root
    runs: list[Run] = [read_run(root / "runs" / f"{name}.nc") for name in ("sine", "step")]
    write_fit(identify(load_actuator("friend-2"), runs, free="circuit.dc_resistivity"), root / "fitted.toml")
    Catalogue(root).sweep()
    (root / "runs" / "sine.nc").rename(root / "other.nc")
    Catalogue(root).sweep()
    assert workshop.fitted_files() == ["fitted.toml"]
    assert workshop.runs_of_fit("fitted.toml") == (["other.nc", "runs/step.nc"], [])
    (root / "other.nc").unlink()
    Catalogue(root).sweep()
    found, missing = workshop.runs_of_fit("fitted.toml")
    assert (found, len(missing)) == (["runs/step.nc"], 1)
    with pytest.raises(InputError, match="no fitted actuator"):
        workshop.runs_of_fit("friend-2")


def test_the_server_knows_no_compiler() -> None:
    import subprocess
    import sys

    code = (
        "import sys, ipmclab.page.server\n"
        "from ipmclab.page.sections import identify, report, run, runs, simulate\n"
        "from ipmclab import load_actuator; load_actuator('friend-2+leak.cubic').parameters()\n"
        "print([name for name in ('numba', 'scipy', 'matplotlib') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
