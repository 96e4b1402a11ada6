"""Some of a list, chosen by boxes: a keyboard and a screen reader need nothing more."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from nicegui.element import Element

if TYPE_CHECKING:
    from nicegui.events import GenericEventArguments


class Checks(Element, component="checks.js"):
    """Boxes of which some are checked.

    Parameters
    ----------
    label : str
    choices : mapping of name to text
    on_chosen : callable, optional
        Called when the choice changed.
    """

    def __init__(self, label: str, choices: Mapping[str, str], on_chosen: Callable[[], Any] | None = None) -> None:
        super().__init__()
        self._label = label
        self._props["chosen"] = []
        self._props["heard"] = 0
        self._props["message"] = ""
        self.offer(choices)

        def told(event: GenericEventArguments) -> None:
            chosen, self._props["heard"] = event.args
            self._props["chosen"] = [str(name) for name in chosen]
            if on_chosen is not None:
                on_chosen()

        self.on("chosen", told)

    @property
    def chosen(self) -> list[str]:
        """The names that are chosen, in the order in which they were."""
        found: list[str] = self._props["chosen"]
        return found

    def offer(
        self, choices: Mapping[str, str], chosen: list[str] | None = None, notes: Mapping[str, str] | None = None
    ) -> None:
        """Other choices, each with a note of what else is known of it; what is not among them is chosen no longer."""
        self._props["options"] = {"label": self._label, "choices": dict(choices), "notes": dict(notes or {})}
        kept = self.chosen if chosen is None else chosen
        self._props["chosen"] = [name for name in kept if name in choices]
        self.update()

    def complain(self, message: str) -> None:
        """Say what is wrong with the choice."""
        self._props["message"] = message
        self.update()
