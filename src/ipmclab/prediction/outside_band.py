"""Runs that contradict the band of their prediction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ipmclab.confidence import NORMAL_95, REJECT
from ipmclab.prediction.run_validation import RunValidation
from ipmclab.prediction.said_of_run import begins_under_voltage, turned_outputs
from ipmclab.run import Finding
from ipmclab.units import CHANNELS


def outside_band(runs: Sequence[RunValidation]) -> list[Finding]:
    """``outside-band``: an output of a new run lies farther from its prediction than the band says that it may.

    Asked is the root mean square of its errors, each over the standard deviation that the band gives it. Errors of
    parameters and slow noise move all readings alike, in the extreme as one normal number: however errors follow each
    other, the root mean square goes beyond a bound no more often than that number does, which it does in 0.1 % of all
    that is asked. Not asked is what has a cause that is said: a start that is not known, and a sign that is turned.

    Parameters
    ----------
    runs : sequence of RunValidation
    """
    from scipy.special import ndtri

    asked = [
        (one, output)
        for one in runs
        if one.is_new and one.run.metadata.starts_from_rest is not False and not begins_under_voltage(one)
        for output, comparison in one.comparisons.items()
        if comparison.reach is not None and comparison.used.any() and output not in turned_outputs(one)
    ]
    found = []
    for one, output in asked:
        comparison = one.comparisons[output]
        assert comparison.reach is not None
        reach = comparison.reach[comparison.used]
        away = comparison.error[comparison.used] * NORMAL_95 / np.where(reach > 0.0, reach, np.inf)
        times = float(np.sqrt(np.mean(away**2)))
        if times <= -float(ndtri(REJECT / (2 * len(asked)))):
            continue
        inside = one.scores[output].inside_band
        share = "" if inside is None else f", {100.0 * inside:.0f} % of them inside its 95 % band"
        found.append(
            Finding(
                "outside-band",
                "warning",
                f"{one.label}: the {CHANNELS[output].name} lies farther from its prediction than the band allows "
                f"(p < 0.1 %): readings are {times:.2g} times its standard deviation away (rms){share}. The model "
                "lacks something that this run asks for, or the strip, its state or a sensor was otherwise",
                "give such a run to identify too, and see which stage it says is missing",
                channel=output,
                values={"times": times, "inside": inside},
            )
        )
    return found
