"""Which chamber a rig has, as its file says it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

VIRTUAL: Final = "virtual"
"""The driver of the chamber that exists only as a model."""


@dataclass(frozen=True)
class ChamberSettings:
    """Which chamber, and how it is reached.

    Parameters
    ----------
    driver : str
        One of ``drivers.DRIVERS``.
    address : str
        Its serial port, or ``HOST:PORT``; empty for a virtual one.
    options : mapping
        What else its driver takes.
    """

    driver: str
    address: str = ""
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def is_virtual(self) -> bool:
        """Whether it exists only as a model."""
        return self.driver == VIRTUAL
