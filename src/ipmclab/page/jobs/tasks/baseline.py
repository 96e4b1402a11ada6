"""How fast a strip curls with no voltage, and whether it can be tested in that air."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Judge the file ``run`` for tests of ``test`` s that show ``displacement`` m; the curl may make ``share`` of it.

    Raises
    ------
    InputError
        What ``curl`` refuses.
    """
    from ipmclab.measurement.curl import curl
    from ipmclab.page.jobs.tasks.given import read_runs
    from ipmclab.reporting.curl import curl_in_words

    progress("laying lines through the curl")
    (record,) = read_runs([arguments["run"]])
    found = curl(record, arguments["displacement"], test=arguments["test"], share=arguments["share"])
    return Frame({"verdict": found.verdict, "words": curl_in_words(found)}, {})
