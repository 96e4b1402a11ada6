"""What Run says of the runs of an experiment, in a real browser."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.page.browser.conftest import LONG, served
from tests.page.test_live import PLAN, Recorder

pytest.importorskip("playwright")


def test_a_run_that_was_recorded_names_all_that_was_found_in_it(tmp_path: Path, open_page) -> None:
    """As its row in Runs does, also what only informs."""
    recorder = Recorder(tmp_path)
    with served(tmp_path) as address:
        page = open_page(f"{address}/run")
        recorder.tell("plan", **PLAN)
        drift = {"code": "drift-before-step", "severity": "info", "message": "it drifts", "repair": "wait"}
        told = {"state": "complete", "state_reason": "", "signal": "step 1 V", "purpose": "signal"}
        recorder.tell("recorded", path="a.nc", findings=[drift], **told)
        recorder.tell("recorded", path="b.nc", findings=[], **told)
        recorded = page.get_by_role("region", name="Recorded")
        recorded.get_by_text("a.nc: drift-before-step").wait_for(timeout=LONG)
        recorded.get_by_text("b.nc: nothing found").wait_for()
    recorder.hub.close()
