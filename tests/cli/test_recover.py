"""ipmclab recover, as a user meets it."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from ipmclab.store.journal.journal import Journal, JournalHeader


def cut_off(root: Path) -> Path:
    journal = Journal.create(root, JournalHeader(str(uuid4()), 50.0, ("voltage",)), ballast=0)
    journal.append(0, np.ones((50, 1)))
    journal.close()
    return journal.path


def test_what_a_crash_left_is_told_line_by_line(command: Any, tmp_path: Path) -> None:
    left = cut_off(tmp_path / "lab")
    (tmp_path / "lab" / "recording" / "odd.runj").write_bytes(b"odd")
    live = Journal.create(tmp_path / "lab", JournalHeader(str(uuid4()), 50.0, ("voltage",)), ballast=0)
    outcome = command("recover", "lab")
    assert (outcome.status, outcome.err) == (0, "")
    recovered = [line for line in outcome.out.splitlines() if line.startswith("recovered: runs/")]
    assert len(recovered) == 1
    assert f"_{left.stem[:8]}.nc: 50 rows; the recording was cut off before its end; 0 bytes dropped" in recovered[0]
    assert f"left alone: recording/{live.path.name}: it is being recorded, or finished" in outcome.out
    assert "cannot be made into a run: lost+found/odd.runj: its first frame is no header of a journal" in outcome.out
    live.close()
    again = command("recover", "lab", "--json")
    (empty,) = again.document["journals"]
    assert (again.status, empty["outcome"]) == (0, "empty")
    nothing = command("recover", "lab")
    assert nothing.out == "nothing to recover in lab\n"


def test_json_says_what_became_of_each(command: Any, tmp_path: Path) -> None:
    left = cut_off(tmp_path / "lab")
    document = command("recover", "lab", "--json").document
    (journal,) = document["journals"]
    assert journal["journal"] == str(left)
    assert (journal["outcome"], journal["state"], journal["rows"]) == ("run", "recovered", 50)
    assert Path(journal["path"]).is_file()
    assert document["failed"] == document["removed"] == []


def test_a_journal_that_cannot_be_dealt_with_is_an_error_and_stays(command: Any, tmp_path: Path) -> None:
    left = cut_off(tmp_path / "lab")
    (tmp_path / "lab" / "runs" / "2026").write_text("in the way")
    created = left.read_bytes()
    year = created[created.index(b'created_at": "') + 14 :][:4].decode()
    (tmp_path / "lab" / "runs" / "2026").rename(tmp_path / "lab" / "runs" / year)
    outcome = command("recover", "lab")
    assert outcome.status == 1
    assert outcome.err.startswith(f"error: {left}: the run file cannot be written")
    assert "Traceback" not in outcome.err
    assert left.exists()


def test_a_folder_that_is_no_laboratory_is_refused(command: Any, tmp_path: Path) -> None:
    for name, words in ((".", "this is no laboratory folder"), ("nowhere", "this is no laboratory folder")):
        outcome = command("recover", name, "--json")
        assert outcome.status == 2
        assert words in outcome.err
        assert outcome.document["error"]["code"] == "no-laboratory"
    assert list(tmp_path.iterdir()) == []


def test_rows_that_no_run_has_are_told_and_are_a_failure(command: Any, tmp_path: Path) -> None:
    left = cut_off(tmp_path / "lab")
    content = left.read_bytes()
    left.write_bytes(content.replace(b"ipmclab journal", b"ipmclab jovrnal"))
    outcome = command("recover", "lab")
    table = tmp_path / "lab" / "lost+found" / f"{left.stem}.csv"
    assert outcome.status == 1
    assert "50 rows are whole, but nothing says what they are" in outcome.err
    assert f"its rows are in {table}: name the columns" in outcome.err
    again = command("recover", "lab")
    assert again.status == 0
    assert f"of 1 earlier recordings only the rows are left: {table}" in again.out
