"""What the form of a section says stays in its window, over a reload, Back, and a server that ends."""

from __future__ import annotations

import json
from typing import Any, Final

from nicegui import ui
from nicegui.element import Element

from ipmclab.page.context import Context

ANSWER: Final = 30.0
"""How long [s] a browser may take to say what it has kept: a busy one is slow while it starts."""


class Kept:
    """What a browser keeps of the form that is being built, by itself: also what is said while the link is lost."""

    def __init__(self, context: Context) -> None:
        ui.add_head_html(f'<script defer src="/static/draft.js" data-lab="{context.lab.mark}" data-own></script>')

    def keep(self, name: str, field: Element, event: str = "update:model-value") -> None:
        """Keep what a field says, from now on at each of its events."""
        field.on(event, js_handler=f"(value) => LabDraft.keep({json.dumps(name)}, value)")

    def forget(self, name: str) -> None:
        """What a field said is used up."""
        ui.run_javascript(f"LabDraft.forget({json.dumps(name)})")

    async def values(self) -> dict[str, Any]:
        """What was kept of each field; anything may stand there. Nothing where the browser does not answer."""
        try:
            kept = await ui.run_javascript("LabDraft.kept()", timeout=ANSWER)
        except TimeoutError:
            return {}
        values = kept.get("values") if isinstance(kept, dict) else None
        return values if isinstance(values, dict) else {}


def texts(kept: Any, names: tuple[str, ...]) -> dict[str, list[str]] | None:
    """Lists of texts as they were kept, each under one of the names; None where they are none.

    Examples
    --------
    >>> texts({"fit": ["a.nc"], "other": 1}, ("fit", "held"))
    {'fit': ['a.nc'], 'held': []}
    >>> texts({"fit": [1]}, ("fit",)) is texts("fit", ("fit",)) is None
    True
    """
    if not isinstance(kept, dict):
        return None
    found = {name: kept.get(name, []) for name in names}
    if not all(isinstance(those, list) and all(isinstance(one, str) for one in those) for those in found.values()):
        return None
    return found
