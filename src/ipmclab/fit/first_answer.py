"""What is shown of a fit as soon as its parameters are found, while its intervals and its stages are looked at."""

from __future__ import annotations

from dataclasses import dataclass

from ipmclab.fit.fit import Fit
from ipmclab.fit.rows import parameter_rows, size_in_words
from ipmclab.units import CHANNELS


@dataclass(frozen=True)
class FirstRow:
    """A parameter, or what a fit leaves of an output of a run, as people read it.

    Parameters
    ----------
    name, value, unit : str
    """

    name: str
    value: str
    unit: str


def first_rows(fit: Fit) -> list[FirstRow]:
    """The parameters of a fit without their intervals, then what it leaves of each output of each run."""
    rows = [FirstRow(row.name, row.value, row.unit if row.determined else "") for row in parameter_rows(fit)]
    for one in fit.observations:
        for output, sigma in one.noise.items():
            value, _, unit = size_in_words(sigma, output).partition(" ")
            rows.append(FirstRow(f"residual of the {CHANNELS[output].name} in {one.label}", value, unit))
    return rows


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
    rows = first_rows(fit)
    width = max(len(row.name) for row in rows)
    head = "First answer; intervals, and what the model lacks, follow (Ctrl-C keeps the fit):"
    return "\n".join([head, *(f"  {row.name:<{width}}  {row.value} {row.unit}".rstrip() for row in rows)])
