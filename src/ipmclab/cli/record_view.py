"""What a recording looks like in a terminal: its plan, its steps, live numbers while it runs, and what came of it."""

from __future__ import annotations

import glob
import math
import os
import sys
import textwrap
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ipmclab.cli.output import TEXT_WIDTH, console, print_paragraph, print_table, read
from ipmclab.platform import as_typed
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from rich.live import Live
    from rich.text import Text

    from ipmclab.rig.process.messages import Message

KEYS: Final = "s stop and keep   a abort   z output to 0 V now   m mark"

_REFRESH: Final = 0.2
"""How often [s] the live numbers change: faster than this nobody reads them."""


_FEW: Final = 3
"""Files that are named each for itself where a command is proposed (convention)."""


class View:
    """Shows the messages of a recorder.

    Parameters
    ----------
    quiet : bool
        Nothing but what a terminal shows on stderr: stdout is for one JSON document.
    keys : bool
        Whether keys are read.
    """

    def __init__(self, *, quiet: bool, keys: bool) -> None:
        self._quiet = quiet
        self._keys = keys
        self._terminal = sys.stderr.isatty()
        self._out = console(stderr=True)
        self._live: Live | None = None
        self._run: Mapping[str, Any] = {}
        self._progress: Mapping[str, Any] = {}
        self._latest: dict[str, float] = {}
        self._refreshed = 0.0

    def show(self, message: Message) -> None:
        """Show one message, as far as it is for people."""
        values = message.values
        match message.kind:
            case "step":
                self.close()
                if not values["asks"]:  # else its question, or its answer, says what it is
                    self.say(f"{values['name']}: {values['text']}")
            case "note":
                if not values.get("passing") or self._terminal:
                    self.say(f"  {values['text']}")
            case "run":
                self._run, self._progress, self._latest = values, {}, {}
                self._open()
            case "block":
                for name, readings in message.arrays.items():
                    known = [value for value in readings.tolist() if math.isfinite(value)]
                    self._latest[name] = known[-1] if known else math.nan
                self._refresh()
            case "progress":
                self._progress = values
                self._refresh()
            case "event":
                self.say(f"  {values['time']:.2f} s: {values['text']}")
            case "recorded":
                self.close()
                self.say(f"  {values['state']}: {short(values['path'])}")
            case "ended":
                self.close()

    def say(self, text: str) -> None:
        """A line that stays."""
        if self._terminal:
            self._out.print(text)
        elif not self._quiet:
            print(text, flush=True)

    def write(self, text: str) -> None:
        """A part of a line, as it is typed."""
        if self._terminal:
            self._out.file.write(text)
            self._out.file.flush()

    def close(self) -> None:
        """The live numbers go away."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def _open(self) -> None:
        if not self._terminal:
            return
        from rich.live import Live

        self.close()
        self._live = Live(self._numbers(), console=self._out, auto_refresh=False, transient=True)
        self._live.start()

    def _refresh(self) -> None:
        now = time.monotonic()
        if self._live is not None and now - self._refreshed >= _REFRESH:
            self._refreshed = now
            self._live.update(self._numbers(), refresh=True)

    def _numbers(self) -> Text:
        """The line of numbers, and the keys."""
        from rich.text import Text

        rate, of = self._run.get("rate", math.nan), self._run.get("rows", 0)
        rows, safe = self._progress.get("rows", 0), self._progress.get("acknowledged", 0)
        parts = [read(value, CHANNELS[name], digits=4).rjust(10) for name, value in self._latest.items()]
        parts.append(f"{max(0.0, (of - rows) / rate):6.0f} s left")
        parts.append(f"{safe} of {of} rows on disk")
        line = f"  {self._run.get('signal', '')}  " + "  ".join(parts)
        return Text(line + (f"\n  {KEYS}" if self._keys else ""))


def print_plan(plan: Mapping[str, Any], view: View) -> None:
    """Print what is going to happen: every step with its duration, what it takes, and what to think of."""
    view.say(f"{plan['title']}: sample {plan['sample']} on {plan['rig']}, to {plan['folder']}")
    for number, step in enumerate(plan["steps"], start=1):
        lasts = duration_text(step["seconds"]) if step["seconds"] else "by hand" if step["asks"] else ""
        rows = f", {step['rows']} rows" if step["rows"] else ""
        view.say(f"  {number:2}. {step['name']:<12} {lasts:>9}  {step['text']}{rows}")
    if len(plan["conditions"]) > 1:
        view.say("  conditions, each at the earliest:")
        for one in plan["conditions"]:
            name = one["name"] + (", reference" if one["is_reference"] else "")
            view.say(f"  {one['number']:2}. after {duration_text(one['starts']):>12}  {name}")
    needed, free = (size_text(plan[key]) for key in ("bytes_needed", "bytes_free"))
    view.say(
        f"  in all at least {duration_text(plan['seconds'])}{_at_most(plan)}, {plan['rows']} rows; "
        f"needs {needed} of the {free} that are free"
    )
    watched = "; ".join(f"{name} {text}" for name, text in plan["limits"].items())
    for text in (f"the guard watches: {watched}", *(f"remark: {remark}" for remark in plan["remarks"])):
        for line in textwrap.wrap(text, TEXT_WIDTH, initial_indent="  ", subsequent_indent="    "):
            view.say(line)


def _at_most(plan: Mapping[str, Any]) -> str:
    """How long it takes at most, where it waits for something."""
    return f", at most {duration_text(plan['longest'])}" if plan["longest"] > plan["seconds"] else ""


def print_results(runs: Sequence[Mapping[str, Any]]) -> None:
    """Print what came of an experiment: each run with what is wrong with it."""
    rows = []
    for run in runs:
        codes = dict.fromkeys(one["code"] for one in run["findings"] if one["code"] != "fingerprint")  # nothing wrong
        rows.append([short(run["path"]), run["purpose"], run["state"], ", ".join(codes) or "nothing found"])
    if rows:
        print_table(["run", "purpose", "state", "findings"], rows)
    for run in runs:  # a sentence has no room in a column
        if run["state_reason"]:
            print_paragraph(f"{short(run['path'])} is {run['state']}: {run['state_reason']}")


def short(path: str) -> str:
    """A path as it is typed here: from the folder in which the command runs, where it is below that."""
    whole, here = Path(path), Path.cwd()
    return str(whole.relative_to(here)) if whole.is_relative_to(here) else path


def files_typed(paths: Sequence[str]) -> list[str]:
    """Files as words of a command: a few as such, more by one pattern a kind of signal, where these name no other file.

    Every verb takes a pattern, whatever the shell does with it.

    Examples
    --------
    >>> files_typed(["step.nc", "sine.nc"])
    ['step.nc', 'sine.nc']
    """
    names = [Path(short(path)) for path in paths]
    kinds = dict.fromkeys((one.parent, one.stem.rsplit("_", 2)[-2]) for one in names if one.stem.count("_") > 1)
    patterns = []
    for parent, kind in kinds:
        begin = os.path.commonprefix([one.name for one in names if one.parent == parent])  # noqa: RUF071  # by letters
        patterns.append(str(Path(glob.escape(str(parent)), f"{glob.escape(begin)}*_{kind}_*.nc")))
    meant = [Path(found) for pattern in patterns for found in glob.glob(pattern)]
    shorter = _FEW < len(names) > len(patterns) and sorted(meant) == sorted(names)
    return [as_typed(word) for word in (patterns if shorter else map(str, names))]


def duration_text(seconds: float) -> str:
    """A duration as people say it.

    Examples
    --------
    >>> duration_text(50.0), duration_text(1870.0), duration_text(7500.0)
    ('50 s', '31 min 10 s', '2 h 5 min')
    """
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 120:
        return f"{minutes} min" + (f" {rest} s" if rest else "")
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h" + (f" {minutes} min" if minutes else "")


def size_text(size: int) -> str:
    """A number of bytes as people say it.

    Examples
    --------
    >>> size_text(1_234_567), size_text(70_000_000_000)
    ('1.2 MB', '70 GB')
    """
    value, unit = (size / 1e9, "GB") if size >= 1e9 else (size / 1e6, "MB")
    return f"{value:.0f} {unit}" if value >= 10 else f"{value:.1f} {unit}"
