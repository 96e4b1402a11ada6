"""From runs to a fit with all that is shown beside it: profiles, and each run left out."""

from __future__ import annotations

from collections.abc import Sequence

from ipmclab.fit.fit import Fit
from ipmclab.identification.identify import identify
from ipmclab.identification.uncertainty.profiles import profile
from ipmclab.model import Actuator
from ipmclab.prediction.left_out import leave_one_run_out
from ipmclab.progress import Tell, part, telling
from ipmclab.run import Run


def fit_of_runs(
    actuator: Actuator,
    runs: Sequence[Run],
    *,
    free: Sequence[str],
    per_run: Sequence[str] = (),
    per_mounting: Sequence[str] = (),
    prior: Sequence[str] = (),
    labels: Sequence[str] | None = None,
    progress: Tell | None = None,
) -> Fit:
    """Identify, follow the profile of every parameter, and leave out each run where there are several.

    Parameters
    ----------
    actuator : Actuator
    runs : sequence of Run
    free, per_run, per_mounting, prior, labels
        As ``identify`` takes them.
    progress : function of (str, float), optional
        Called with a sentence and the fraction that is done.

    Returns
    -------
    fit : Fit
        With ``profiles``, and with ``left_out`` where there are two runs or more.

    Raises
    ------
    InputError
        What ``identify`` refuses.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> fit = fit_of_runs(strip, [simulate(strip, "step 1 V", duration=10, rate=20)], free=["circuit.dc_resistivity"])
    >>> list(fit.profiles), fit.left_out
    (['circuit.dc_resistivity'], ())
    """
    with telling(progress):
        with part("", 0.0, 0.8):
            fit = identify(
                actuator, runs, free=free, per_run=per_run, per_mounting=per_mounting, prior=prior, labels=labels
            )
        with part("", 0.8, 0.9):
            fit = profile(fit)
        with part("", 0.9, 1.0):
            return leave_one_run_out(fit) if len(runs) > 1 else fit
