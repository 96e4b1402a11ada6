"""A table of runs: sorted by its headings, with a box for each thing that a run can be chosen for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from nicegui.element import Element

from ipmclab.page.run_table import COLUMNS

if TYPE_CHECKING:
    from nicegui.events import GenericEventArguments

Chosen = dict[str, list[str]]
"""Of each role the keys of its runs, in the order in which they were chosen."""


class RunTable(Element, component="run_table.js"):
    """A table of runs.

    Parameters
    ----------
    caption : str
        For screen readers.
    roles : mapping of name to label
        What a run can be chosen for; it has one of them.
    on_chosen : callable
        Called with the choice, also a coroutine function.
    opens : bool
        Whether the name of a run chooses it alone, for the first role.
    columns : sequence of str, optional
        Some of the columns.
    """

    def __init__(
        self,
        caption: str,
        roles: Mapping[str, str],
        on_chosen: Callable[[Chosen], Any],
        *,
        opens: bool = False,
        columns: Sequence[str] | None = None,
    ) -> None:
        super().__init__()
        shown = [one for one in COLUMNS if columns is None or one["name"] in columns]
        self._props["options"] = {
            "caption": caption,
            "roles": [{"name": name, "label": label} for name, label in roles.items()],
            "columns": shown,
            "opens": opens,
        }
        self._props["rows"] = []
        self._props["chosen"] = {name: [] for name in roles}
        self._props["heard"] = 0

        async def told(event: GenericEventArguments) -> None:
            chosen, self._props["heard"] = event.args
            self._props["chosen"].update({role: [str(key) for key in chosen[role]] for role in self.chosen})
            result = on_chosen(self.chosen)
            if result is not None:
                await result

        self.on("chosen", told)

    @property
    def chosen(self) -> Chosen:
        """What is chosen."""
        found: Chosen = self._props["chosen"]
        return found

    def choose(self, role: str, keys: Sequence[str]) -> None:
        """Choose runs for a role."""
        self._props["chosen"] = {**self.chosen, role: list(keys)}
        self.update()

    def show(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Other rows."""
        self._props["rows"] = list(rows)
        self.update()
