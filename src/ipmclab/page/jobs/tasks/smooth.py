"""A copy of a run without the vibration of a fan."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Write the file ``run`` without what is faster than ``below`` Hz to ``out``.

    Raises
    ------
    InputError
        What ``smooth`` refuses, or a file that is there.
    """
    from ipmclab.measurement.smooth import smooth
    from ipmclab.page.jobs.tasks.given import read_runs
    from ipmclab.store.run_file import write_run
    from ipmclab.units import CHANNELS, significant

    progress("taking out what is fast")
    (record,) = read_runs([arguments["run"]])
    smoothed, taken_out = smooth(record, arguments["below"])
    write_run(smoothed, arguments["out"])
    rows = [
        {
            "channel": name,
            "rms": f"{significant(CHANNELS[name].to_display(one.rms), 3)} {CHANNELS[name].display_unit}",
            "frequency": f"{significant(one.frequency, 3)} Hz",
            "share": f"{100.0 * one.share:.0f} %",
        }
        for name, one in taken_out.items()
    ]
    return Frame({"taken_out": rows}, {})
