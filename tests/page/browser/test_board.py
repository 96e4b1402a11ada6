"""The board of a campaign in a real browser: it follows what is recorded."""

from __future__ import annotations

from pathlib import Path

import pytest

from ipmclab.campaign.state import State
from ipmclab.store.journal.laboratory import Laboratory
from tests.page.browser.conftest import LONG, serious, served

pytest.importorskip("playwright")

PLAN = [f"s{sample}/force/room/step 1 V/{repeat}" for sample in (1, 2) for repeat in (1, 2)]


def test_the_board_follows_a_campaign(tmp_path: Path, open_page) -> None:
    Laboratory.open(tmp_path)
    with State(tmp_path) as state, served(tmp_path) as address:
        state.add("campaign", title="two strips", plan=PLAN)
        state.add("recorded", run=PLAN[0], uuid="1", verdict="kept")
        page = open_page(f"{address}/runs")
        page.get_by_text(f"two strips: 1 of 4 runs; next: {PLAN[1]}").wait_for(timeout=LONG)
        assert page.get_by_role("cell", name="1 of 2", exact=True).count() == 1
        assert not serious(page)
        state.add("recorded", run=PLAN[1], uuid="2", verdict="flagged")
        page.get_by_text(f"two strips: 2 of 4 runs; next: {PLAN[2]}").wait_for(timeout=LONG)
        assert page.get_by_role("cell", name="1 of 2, 1 flagged").count() == 1
