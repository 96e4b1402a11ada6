"""What a fit says of a run that the other runs predict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from ipmclab.tabled import Tabled

_NAMED: Final = 2  # parameters that a line lists (convention)


@dataclass(frozen=True)
class LeftOut(Tabled):
    """One run, predicted by a fit of the others.

    Parameters
    ----------
    label : str
    fit_percent : mapping of output to float [percent]
        Of the prediction; an output without a score is absent.
    rmse : mapping of output to float [SI]
    inside : mapping of output to float
        Share of the readings inside the 95 % band of the prediction.
    standardised : mapping of output to float
        Root of the mean square of the error over its standard deviation, once what the run has for itself has been
        found on it: about 1 for a run like the others. However errors are correlated, it is beyond 3.3 in one of a
        thousand such runs at most.
    undetermined : tuple of str
        Parameters that the others alone do not determine. What the run has for itself, where fewer than three others
        show how far it may lie off, is among them: all scores are then of a prediction for which it was found on the
        run itself.
    shifts : mapping of name to float
        By how much each shared parameter moves when the run is left out, in standard errors of that change.
    p_value : float
        Probability of a change as large as that if the run is of the same strip and mounting as the others.
    left_of_others : mapping of output to float
        What the fit of the others leaves of them, over what that of all leaves of them (rms): 1 for a run like them.
        Absent where the others leave more than twice their noise between neighbours: the model then lacks more.
    """

    label: str
    fit_percent: Mapping[str, float] = field(default_factory=dict)
    rmse: Mapping[str, float] = field(default_factory=dict)
    inside: Mapping[str, float] = field(default_factory=dict)
    standardised: Mapping[str, float] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()
    shifts: Mapping[str, float] = field(default_factory=dict)
    p_value: float = 1.0
    left_of_others: Mapping[str, float] = field(default_factory=dict)

    @property
    def lacking(self) -> str:
        """That the others do not determine some parameters, in words."""
        if not self.undetermined:
            return ""
        more = f" and {len(self.undetermined) - _NAMED} more" if len(self.undetermined) > _NAMED else ""
        return f"the others do not determine {', '.join(self.undetermined[:_NAMED])}{more}"

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> LeftOut:
        """From what ``to_table`` gave."""
        return cls(**{**table, "undetermined": tuple(table["undetermined"])})
