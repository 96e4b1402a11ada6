"""From the settings of a chamber to the driver that speaks with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from ipmclab.errors import InputError, suggest
from ipmclab.rig.chambers.chamber import Chamber
from ipmclab.rig.chambers.settings import VIRTUAL, ChamberSettings


def open_chamber(settings: ChamberSettings) -> Chamber:
    """The chamber, ready to be asked.

    Raises
    ------
    InputError
        An unknown driver, or settings that it does not take.
    ChamberError
        It cannot be reached.

    Examples
    --------
    >>> open_chamber(ChamberSettings("virtual")).read().mode
    'off'
    """
    maker = DRIVERS.get(settings.driver)
    if maker is None:
        raise InputError(
            f"there is no driver {settings.driver!r}",
            code="no-driver",
            where="chamber.driver",
            repair=suggest(settings.driver, DRIVERS),
        )
    return maker(settings)


def _virtual(_: ChamberSettings) -> Chamber:
    from ipmclab.rig.chambers.virtual import VirtualChamber

    return VirtualChamber()


DRIVERS: Final[Mapping[str, Callable[[ChamberSettings], Chamber]]] = {VIRTUAL: _virtual}
"""What makes a chamber of its settings, by the name of the driver."""
