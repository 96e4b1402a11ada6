"""The board of a campaign: how far each sample has come in each experiment, while it is recorded and after."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final

from nicegui import ui

from ipmclab.campaign.board import Board, board_of
from ipmclab.campaign.state import FILE, read_events
from ipmclab.errors import IpmclabError
from ipmclab.page.sections.parts import card, plain_table, text

_LOOK: Final = 2.0
"""How often [s] the page looks whether another run is done."""


def build_board(folder: Path) -> None:
    """A card with the campaign of a laboratory folder, which follows it; nothing where there is none."""
    if not (folder / FILE).is_file():
        return
    with card("Campaign", place="campaign"):
        box = ui.element("div")
    shown: list[Board | None] = [None]

    async def look() -> None:
        try:
            found = board_of(await asyncio.to_thread(read_events, folder))
        except (IpmclabError, OSError):
            return  # it is looked for again soon
        if found is None or found == shown[0]:
            return
        shown[0] = found
        box.clear()
        with box:
            _fill(found)

    ui.timer(0.01, look, once=True)
    ui.timer(_LOOK, look)


def _fill(board: Board) -> None:
    following = f"next: {board.following}" if board.following is not None else "nothing is left to record"
    text(f"{board.title}: {board.done} of {board.planned} runs; {following}").props("role=status")
    rows = [
        {
            "sample": sample,
            **{part: str(board.squares[sample, part]) for part in board.parts if (sample, part) in board.squares},
            **({"model": board.models.get(sample, "")} if board.models else {}),
        }
        for sample in board.samples
    ]
    head = {"sample": "sample", **{part: part for part in board.parts}}
    if board.models:
        head["model"] = "model: fit of runs that were not used to identify it"
    plain_table(head, rows, caption="Runs of the campaign")
