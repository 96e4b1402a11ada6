"""A sitting of a campaign at its bench: a virtual one in this process, a real one by a recorder of its own."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ipmclab.campaign.campaign import Campaign
    from ipmclab.campaign.conduct import Sat
    from ipmclab.campaign.sitting import Sitting
    from ipmclab.campaign.state import State
    from ipmclab.cli.record_view import View
    from ipmclab.store.journal.laboratory import Laboratory


def title_of(campaign: Campaign, sitting: Sitting) -> str:
    """What the runs of a sitting say they belong to."""
    return f"{campaign.title}: {sitting.block.part}"


def at_virtual_bench(campaign: Campaign, laboratory: Laboratory, sitting: Sitting, state: State) -> Sat:
    """Sit through it in lock-step: an hour passes in a second, and every other thing is as at a real bench."""
    from dataclasses import replace

    from ipmclab.campaign.conduct import Sat
    from ipmclab.campaign.sitting import experiment_for, virtual_rig
    from ipmclab.cli.recorder import answers_of, chamber_of, plan_of, session_of
    from ipmclab.rig.process.server import ClientOperator
    from ipmclab.rig.virtual import VirtualBench

    experiment = replace(experiment_for(campaign, sitting, title_of(campaign, sitting)), folder=laboratory.root)
    rig, strip = virtual_rig(campaign, sitting, state.failures)
    plan = plan_of(experiment, rig, laboratory, strip)
    operator = ClientOperator()
    operator.unattended = True
    operator.answer_beforehand(answers_of({"answers": {}, "yes": True, "interactive": False}, plan))
    bench = VirtualBench(strip, rig=rig)
    with chamber_of(plan, bench, laboratory.root / "guardian.log") if rig.chamber else nullcontext() as chamber:
        session = session_of(plan, laboratory, operator, None, bench, chamber)
        session.run()
    return Sat(session.ended_early or "done", session.reason)


def by_recorder(
    campaign: Campaign,
    laboratory: Laboratory,
    sitting: Sitting,
    view: View,
    options: Mapping[str, Any],
) -> Sat:
    """Sit through it as ``ipmclab record`` does: in a recorder's own process, whose prompts a terminal answers."""
    from ipmclab.campaign.asked import asked
    from ipmclab.cli.record import RECORDER
    from ipmclab.rig.process.client import launch

    job = {
        "experiment": str(options["file"]),
        "campaign": asked(sitting, laboratory.root, title_of(campaign, sitting), campaign.checksum),
        "answers": dict(options["answers"]),
        "yes": options["yes"],
        "plan": False,
        "interactive": options["keys"],
    }
    return follow(launch(RECORDER, job), view)


def follow(recorder: Any, view: View, *, joined: bool = False) -> Sat:
    """Be a client of a recorder until its experiment ends.

    Raises
    ------
    IpmclabError
        It failed, or its process is gone.
    """
    from ipmclab.campaign.conduct import Sat
    from ipmclab.cli.record import Terminal
    from ipmclab.rig.process.client import error_from

    terminal = Terminal(recorder, view, ask_first=False, plan_only=False, joined=joined)
    try:
        last = terminal.follow()
    finally:
        view.close()
        recorder.close()
    values = dict(last.values)
    error = values["error"]
    if error is not None and error["code"] != "aborted":
        raise error_from(error)
    return Sat(values["how"] or "abort", "" if error is None else error["message"])
