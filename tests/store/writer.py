"""A process that records, for tests that kill it: ``python writer.py LABORATORY UUID ROWS``.

Every row tells its number. Each line on stdout is a count of rows that the journal has acknowledged; ``ended`` and
``finished`` follow when the recording comes so far.
"""

from __future__ import annotations

import os
import sys
import time

import numpy as np

from ipmclab.run import RunMetadata
from ipmclab.store.journal import journal as journal_module
from ipmclab.store.journal.finalise import finalise
from ipmclab.store.journal.journal import Journal, JournalHeader

COLUMNS = ("voltage", "current", "current_raw")
BLOCK = 40


def table(first: int, count: int) -> np.ndarray:
    return np.multiply.outer(np.arange(first, first + count), [1.0, 0.5, 0.25])


def tell(text: object) -> None:
    os.write(1, f"{text}\n".encode())


def main(root: str, uuid: str, rows: str) -> None:
    journal_module.COMMIT_TIME = 0.01
    header = JournalHeader(uuid, 1000.0, COLUMNS, metadata=RunMetadata(signal="step 1 V"))
    journal = Journal.create(root, header, ballast=1 << 16, on_commit=tell)
    tell(0)
    for first in range(0, int(rows), BLOCK):
        journal.append(first, table(first, BLOCK))
        journal.event("environment", first / 1000.0, temperature=22.0)
        time.sleep(0.002)
    path = journal.end("complete")
    tell("ended")
    finalise(path, root)
    tell("finished")


if __name__ == "__main__":
    main(*sys.argv[1:])
