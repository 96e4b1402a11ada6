"""Which runs to record next, and what is expected of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Propose runs for the fit in the file ``fit``, as ``propose_runs`` does.

    ``goal``, ``minutes``, ``limits`` (texts by their names) and ``longest`` [s] say what for and within what;
    ``inputs`` and ``rival``, a stage or the file of another model, may be empty.

    Raises
    ------
    InputError
        What ``propose_runs`` refuses.
    """
    from ipmclab import load_actuator
    from ipmclab.fit.fit_file import read_fit
    from ipmclab.planning import proposal_words
    from ipmclab.planning.candidates import Allowance
    from ipmclab.planning.propose import INPUTS, propose_runs
    from ipmclab.rig.safety.limits import Limits
    from ipmclab.units import significant

    progress("asking the model")
    minutes, rival = arguments["minutes"], arguments["rival"]
    found = propose_runs(
        read_fit(arguments["fit"]),
        goal=arguments["goal"],
        minutes=minutes,
        allowed=Allowance(limits=Limits.from_table(arguments["limits"]), longest=arguments["longest"]),
        inputs=arguments["inputs"] or INPUTS,
        rival=load_actuator(rival) if rival.endswith(".toml") else rival or None,
    )
    runs = [
        {
            "run": str(place),
            "signal": str(one.candidate.signal),
            "duration": f"{one.candidate.duration:g} s",
            "bench": proposal_words.bench_time(one.time),
            "gain": significant(one.gain_per_minute, 2),
            "remark": "; ".join(one.remarks),
        }
        for place, one in enumerate(found.runs, 1)
    ]
    expected = [
        {
            "name": one.name,
            "value": proposal_words.value(one),
            "now": proposal_words.interval(one, now=True),
            "after": proposal_words.interval(one, now=False),
            "unit": one.unit,
        }
        for one in found.expected
    ]
    sentences = [
        proposal_words.of_time(found, minutes),
        *proposal_words.of_goal(found),
        proposal_words.of_limits(found),
    ]
    document = {
        "runs": runs,
        "expected": expected,
        "how": proposal_words.HOW,
        "sentences": [one for one in sentences if one],
        "remarks": list(found.remarks),
    }
    return Frame(document, {})
