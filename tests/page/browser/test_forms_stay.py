"""What the forms of Identify and Simulate say, in a real browser: half typed, and after the page's server was ended."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.page.browser.conftest import LONG, served

pytest.importorskip("playwright")


def test_a_field_without_a_number_asks_nothing(tmp_path: Path, open_page) -> None:
    with served(tmp_path) as address:
        page = open_page(f"{address}/simulate")
        page.locator("[data-answers='1']").wait_for(timeout=LONG)
        command = page.get_by_text("ipmclab simulate friend-2 --signal")
        command.wait_for()
        before = command.inner_text()
        assert "'step 1 V' --duration '40 s' --rate '50 Hz'" in before
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url) if "/simulate" in request.url else None)
        for label in ("Amplitude", "Duration", "Rate"):
            number = page.get_by_label(label, exact=True)
            value = number.input_value()
            number.fill("")
            page.locator(".lab-field", has=number).get_by_text("Write a number.").wait_for()
            page.get_by_text("waits for a number").wait_for()
            assert not page.locator(".lab-simulator [role=alert]").filter(visible=True).count()
            page.wait_for_timeout(700)  # the command follows within half a second
            assert command.inner_text() == before
            assert asked == []
            number.fill(value)
            page.get_by_text("answered in").wait_for()
            asked.clear()
        page.get_by_label("Duration", exact=True).fill("-1")
        page.locator(".lab-field", has_text="Duration").get_by_text("it must be a number above 0").wait_for()
        page.wait_for_timeout(700)
        assert command.inner_text() == before  # of the last question that has an answer
        page.get_by_label("Duration", exact=True).fill("20")
        page.get_by_text("--duration '20 s'").wait_for()
