"""A file that is sent by the browser, bounded, into a place that goes when the server does."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from nicegui.element import Element

if TYPE_CHECKING:
    from nicegui.events import GenericEventArguments

MOST_BYTES: Final = 128 * 1024 * 1024
"""Of a file that is sent."""


class FileChoice(Element, component="file_choice.js"):
    """A field for a file.

    Parameters
    ----------
    label : str
    accept : str
        Endings, with commas.
    on_sent : callable
        Called with ``{"key", "name"}`` once the file is there; also a coroutine function.
    """

    def __init__(self, label: str, accept: str, on_sent: Callable[[dict[str, str]], Any]) -> None:
        super().__init__()
        self._props["options"] = {"label": label, "accept": accept, "most": MOST_BYTES}

        async def sent(event: GenericEventArguments) -> None:
            result = on_sent(event.args)
            if result is not None:
                await result

        self.on("sent", sent)
