"""The report of a campaign as a browser shows it: its tables fit on a screen, on a small one, and on paper."""

from __future__ import annotations

from typing import Any

import pytest

from ipmclab.reporting.page_file import render
from ipmclab.reporting.wording import in_parts

ROWS = [
    {"part": part, "condition": "20 degC, 80 %RH", "label": label, "repeats": 4, "cells": cells}
    for part, label, cells in (
        ("displacement", "baseline", ["–", "–", "(−5.3 ± 9.4) × 10⁻⁵ mm", "–"]),
        (
            "displacement",
            "step 1 V",
            ["71.1398 ± 0.0085 mA", "3.40399 ± 0.00096 mA", "0.54588 ± 0.00014 mm", "above 39 s"],
        ),
        ("displacement", "sine 1 V 0.1 Hz", ["7.62546 ± 0.00094 mA", "–", "0.21631 ± 0.00013 mm", "–"]),
    )
]
SAMPLE = {
    "name": "strip-1",
    "about": [],
    "head": ["current", "current later", "response", "time to peak"],
    "rows": ROWS,
    "findings": [],
    "models": [],
    "pictures": [],
}


@pytest.mark.parametrize(("media", "width"), [("screen", 1200), ("screen", 800), ("print", 688)])
def test_the_table_of_repeats_fits(chromium: Any, media: str, width: int) -> None:
    """At 1200 px its last column was cut off. 688 px are the 182 mm between the margins of A4."""
    names = ("sentences", "printed", "curled", "unprinted", "comparisons", "flagged", "methods")
    html = render(
        "campaign.html.j2",
        filters={"in_parts": in_parts},
        **{"title": "", "subtitle": "", "doubt": False, "file": "", "samples": [SAMPLE], **dict.fromkeys(names, ())},
    )
    page = chromium.new_page(viewport={"width": width, "height": 900})
    try:
        page.emulate_media(media=media)
        page.set_content(html)
        table = page.locator(".table").filter(has_text="Mean over the repeats")
        assert table.evaluate("one => one.scrollWidth - one.clientWidth") <= 0
        assert page.get_by_role("cell", name="0.54588 ± 0.00014 mm").count() == 1
    finally:
        page.close()
