"""What a fit says of the mountings of a strip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from ipmclab.tabled import Tabled

NEXT_STRIP: Final = (
    "one strip does not show how another strip of this make behaves: ipmclab compare estimates that from fits, or "
    "runs, of three strips or more"
)
"""Said where the next mounting is unknown: a fit of one strip does not know the next strip, and this command does."""


@dataclass(frozen=True)
class Mounting:
    """One clamping of the strip, fitted by itself.

    Parameters
    ----------
    name : str
    runs : tuple of str
        Labels of its runs.
    values : mapping of name to float [SI]
        Every parameter of the strip, with the ending of its name where a run or a mounting has it for itself; empty
        where the mounting could not be fitted by itself.
    errors : mapping of name to float [SI]
        The standard errors of those that all runs share; infinite where its runs alone do not determine one.
    noise : mapping of output to float [SI]
        Standard deviation of what its own fit leaves.
    loadings : mapping of name to mapping of cause to float [SI]
        The part of the errors that all mountings share: by how much each parameter moves as a fixed parameter does by
        its stated uncertainty, or a prior by its own.
    """

    name: str
    runs: tuple[str, ...]
    values: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    loadings: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Mountings(Tabled):
    """How a strip differs from mounting to mounting.

    Parameters
    ----------
    each : tuple of Mounting
    between : mapping of name to float
        Standard deviation from one mounting to the next, their own errors taken off: of the logarithm of what a fit
        moves as a logarithm, else of the value [SI]. From three mountings on.
    logarithms : tuple of str
        Which of them are logarithms.
    p_value : mapping of name to float
        Probability of estimates as far apart if all mountings were equal.
    unknown : mapping of name to str
        Why the value at the next mounting cannot be estimated.
    """

    each: tuple[Mounting, ...]
    between: Mapping[str, float] = field(default_factory=dict)
    logarithms: tuple[str, ...] = ()
    p_value: Mapping[str, float] = field(default_factory=dict)
    unknown: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Mountings:
        """From what ``to_table`` gave."""
        each = tuple(Mounting(**{**one, "runs": tuple(one["runs"])}) for one in table["each"])
        return cls(**{**table, "each": each, "logarithms": tuple(table["logarithms"])})
