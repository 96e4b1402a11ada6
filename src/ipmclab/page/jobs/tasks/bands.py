"""How sure a fitted actuator is of what it answers, as areas around its curves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.tasks import Progress
from ipmclab.page.wire import FloatArray


def run(arguments: dict[str, Any], progress: Progress) -> Frame:  # noqa: ARG001  # it takes some milliseconds
    """The 95 % band of the answer that the task ``simulate`` gives with the same arguments and no changes.

    Arrays are ``OUTPUT.low`` and ``OUTPUT.high`` in SI units, at the rows of that answer, or at times of their own.
    ``label`` is empty where there is no band; ``sentences`` say why, and what a band holds for.
    """
    from ipmclab.page.jobs.tasks.simulate import answered, stamps, thinned_where_long
    from ipmclab.prediction.answer import sure_answer

    of = {"stamps": stamps(arguments)}
    answer, measured, actuator, _ = answered({**arguments, "changes": {}})
    sure = sure_answer(actuator, answer, named=arguments["actuator"])
    if sure is None:
        return Frame({"label": "", "sentences": [], **of}, {})
    mounting = measured.metadata.mounting_id if measured is not None else None
    of_next = sure.here is None or (mounting is not None and mounting not in sure.mountings)
    bands = sure.following if of_next and sure.following is not None else sure.here
    if bands is not sure.here and sure.here is not None:  # so that what is said is said of the band that is drawn
        sure = replace(sure, here=None, why_none=f"this run is of mounting {mounting}")
    arrays: dict[str, FloatArray] = {"time": answer.time}
    for name in bands.predicted if bands is not None else ():
        reach = bands.reach(name, of_readings=False) if bands is not None else 0.0
        arrays |= {f"{name}.low": answer.channels[name] - reach, f"{name}.high": answer.channels[name] + reach}
    label = "" if bands is None else "95 % at the next mounting" if bands is sure.following else "95 % of the answer"
    if bands is not None and bands is sure.here and of_next and len(sure.mountings) == 1:
        label += f" of mounting {sure.mountings[0]}"
    return Frame({"label": label, "sentences": sure.sentences(), **of}, thinned_where_long(arrays))
