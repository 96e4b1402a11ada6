"""A run at 0 V in a real browser: whether its strip can be tested, and a copy of it without a fan's vibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, read_run, write_run
from tests.page.browser.conftest import LONG, serious, served

pytest.importorskip("playwright")


def test_a_curl_is_judged_and_a_vibration_taken_out(tmp_path: Path, open_page) -> None:
    time = np.arange(0.0, 120.0, 0.05)
    noise = 2e-6 * np.random.default_rng(20261123).standard_normal(len(time))
    tip = 5.6e-6 * time + 2e-5 * np.sin(2.0 * np.pi * 8.0 * time) + noise
    write_run(Run.from_arrays(time=time, voltage=0.0 * time, displacement=tip), tmp_path / "room.nc")
    with served(tmp_path) as address:
        page = open_page(f"{address}/runs?run=room.nc", height=1600)
        page.get_by_role("heading", name="Without voltage").wait_for(timeout=LONG)
        page.get_by_label("Length of one test").fill("30")
        page.get_by_role("button", name="Judge the curl").click()
        page.get_by_role("alert").filter(has_text="unit").first.wait_for(timeout=LONG)
        page.get_by_label("Length of one test").fill("30 s")
        page.get_by_role("button", name="Judge the curl").click()
        page.get_by_text("The tip moves by 5.6 um/s").wait_for(timeout=LONG)
        page.get_by_text("ipmclab baseline room.nc --displacement '1.3 mm' --test '30 s' --share 0.05").wait_for()
        page.get_by_label("What is slower stays").fill("2 Hz")
        page.get_by_role("button", name="Save a smooth copy").click()
        page.get_by_role("cell", name="8 Hz", exact=True).wait_for(timeout=LONG)
        page.get_by_text("ipmclab smooth room.nc --below '2 Hz' --out room-smooth.nc").wait_for()
        page.get_by_role("link", name="room-smooth").or_(page.get_by_role("button", name="room-smooth")).wait_for()
        assert not serious(page)
    left = read_run(tmp_path / "room-smooth.nc").displacement
    assert left is not None
    assert np.std(left - 5.6e-6 * time) < 0.1 * np.std(tip - 5.6e-6 * time)
