"""Each run predicted by the others: what a fit says of a run that it never saw, and which run does not fit in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class LeftOut:
    """One run, predicted by a fit of the others.

    Parameters
    ----------
    label : str
    fit_percent : mapping of output to float [percent]
        Of the prediction; an output without a score is absent.
    rmse : mapping of output to float [SI]
    inside : mapping of output to float
        Share of the readings inside the 95 % band of the prediction.
    undetermined : tuple of str
        Parameters that the others alone do not determine.
    shifts : mapping of name to float
        By how much each shared parameter moves when the run is left out, in standard errors of that change.
    unlikely : float
        Probability of a change as large as that if the run is of the same strip and mounting as the others.
    """

    label: str
    fit_percent: Mapping[str, float] = field(default_factory=dict)
    rmse: Mapping[str, float] = field(default_factory=dict)
    inside: Mapping[str, float] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()
    shifts: Mapping[str, float] = field(default_factory=dict)
    unlikely: float = 1.0

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> LeftOut:
        """From what ``to_table`` gave."""
        return cls(**{**table, "undetermined": tuple(table["undetermined"])})

    def to_table(self) -> dict[str, Any]:
        """In the types that TOML has."""
        return {
            "label": self.label,
            "fit_percent": dict(self.fit_percent),
            "rmse": dict(self.rmse),
            "inside": dict(self.inside),
            "undetermined": list(self.undetermined),
            "shifts": dict(self.shifts),
            "unlikely": self.unlikely,
        }
