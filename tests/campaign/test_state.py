"""What a campaign has done, on the disk."""

import pytest

from ipmclab.campaign import state as state_module
from ipmclab.campaign.state import FILE, State, read_events
from ipmclab.errors import InputError


def test_a_file_that_is_cut_anywhere_tells_the_truth(tmp_path):
    with State(tmp_path) as state:
        state.add("sitting", block=1, runs={"a": "u1", "b": "u2"})
        state.add("recorded", run="a", uuid="u1", verdict="kept")
        state.add("recorded", run="b", uuid="u2", verdict="repeat")
    whole = (tmp_path / FILE).read_bytes()
    lines = whole.splitlines(keepends=True)
    for cut in range(len(whole) + 1):
        (tmp_path / FILE).write_bytes(whole[:cut])
        complete = sum(len(b"".join(lines[: number + 1])) - 1 <= cut for number in range(len(lines)))
        assert len(read_events(tmp_path)) == complete
    (tmp_path / FILE).write_bytes(whole[:-5])
    with State(tmp_path) as state:
        assert state.done == {"a"}
        assert state.open == {"u2": "b"}
        state.add("recorded", run="b", uuid="u2", verdict="kept")
    with State(tmp_path) as state:
        assert state.done == {"a", "b"}
        assert not state.open


def test_one_at_a_time(tmp_path):
    with State(tmp_path), pytest.raises(InputError, match="at the moment"):
        State(tmp_path)


def test_failures_count_towards_the_attempts_and_breaks_do_not(tmp_path):
    with State(tmp_path) as state:
        for verdict in ("interrupted", "repeat", "interrupted", "interrupted", "flagged"):
            state.add("recorded", run="a", uuid=verdict, verdict=verdict)
        assert state.failures == {"a": 2}
        assert state.done == {"a"}


def test_the_name_of_a_new_log_is_on_the_disk_too(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(state_module, "sync_folder", synced.append)
    with State(tmp_path):
        assert synced == [tmp_path]


def test_an_event_is_on_the_disk_when_it_is_told(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(state_module, "sync_file", lambda _: synced.append(len(read_events(tmp_path))))
    with State(tmp_path) as state:
        for place in range(3):
            state.add("absent", uuids=[str(place)])
            assert synced == list(range(1, place + 2))


def test_the_last_word_on_how_it_was_begun_counts(tmp_path):
    with State(tmp_path) as state:
        assert state.begun is None
        for title in ("a", "b"):
            state.add("campaign", title=title)
            state.add("absent", uuids=[])
        assert state.begun["title"] == "b"
