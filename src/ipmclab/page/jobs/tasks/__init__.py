"""What workers can do, each in a file of its own; only a worker imports them."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, Protocol

from ipmclab.page.jobs.frames import Frame


class Progress(Protocol):
    """Called with a sentence and, where it is known, the part that is done (0 to 1).

    A task that has a ``first`` answer hands its rows on as soon as it is there. From then on its user may keep what
    stands: a call raises ``KeyboardInterrupt``, as Ctrl-C does on a terminal.
    """

    def __call__(
        self, sentence: str, fraction: float | None = None, *, first: Sequence[dict[str, Any]] | None = None
    ) -> None: ...


Task = Callable[[dict[str, Any], Progress], Frame]


_SHORT: Final = 120.0


class Entry(NamedTuple):
    """Where a task is, the lane it waits in, and how long [s] it may take: None for as long as its user waits."""

    module: str
    lane: str
    limit: float | None = _SHORT


SIMULATE: Final = "simulate"
"""A change of a slider: answered at once by a worker that is warm."""
LOOK: Final = "look"
"""What takes a moment: findings, figures, files."""
WORK: Final = "work"
"""What takes long: fits, validations, reports."""

TASKS: Final[dict[str, Entry]] = {
    "simulate": Entry("simulate", SIMULATE),
    "bands": Entry("bands", LOOK),  # separately from the sliders, which wait for nothing
    "look": Entry("look", LOOK),
    "about": Entry("about", LOOK),
    "baseline": Entry("baseline", LOOK),
    "smooth": Entry("smooth", LOOK),
    "figure": Entry("figure", LOOK),
    "export": Entry("export", LOOK),
    "preview": Entry("preview", LOOK),
    "import": Entry("importing", LOOK),
    "inspect": Entry("inspect", LOOK, None),  # as long as there are runs that nobody has looked into
    "identify": Entry("identify", WORK, None),
    "validate": Entry("validate", WORK, None),
    "report": Entry("report", WORK, None),
    "propose": Entry("propose", WORK, None),
}


def find_task(name: str) -> Task:
    """The function of a task, which every module of this folder calls ``run``."""
    module = importlib.import_module(f"{__name__}.{TASKS[name].module}")
    task: Task = module.run
    return task
