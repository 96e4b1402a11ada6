"""``capture`` with everything that is asked of it by name, as tests ask it."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from ipmclab.rig.bench import Bench
from ipmclab.rig.recording.recorder import capture
from ipmclab.rig.recording.recording import Outcome
from ipmclab.rig.recording.run_request import Listeners, RunRequest
from ipmclab.rig.rows import RowSource
from ipmclab.signals import Signal


def captured(bench: Bench, source: Signal | str | RowSource, **asked: Any) -> Outcome:
    """What ``capture`` gives; ``asked`` has what is known of the run, who is told, and who attends."""
    run = {field.name: asked.pop(field.name) for field in fields(RunRequest) if field.name in asked}
    told = {field.name: asked.pop(field.name) for field in fields(Listeners) if field.name in asked}
    return capture(bench, RunRequest(source=source, **run), listeners=Listeners(**told), **asked)
