"""What is shown of a fit as soon as its parameters are found, while its intervals and its stages are looked at."""

from __future__ import annotations

from ipmclab.fit.answer import parameter_rows, size_in_words
from ipmclab.fit.fit import Fit
from ipmclab.units import CHANNELS


def first_answer(fit: Fit) -> str:
    """A fit as soon as its parameters are found, in lines: these, and what it leaves of each output.

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> run = simulate(strip, "step 1 V", duration=10, rate=20)
    >>> print(first_answer(identify(strip, run, free=["circuit.dc_resistivity"])).splitlines()[0])
    First answer; intervals, and what the model lacks, follow (Ctrl-C keeps the fit):
    """
    rows = [(row.name, f"{row.value} {row.unit if row.determined else ''}".rstrip()) for row in parameter_rows(fit)]
    rows += [
        (f"residual of {one.label}", f"{size_in_words(sigma, output)} ({CHANNELS[output].name})")
        for one in fit.observations
        for output, sigma in one.noise.items()
    ]
    width = max(len(name) for name, _ in rows)
    head = "First answer; intervals, and what the model lacks, follow (Ctrl-C keeps the fit):"
    return "\n".join([head, *(f"  {name:<{width}}  {value}" for name, value in rows)])
