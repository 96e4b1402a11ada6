"""How the answer of a strip to a step relaxes."""

from __future__ import annotations

import numpy as np

from ipmclab.model.actuator import Actuator
from ipmclab.model.outputs import simulate_outputs


def step_relaxation(model: Actuator, output: str, voltage: float, first: float, last: float) -> float:
    """Root mean square, over logarithms of time, of how an output relaxes after a step, by diffusion's measure [SI/V].

    The change with the logarithm of time, times the root of the time over the last one: that of diffusion is the same
    at all times.

    Parameters
    ----------
    model : Actuator
    output : str
    voltage : float [V]
        Of the step.
    first, last : float [s]
        After the step.

    Returns
    -------
    found : float
        0 where it is not finite.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> round(1e3 * step_relaxation(load_actuator("friend-2"), "current", 1.0, 0.04, 15.0), 2)
    2.41
    """
    # At these instants alone: every row of the fastest run, for as long as the longest one is, may be millions.
    places = np.geomspace(first, last, 8 * max(round(np.log2(last / first)), 1))
    time = np.append(0.0, places)
    answer = simulate_outputs(model, time, np.full(len(time), voltage), "zero", outputs=[output])[0, 1:] / voltage
    rates = np.diff(answer) / np.diff(np.log(places))
    found = float(np.sqrt(np.mean(rates**2 * np.sqrt(places[1:] * places[:-1]) / last)))
    return found if np.isfinite(found) else 0.0
