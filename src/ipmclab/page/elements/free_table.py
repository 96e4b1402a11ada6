"""Which parameters a fit may move."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from nicegui.element import Element

from ipmclab.model.declared import group_of, in_group
from ipmclab.model.kinds import groups

if TYPE_CHECKING:
    from nicegui.events import GenericEventArguments

    from ipmclab.model import Actuator

_SENSORS: Final = tuple(
    f"observation.{what}.{output}" for what in ("offset", "drift") for output in ("current", "displacement", "force")
)

Roles = dict[str, list[str]]


class FreeTable(Element, component="free_table.js"):
    """Groups and parameters to choose from.

    Parameters
    ----------
    on_chosen : callable
        Called when the choice changed.
    """

    def __init__(self, on_chosen: Callable[[], None]) -> None:
        super().__init__()
        self._props["options"] = {"groups": ["electrical"], "parameters": []}
        self._props["chosen"] = {"free": ["electrical"], "per_run": [], "per_mounting": [], "prior": []}
        self._props["heard"] = 0
        self._props["message"] = ""

        def told(event: GenericEventArguments) -> None:
            chosen, self._props["heard"] = event.args
            self.chosen.update({role: [str(name) for name in chosen[role]] for role in self.chosen})
            self.complain("")
            on_chosen()

        self.on("chosen", told)

    @property
    def chosen(self) -> Roles:
        """Names that are ``free``, free ``per_run`` or ``per_mounting``, and known beforehand (``prior``)."""
        found: Roles = self._props["chosen"]
        return found

    def choose(self, chosen: Roles) -> None:
        """Another choice, until ``offer`` says what there is."""
        self._props["chosen"] = {role: list(chosen[role]) for role in self.chosen}
        self.update()

    def offer(self, actuator: Actuator) -> None:
        """The parameters of an actuator; what it lacks is chosen no longer."""
        known = {name: one for name, one in actuator.parameters().items() if one.transform != "count"}
        free = [name for name in groups() if in_group(name, known)]
        rows: list[dict[str, Any]] = [
            {
                "name": name,
                "value": f"{one.quantity.to_display(one.value):.5g} {one.quantity.display_unit}".strip(),
                "group": group_of(name),
            }
            for name, one in known.items()
        ]
        rows += [{"name": name, "value": "", "group": ""} for name in _SENSORS]
        self._props["options"] = {"groups": free, "parameters": rows}
        names = {*free, *known, *_SENSORS}
        self._props["chosen"] = {role: [one for one in those if one in names] for role, those in self.chosen.items()}
        self.update()

    def complain(self, message: str) -> None:
        """Say what is wrong with the choice."""
        if message != self._props["message"]:
            self._props["message"] = message
            self.update()
