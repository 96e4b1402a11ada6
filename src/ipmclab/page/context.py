"""What every section of the page needs."""

from __future__ import annotations

from dataclasses import dataclass

from nicegui import ui

from ipmclab.page.guard import SEAT
from ipmclab.page.lab import Lab
from ipmclab.page.live.bench import Bench
from ipmclab.page.workshop import Workshop


@dataclass(frozen=True)
class Context:
    """What every section needs; one for the whole server.

    Parameters
    ----------
    workshop : Workshop
        The lab's folder, its workers, the curves and fits that are kept.
    bench : Bench
        What happens at the bench.
    """

    workshop: Workshop
    bench: Bench

    @property
    def lab(self) -> Lab:
        """The folder."""
        return self.workshop.lab

    @staticmethod
    def seat() -> str:
        """Whose browser the page that is being built, or whose event is handled, belongs to."""
        return str(ui.context.client.request.cookies.get(SEAT, ""))
