"""What a plot is answered about its curves."""

from __future__ import annotations

import json

import numpy as np

from ipmclab.page.curves import Panel, Series, answer
from ipmclab.units import CHANNELS


def head(message: bytes) -> dict[str, object]:
    told: dict[str, object] = json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
    return told


def test_an_answer_about_a_stretch_says_from_when_to_when_there_are_curves() -> None:
    early, late = np.arange(1.0, 9.0), np.arange(3.0, 21.0)
    series = [Series("a", "a", early, early), Series("b", "b", late, late), Series("c", "c", early[:0], early[:0])]
    panels = [Panel.of("current", CHANNELS["current"], series)]
    for begin, end in ((None, None), (4.0, 5.0)):
        assert head(answer(panels, begin, end, 400))["whole"] == [1.0, 20.0]
    nothing = [Panel.of("current", CHANNELS["current"], series[2:])]
    assert head(answer(nothing, None, None, 400))["whole"] is None
