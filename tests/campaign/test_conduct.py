"""A campaign at the virtual bench: carried out, broken off, gone on with."""

import json
from dataclasses import replace
from importlib import resources
from pathlib import Path
from uuid import uuid4

import pytest

from benchmarks.campaign_kills import CAMPAIGN as MODELLED
from benchmarks.campaign_kills import disturbed, result
from ipmclab import load_actuator, read_run, write_actuator
from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.board import board_of
from ipmclab.campaign.campaign_file import campaign_from_text
from ipmclab.campaign.conduct import Conduct, Sat
from ipmclab.campaign.sitting import sittings_of
from ipmclab.campaign.state import State, read_events
from ipmclab.cli.app import run
from ipmclab.cli.record_view import View
from ipmclab.cli.sitting import by_recorder
from ipmclab.errors import IpmclabError
from ipmclab.store.journal.laboratory import Laboratory
from tests.campaign.carried_out import begun, carry_out

pytestmark = pytest.mark.usefixtures("finished_here")

CAMPAIGN = MODELLED.replace("seed = 7", "seed = 7\nidentify = false")
"""A kill is about runs: without the models of the samples, which take most of the time."""

ONE = CAMPAIGN.format(repeats=1).replace('"step 1 V", "sine 1 V 2 Hz"', '"step 1 V"')
"""Two strips with a run each."""

