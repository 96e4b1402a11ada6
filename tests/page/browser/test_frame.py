"""The frame of the page in a real browser: it comes up, and every section opens."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.page.browser.conftest import served

pytest.importorskip("playwright")


def test_every_section_opens(tmp_path: Path, open_page) -> None:
    with served(tmp_path) as address:
        page = open_page(address)
        for title in ("Run", "Runs", "Identify", "Simulate", "Report"):
            page.get_by_role("link", name=title, exact=True).click()
            page.wait_for_function(f"document.title.startsWith('{title} ·')")
            assert page.get_by_role("button", name="ZERO").is_enabled()
        page.wait_for_function("document.getElementById('lab-bench-word').textContent === 'idle'")
