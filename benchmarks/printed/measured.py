"""The library's strips of chapter 5 against what the thesis prints of them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from ipmclab.data import measured_contacts, measured_names
from ipmclab.errors import InputError, suggest
from ipmclab.model import Actuator, load_actuator
from ipmclab.prediction.headline import Comparison, HeadlineRun, compare, headline_runs


@dataclass(frozen=True)
class MeasuredStrip:
    """A strip of the library and the published runs that it was identified from.

    Parameters
    ----------
    actuator : Actuator
    runs : tuple of HeadlineRun
    contacts : mapping of figure to float [ohm]
        The contact resistance of each run.
    """

    actuator: Actuator
    runs: tuple[HeadlineRun, ...]
    contacts: Mapping[str, float]

    def compare(self) -> tuple[Comparison, ...]:
        """Every printed number beside the model's."""
        return tuple(row for run in self.runs for row in compare(self.actuator, run, self.contacts[run.figure]))

    def table(self) -> str:
        """The comparison as text, one line a number, the contact resistance of each run before its numbers."""
        return table(self.compare(), self.contacts)


def measured_strip(name: str) -> MeasuredStrip:
    """A strip of the library that was identified from the thesis's printed numbers.

    Parameters
    ----------
    name : str
        One of ``ipmclab.data.measured_names()``, such as ``"friend-5-measured"``.

    Raises
    ------
    InputError
        No such strip.

    Examples
    --------
    >>> all(row.agrees for row in measured_strip("friend-6-measured").compare())
    True
    """
    if name not in measured_names():
        raise InputError(
            f"no strip of the thesis is called {name!r}",
            code="no-actuator",
            where="name",
            repair=suggest(name, measured_names()),
        )
    match = re.fullmatch(r"friend-(\d)-measured(?:-(force|displacement))?", name)
    assert match is not None  # the names of the table have this form
    return MeasuredStrip(load_actuator(name), headline_runs(int(match[1]), match[2]), measured_contacts(name))


def table(comparisons: tuple[Comparison, ...], contacts: Mapping[str, float]) -> str:
    """Printed numbers beside a model's as text, one line each."""
    lines, figure = [], ""
    for row in comparisons:
        if row.run.figure != figure:
            figure = row.run.figure
            ohms = contacts.get(figure, 0.0)
            lines.append(f"{figure} {row.run.signal}, {row.run.measured}, contact {ohms:.2f} ohm")
        quantity = row.quantity
        bound = ">" if row.lower_bound else " "
        percent = round(100.0 * row.difference, 1) + 0.0  # no minus before a zero
        lines.append(
            f"    {row.metric.replace('_', ' '):24}{bound}{quantity.to_display(row.published):7.4g}"
            f"{quantity.to_display(row.model):9.3g} {quantity.display_unit}  {percent:+6.1f} %"
            f"{'' if row.agrees else '  outside'}"
        )
    return "\n".join(lines)
