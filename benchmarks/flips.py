"""One flipped byte anywhere in a journal: is every row outside its frame there? ``python -m benchmarks.flips``.

``[--flips 500] [--record]``. A recording that was cut off, of some hundred frames of rows, events and copies of the
header. Every second flip is in one of the headers, which are few bytes and needed by all rows. Each flipped journal is
read as ``recover`` reads it; every tenth is made into a run file, which then has these rows. Which rows a frame
holds is taken from the layout that the documentation gives. Seed 20261121.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Final
from uuid import uuid4

import numpy as np

from benchmarks.harness import finish
from ipmclab import read_run
from ipmclab.run import RunMetadata
from ipmclab.store.journal import journal as journal_module
from ipmclab.store.journal.finalise import finish_here
from ipmclab.store.journal.journal import Journal, JournalHeader, read_journal
from ipmclab.store.journal.laboratory import Laboratory

SOURCES = ("src/ipmclab/store",)
SEED: Final = 20261121
FRAMES: Final = 150
ROWS: Final = 20  # of a frame
_HEAD: Final = 40  # bytes before the payload of a frame; kind at 4, length of the payload at 12
_DATA, _HEADER = 0, 1


def recording(root: Path) -> bytes:
    """The journal of a recording that was cut off; each row tells its number."""
    journal_module.COMMIT_TIME = 0.001  # type: ignore[misc]  # a frame for each append
    header = JournalHeader(str(uuid4()), 50.0, ("voltage", "current"), metadata=RunMetadata(signal="step 1 V"))
    made = Journal.create(root, header, ballast=0)
    for first in range(0, FRAMES * ROWS, ROWS):
        made.append(first, np.multiply.outer(np.arange(first, first + ROWS), [1.0, 0.5]))
        made.event("environment", first / 50.0, temperature=22.0)
        while made.acknowledged < first + ROWS:
            time.sleep(0.0005)
    made.close()
    return made.path.read_bytes()


def frames(content: bytes) -> list[tuple[int, int, int]]:
    """Kind, begin and end of each frame."""
    found, start = [], 0
    while start < len(content):
        kind = int.from_bytes(content[start + 4 : start + 6], "little")
        stop = start + _HEAD + int.from_bytes(content[start + 12 : start + 16], "little")
        found.append((kind, start, stop))
        start = stop
    return found


def rows_without(content: bytes, place: int) -> list[float]:
    """The voltages of every frame of rows but the one that has this byte."""
    kept: list[float] = []
    for kind, start, stop in frames(content):
        if kind == _DATA and not start <= place < stop:
            kept += np.frombuffer(content[start + _HEAD : stop], "<f8")[::2].tolist()
    return kept


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flips", type=int, default=500)
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/flips.md")
    options = parser.parse_args()
    random = np.random.default_rng(SEED)
    wrong: list[str] = []
    runs = in_headers = 0
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        content = recording(root)
        (path,) = (root / "recording").glob("*.runj")
        headers = [(start, stop) for kind, start, stop in frames(content) if kind == _HEADER]
        for number in range(options.flips):
            span = headers[int(random.integers(len(headers)))] if number % 2 else (0, len(content))
            place = int(random.integers(*span))
            in_headers += any(start <= place < stop for start, stop in headers)
            flipped = bytearray(content)
            flipped[place] ^= 1 << int(random.integers(8))
            path.write_bytes(flipped)
            record = read_journal(path)
            got = [value for _, values in record.rows() for value in values[:, 0].tolist()]
            expected = rows_without(content, place)
            if got != expected:
                wrong.append(f"byte {place}: {len(got)} rows of {len(expected)}")
            if not record.damage:
                wrong.append(f"byte {place}: the damage is not told")
            if number % 10 == 0:
                runs += 1
                laboratory = Laboratory.open(root)
                run = read_run(finish_here(path, laboratory).path)
                voltage = run.voltage[np.isfinite(run.voltage)].tolist()
                if voltage != expected or run.metadata.state != "recovered":
                    wrong.append(f"byte {place}: the run file has {len(voltage)} rows of {len(expected)}")
                for file in (*laboratory.runs.rglob("*.nc"), *laboratory.archive.iterdir()):
                    file.chmod(0o644)
                    file.unlink()
    body = "\n".join(
        [
            f"* {options.flips} flips of one bit in a journal of {len(content)} bytes, {len(frames(content))} frames "
            f"and {FRAMES * ROWS} rows; {in_headers} of them in one of its {len(headers)} headers; seed {SEED}",
            f"* after each, every row outside the hit frame was looked for, and the word of the damage; {runs} were "
            "made into run files",
            f"* {len(wrong)} faults" + "".join(f"\n  * {text}" for text in wrong),
        ]
    )
    finish("flips", "One flipped byte anywhere in a journal", body, [], record=options.record, gate=False)
    if wrong:
        sys.exit(1)


if __name__ == "__main__":
    main()