SMALL = CAMPAIGN.format(repeats=1).replace('[[samples]]\nid = "friend-3"\nactuator = "friend-3-measured"\n', "")
"""One strip with two runs."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict[str, object]]:
    """A campaign that nobody disturbed, and what it gave."""
    folder = tmp_path_factory.mktemp("whole")
    file = folder / "campaign.toml"
    file.write_text(SMALL)
    carry_out(campaign_from_text(SMALL), folder / "out")
    return file, folder / "out", result(folder / "out")


def test_every_run_is_recorded_once_in_its_order(whole):
    file, out, found = whole
    campaign = campaign_from_text(file.read_text())
    planned = [run.id for block in blocks_of(campaign) for run in block.runs]
    events = read_events(out)
    assert [one["run"] for one in events if one["event"] == "recorded"] == planned
    assert {name for name in found if "/" in name} == set(planned)
    first = next(one for one in events if one["event"] == "recorded")
    about = read_run(out / first["path"]).metadata
    assert about.uuid == first["uuid"]
    assert about.sample.id == first["run"].partition("/")[0]
    assert about.experiment == "killed: displacement"
    assert about.mounting_id.startswith("virtual-")


def test_killed_at_random_moments_it_gives_the_same(whole, tmp_path):
    file, _, expected = whole
    found, met = disturbed(file, tmp_path / "out", [0.2, 0.6])
    assert met == 2
    assert found == expected


def test_what_is_done_is_not_done_again(whole, capsys):
    file, out, _ = whole
    before = read_events(out)
    assert run(["characterise", str(file), "--out", str(out), "--json"]) == 0
    assert read_events(out) == before
    assert json.loads(capsys.readouterr().out)["flagged"] == []


def test_another_campaign_is_refused(whole, tmp_path, capsys):
    file, out, _ = whole
    (tmp_path / "other.toml").write_text(file.read_text() + "# the same in other words\n")
    assert run(["characterise", str(tmp_path / "other.toml"), "--out", str(out)]) == 0
    (tmp_path / "other.toml").write_text(file.read_text().replace("seed = 7", "seed = 8"))
    assert run(["characterise", str(tmp_path / "other.toml"), "--out", str(out)]) == 2
    assert "another campaign" in capsys.readouterr().err


def conduct(text: str, folder: Path, *, state: State, sit=None) -> Conduct:
    return begun(campaign_from_text(text), folder, state, sit)


def test_a_run_that_fails_is_repeated_and_then_flagged(tmp_path, monkeypatch):
    from ipmclab.campaign import conduct as module
    from ipmclab.run import Finding

    bad = Finding("laser-lost", "error", "it sees nothing")
    monkeypatch.setattr(module, "check", lambda run: [bad] if run.metadata.sample.id == "friend-1" else [])
    with State(tmp_path) as state:
        conduct(ONE, tmp_path, state=state).run()
        verdicts = [(one["run"].partition("/")[0], one["verdict"]) for one in state.of("recorded")]
    assert sorted(verdicts) == [("friend-1", "flagged"), ("friend-1", "repeat"), ("friend-3", "kept")]


def test_a_run_whose_file_cannot_be_read_is_recorded_as_often_as_the_campaign_allows(tmp_path, monkeypatch):
    from ipmclab.campaign import conduct as module
    from ipmclab.campaign.results import read_results

    def unreadable(path):
        if "friend-1" in path.name:
            path.write_bytes(b"no run")
        return read_run(path)

    monkeypatch.setattr(module, "read_run", unreadable)
    with State(tmp_path) as state:
        one = conduct(ONE, tmp_path, state=state)
        with pytest.raises(IpmclabError, match="cannot be read") as told:
            one.run()
        assert "continues with the next run" in told.value.repair
    with State(tmp_path) as state:
        one = conduct(ONE, tmp_path, state=state)
        one.run()
        verdicts = [(event["run"].partition("/")[0], event["verdict"]) for event in state.of("recorded")]
        kept = read_results(tmp_path, blocks_of(campaign_from_text(ONE)), state.recorded)
    assert sorted(verdicts) == [("friend-1", "flagged"), ("friend-1", "repeat"), ("friend-3", "kept")]
    assert [result.run.sample for result in kept] == ["friend-3"]


def test_a_run_that_always_ends_early_is_not_recorded_without_end(tmp_path, monkeypatch):
    from ipmclab.campaign import conduct as module

    def half(path):
        run = read_run(path)
        return replace(run, metadata=replace(run.metadata, state="recovered"))

    monkeypatch.setattr(module, "read_run", half)
    with State(tmp_path) as state:
        conduct(ONE, tmp_path, state=state).run()
        assert sorted(event["verdict"] for event in state.of("recorded")) == ["flagged", "flagged", "repeat", "repeat"]


def test_what_the_guard_ends_is_flagged_and_ends_the_campaign(tmp_path):
    limited = ONE.replace("[method]", '[method]\nlimits = { charge = "1 C", current = "1 A", energy = "5 mJ" }')
    limited = limited.replace('"5 mJ"', '{ most = "5 mJ", action = "zero" }')
    with State(tmp_path) as state:
        one = conduct(limited, tmp_path, state=state)
        with pytest.raises(IpmclabError, match="energy") as told:
            one.run()
        assert "look at the strip" in told.value.repair
        assert [event["verdict"] for event in state.of("recorded")] == ["flagged"]
        assert one.left == 1


def test_a_stop_keeps_what_is_there_and_the_run_is_recorded_anew(tmp_path):
    with State(tmp_path) as state:
        one = conduct(ONE, tmp_path, state=state, sit=lambda *_: Sat("stop", "stopped by the operator"))
        with pytest.raises(IpmclabError, match="continues with the next run"):
            one.run()
    with State(tmp_path) as state:
        one = conduct(ONE, tmp_path, state=state)
        one.run()
        assert not one.left
    assert len(result(tmp_path)) == 2 + 8  # runs and facts


def test_a_recorder_of_its_own_sits_through_a_block_of_several_runs(tmp_path):
    file = tmp_path / "campaign.toml"
    (tmp_path / "rig.toml").write_text((resources.files("ipmclab.rig.files") / "library" / "thesis.toml").read_text())
    file.write_text(CAMPAIGN.format(repeats=1).replace('title = "killed"', 'title = "killed"\nrig = "rig.toml"'))
    campaign = campaign_from_text(file.read_text(), folder=tmp_path, where=str(file))
    laboratory = Laboratory.open(tmp_path / "out")
    real = replace(campaign, rig=replace(campaign.rig, bench="ni"))
    with State(laboratory.root) as state:
        sitting = next(sittings_of(real, blocks_of(campaign)))
        assert len(sitting.runs) == 2
        options = {"file": file, "answers": {}, "yes": True, "keys": False}
        sat = by_recorder(campaign, laboratory, sitting, View(quiet=True, keys=False), options)
        assert sat.ended == "done"
        one = Conduct(campaign, blocks_of(campaign), laboratory, state, sit=lambda *_: sat, on_progress=lambda _: None)
        state.add("sitting", block=1, runs=dict(zip([run.id for run in sitting.runs], sitting.uuids, strict=True)))
        one.begin()
        assert state.done == {run.id for run in sitting.runs}


def test_half_a_run_that_a_crash_left_is_kept_as_such_and_recorded_again(tmp_path):
    from ipmclab import load_actuator, simulate, write_run
    from ipmclab.run import RunMetadata

    laboratory = Laboratory.open(tmp_path)
    uuid, planned = str(uuid4()), blocks_of(campaign_from_text(SMALL))[0].runs[0]
    run_of = simulate(load_actuator("friend-1-measured"), "step 1 V", duration=0.5, rate=50.0)
    about = RunMetadata(uuid=uuid, state="recovered", recorded_at="2026-11-23T08:00:00", rig="r", signal="step 1 V")
    path = laboratory.run_file(uuid, about, about.recorded_at)
    path.parent.mkdir(parents=True)
    write_run(replace(run_of, metadata=about), path)
    with State(tmp_path) as state:
        conduct(SMALL, tmp_path, state=state)
        state.add("sitting", block=1, runs={planned.id: uuid})
    with State(tmp_path) as state:
        one = conduct(SMALL, tmp_path, state=state)
        assert [event["verdict"] for event in state.of("recorded")] == ["interrupted"]
        one.run()
        assert [event["verdict"] for event in state.of("recorded")] == ["interrupted", "kept", "kept"]
        board = board_of(state.events)
    assert board.done == board.planned == 2
    assert board.following is None
    assert path.exists()


def test_a_file_of_ones_own_is_not_replaced(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("campaign.toml").write_text(ONE)
    Path("out").mkdir()
    Path("out/metrics.csv").write_text("mine")
    assert run(["characterise", "campaign.toml", "--out", "out", "--yes"]) == 2
    assert "metrics.csv" in capsys.readouterr().err
    assert Path("out/metrics.csv").read_text() == "mine"


def test_another_strip_behind_the_same_name_is_another_campaign(tmp_path):
    strip = tmp_path / "mine.toml"
    write_actuator(load_actuator("friend-1-measured"), strip)
    text = ONE.replace('actuator = "friend-1-measured"', 'actuator = "mine.toml"')
    assert text != ONE
    before = campaign_from_text(text, folder=tmp_path).checksum
    assert campaign_from_text(text + "# a comment\n", folder=tmp_path).checksum == before
    write_actuator(load_actuator("friend-3-measured"), strip, overwrite=True)
    assert campaign_from_text(text, folder=tmp_path).checksum != before


def test_a_log_that_cannot_be_written_is_no_fault_of_the_program(tmp_path, monkeypatch):
    with State(tmp_path) as state:
        monkeypatch.setattr("ipmclab.campaign.state.os.write", lambda _, line: len(line) // 2)
        with pytest.raises(IpmclabError, match="cannot be written"):
            state.add("campaign", title="x")
        assert state.of("campaign") == []
