"""A finding: something about a record or a fit that its user must know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Severity = Literal["info", "warning", "error"]
Effect = Literal["none", "mask", "lower_bound", "upper_bound"]


@dataclass(frozen=True)
class Finding:
    """Something about a record or a fit that its user must know.

    Parameters
    ----------
    code : str
        Stable name for programs, for example ``"laser-lost"``.
    severity : "info", "warning" or "error"
    message : str
        What was found, with its numbers and units.
    repair : str
        What to do about it.
    channel : str, optional
        The channel it is about; None for the whole record.
    samples : tuple of (start, stop)
        Half-open ranges of rows.
    effect : "none", "mask", "lower_bound" or "upper_bound"
        What identification does with the samples: uses them, leaves them out, or takes
        each reading as a lower or an upper bound of the true value (a clipped reading).
    values : mapping
        The measured numbers behind the message, in SI units (counts as integers).
    """

    code: str
    severity: Severity
    message: str
    repair: str = ""
    channel: str | None = None
    samples: tuple[tuple[int, int], ...] = ()
    effect: Effect = "none"
    values: Mapping[str, float | int | str | None] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of rows that the finding names."""
        return sum(stop - start for start, stop in self.samples)
