"""Records that were sent: bounded in number, and gone when they are done with."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from ipmclab.errors import InputError
from ipmclab.page.jobs.tasks.room import refuse_large_here
from ipmclab.page.uploads import MOST_UPLOADS, Uploads


def sent(uploads: Uploads, name: str) -> Path:
    with uploads.receive(name) as path:
        path.write_text(name)
    return path


def test_the_oldest_record_makes_room_for_the_newest(tmp_path: Path) -> None:
    uploads = Uploads(tmp_path)
    paths = [sent(uploads, f"{k}.csv") for k in range(3 * MOST_UPLOADS)]
    assert sorted(tmp_path.iterdir()) == sorted(paths[-MOST_UPLOADS:])
    with pytest.raises(InputError, match="not kept any more") as told:
        refuse_large_here(paths[0])
    assert told.value.repair == "choose it once more"


def test_what_is_done_with_is_gone_and_what_was_not_sent_stays(tmp_path: Path) -> None:
    uploads = Uploads(tmp_path)
    path, own = sent(uploads, "a.csv"), tmp_path / "own.csv"
    own.write_text("mine")
    for one in (path, path, own, None):
        uploads.forget(one)
    assert list(tmp_path.iterdir()) == [own]


def test_half_a_record_is_not_kept(tmp_path: Path) -> None:
    uploads = Uploads(tmp_path)

    def leave(path: Path) -> None:
        path.write_text("half")
        raise ConnectionError

    with pytest.raises(ConnectionError), uploads.receive("a.csv") as path:
        leave(path)
    assert not list(tmp_path.iterdir())


def test_no_more_come_at_once_than_are_kept(tmp_path: Path) -> None:
    uploads = Uploads(tmp_path)
    with ExitStack() as coming:
        for k in range(MOST_UPLOADS):
            coming.enter_context(uploads.receive(f"{k}.csv")).write_text("half")
        with pytest.raises(InputError, match="being sent already"), uploads.receive("more.csv"):
            pass
    assert len(list(tmp_path.iterdir())) == MOST_UPLOADS
    sent(uploads, "next.csv")
    assert len(list(tmp_path.iterdir())) == MOST_UPLOADS
