"""One step of the procedure: what was done, what came of it, and what to do next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from ipmclab.measurement.push import CALIBRATION
from ipmclab.measurement.uncertain import Uncertain
from ipmclab.run import Finding
from ipmclab.units import Quantity

_WORTH_SAYING: Final = 0.02  # of a variance: a smaller cause is not worth curing (convention)

CURES: Final[Mapping[str, str]] = {
    "offset of the meter": "join the four contacts with a piece of metal and read the meter: give that as zero",
    "spacing": "measure the distance between the contacts under a microscope",
    "current through the other face": "put the outer contacts near the inner ones, in the middle of the strip",
    "thickness": "measure the wet strip with a micrometer at five places (in the stiffness it counts cubed)",
    "width": "measure the width at five places under a microscope",
    "free length": "measure the free length with a caliper, from the edge of the clamp",
    "clamped length": "measure the clamped length with a caliper",
    "sensing length": "measure from the edge of the clamp to the point that is read with a caliper: it counts cubed",
    "position": "measure from the edge of the clamp to where the load cell pushes with a caliper: it counts cubed",
    CALIBRATION: "hang known weights on the load cell, move the laser by known steps, state calibration",
    "mass": "weigh the strip five times on a balance that shows 0.1 mg",
    "contact resistance": "measure the resistance of the clamp with a strip of metal in it",
}
"""What would help most against the largest contribution."""


@dataclass(frozen=True)
class Result:
    """A number that a step found.

    Parameters
    ----------
    amount : Uncertain
    quantity : Quantity
    symbol : str
    """

    amount: Uncertain
    quantity: Quantity
    symbol: str = ""

    @property
    def said(self) -> str:
        """The number with its uncertainty in the unit that people read."""
        unit = self.quantity.display_unit
        return self.amount.said(unit, self.quantity.units[unit] if self.quantity.unit else 1.0)

    @property
    def because(self) -> str:
        """Where the uncertainty comes from, in parts of the variance."""
        shares = self.amount.shares
        lines = [f"{name} {100.0 * share:.0f} %" for name, share in shares.items() if share >= _WORTH_SAYING]
        return ", ".join(lines)


@dataclass(frozen=True)
class Step:
    """A step that was done, or could not be.

    Parameters
    ----------
    name : str
        Of its table in the file, such as ``sheet_resistance``.
    title : str
    how : str
        From what, and by which equation.
    results : mapping of dotted name to Result
        Parameters of the actuator; empty where the step was not done or failed.
    also : mapping of name to Result
        What else it shows, such as the resistance of a whole electrode.
    findings : tuple of Finding
    advice : str
        What to do to do better.
    done : bool
    """

    name: str
    title: str
    how: str
    results: Mapping[str, Result] = field(default_factory=dict)
    also: Mapping[str, Result] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    advice: str = ""
    done: bool = True

    @property
    def amounts(self) -> dict[str, Uncertain]:
        """The parameters that it found."""
        return {name: result.amount for name, result in self.results.items()}

    def to_table(self) -> dict[str, Any]:
        """The step in the types that TOML and JSON have."""
        return {
            "name": self.name,
            "title": self.title,
            "how": self.how,
            "done": self.done,
            "advice": self.advice,
            "results": [_row(name, result) for name, result in self.results.items()],
            "also": [_row(name, result) for name, result in self.also.items()],
            "findings": [finding_row(one) for one in self.findings],
        }


def finding_row(one: Finding) -> dict[str, str]:
    """A finding in the types that TOML has."""
    return {"code": one.code, "severity": one.severity, "message": one.message, "repair": one.repair}


def _row(name: str, result: Result) -> dict[str, Any]:
    amount = result.amount
    return {
        "name": name,
        "value": amount.value,
        "standard_uncertainty": amount.uncertainty,
        "interval": list(amount.interval),
        "unit": result.quantity.unit,
        "symbol": result.symbol,
        "shares": amount.shares,
        "said": result.said,
        "because": result.because,
    }


def advice_for(amount: Uncertain) -> str:
    """What would make a number better known: a measure against its largest contribution."""
    for source, share in amount.shares.items():
        cure = CURES.get(source)
        if cure is not None and share >= 0.25:
            return f"{100.0 * share:.0f} % of the variance is the {source}: {cure}"
    return ""


def assumed_finding(amounts: Sequence[Uncertain]) -> tuple[Finding, ...]:
    """Says of which measured numbers the uncertainty was not stated."""
    names = sorted(set().union(*(one.assumed for one in amounts)))
    if not names:
        return ()
    return (
        Finding(
            "assumed-uncertainty",
            "info",
            f"nobody stated how well {', '.join(names)} {'is' if len(names) == 1 else 'are'} known: what such "
            "measurements usually have was taken",
            _repair(names),
        ),
    )


def _repair(names: Sequence[str]) -> str:
    """How to state uncertainties: that of a number in its table, that of the scales of a push in their own key."""
    numbers = 'write { value = "...", standard_uncertainty = "..." }'
    scales = "write calibration = 0.01 for 1 % of both scales of the push together"
    if CALIBRATION not in names:
        return numbers
    return scales if len(names) == 1 else f"{numbers}; {scales}"
