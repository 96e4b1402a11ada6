"""One run predicted by one actuator, and its scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ipmclab.prediction.scores import Comparison, Score
from ipmclab.quality import check
from ipmclab.run import Finding, Run


@dataclass(frozen=True, eq=False)
class RunValidation:
    """One run predicted by one actuator.

    Parameters
    ----------
    run : Run
    label : str
    predicted : Run
        The same rows and voltage, with the outputs of the actuator.
    comparisons : mapping of output to Comparison
        Measured (the sensor's zero taken off), predicted, and the rows that count.
    scores : mapping of output to Score
    zeros : mapping of output to float [SI]
        The reading before the voltage first moved, which was taken off.
    delay : float [s] or None
        How much later than the voltage channel says the strip was taken to see the voltage; None
        where the hold is known, or no edge shows it.
    used_in_fit : bool
        Whether the actuator was identified from this very run.
    rows_in_fit : pair of int or None
        Of a run that shares rows with one of the fit, the first of them and the one after the last.
    """

    run: Run
    label: str
    predicted: Run
    comparisons: Mapping[str, Comparison]
    scores: Mapping[str, Score]
    zeros: Mapping[str, float]
    delay: float | None
    used_in_fit: bool
    rows_in_fit: tuple[int, int] | None = None

    @cached_property
    def record_findings(self) -> tuple[Finding, ...]:
        """What the check says of the record, which is asked for several sentences."""
        return check(self.run)

    @property
    def is_new(self) -> bool:
        """Whether some of its rows were not given to the fit."""
        return not self.used_in_fit and self.rows_in_fit != (0, len(self.run))

    @property
    def rows_in_words(self) -> str:
        """Which of its rows were given to the fit."""
        first, stop = self.rows_in_fit or (0, 0)
        rows = f"{len(self.run):,}"
        if first == 0:
            return (
                f"all {rows} rows of {self.label}"
                if stop == len(self.run)
                else (f"the first {stop:,} of the {rows} rows of {self.label}")
            )
        return f"rows {first:,} to {stop - 1:,} of the {rows} rows of {self.label}"

    def as_dict(self) -> dict[str, Any]:
        """The run as ``--json`` prints it."""
        return {
            "label": self.label,
            "content_sha256": self.run.content_sha256,
            "used_in_fit": self.used_in_fit,
            "rows_in_fit": None if self.rows_in_fit is None else list(self.rows_in_fit),
            "delay": self.delay,
            "zeros": dict(self.zeros),
            "scores": {name: one.as_dict() for name, one in self.scores.items()},
        }
