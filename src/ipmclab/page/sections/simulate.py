"""Section simulate."""

from __future__ import annotations

from nicegui import ui

from ipmclab.page.context import Context


def build(context: Context) -> None:
    """Fill the page."""
    ui.label(str(context.lab.root))
