"""The command line: one file per verb. The only place that prints."""

from __future__ import annotations

import gc
import glob
import os
import sys
from collections.abc import Sequence
from typing import Final, NoReturn

from ipmclab.errors import INTERRUPTED

OBJECTS_BETWEEN: Final = 10_000
"""New objects between two looks of the garbage collector, Python's own number is 700: 0.3 of the 8 s of a demo in place
of 0.8, with 5 MB more of memory."""


def main() -> NoReturn:
    """Run the command line and leave with its exit status."""
    # Our matrices have a dozen rows: on a busy machine the threads of OpenBLAS only wait for each other, and a fit
    # that takes 3 s takes 20 s. NumPy reads this when it is first imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.disable()  # nothing of what is imported can be freed, and looking for it takes a tenth of a short command
    try:
        from ipmclab.cli.app import run

        gc.set_threshold(OBJECTS_BETWEEN, *gc.get_threshold()[1:])
        gc.enable()
        words = sys.argv[1:]
        status = run(expand_patterns(words) if sys.platform == "win32" else words)
    except KeyboardInterrupt:  # while it loads; from then on each verb says what became of its work
        sys.stderr.write("error: stopped before it began; run the command again\n")
        status = INTERRUPTED
    sys.exit(status)


def expand_patterns(words: Sequence[str]) -> list[str]:
    """Replace patterns such as ``*.nc`` by the files they match, which shells of Windows leave to the program."""
    found = ((sorted(glob.glob(word, recursive=True)) if glob.has_magic(word) else []) or [word] for word in words)
    return [name for names in found for name in names]
