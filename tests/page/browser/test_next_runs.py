"""The form of ``ipmclab next`` in a real browser: what it proposes, what it refuses, and that it stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import identify, load_actuator, simulate, write_fit
from tests.page.browser.conftest import LONG, kept, serious, served

pytest.importorskip("playwright")


def test_runs_are_proposed_for_a_fit_of_the_folder(tmp_path: Path, open_page) -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V", duration=10.0, rate=20.0)
    noise = 1e-4 * np.random.default_rng(20261123).standard_normal(len(run))
    fit = identify(strip, replace(run, current=run.current + noise), free="circuit.dc_resistivity")
    write_fit(fit, tmp_path / "leak.toml")
    with served(tmp_path) as address:
        page = open_page(f"{address}/identify", height=2400)
        card = page.locator("#lab-next")
        card.get_by_role("button", name="Propose runs").click()
        card.get_by_text("choose a fit; Identify makes one").wait_for(timeout=LONG)
        card.get_by_label("Fit to ask").click()
        page.get_by_role("option", name="leak.toml").click()
        card.get_by_label("Largest voltage").fill("3")
        card.get_by_role("button", name="Propose runs").click()
        card.get_by_role("alert").filter(has_text="unit").first.wait_for(timeout=LONG)
        card.get_by_label("Largest voltage").fill("1 V")
        card.get_by_label("Time on the bench").fill("6 min")
        card.get_by_label("Longest signal").fill("20 s")
        card.get_by_role("button", name="Propose runs").click()
        parameter = card.get_by_role("cell", name="circuit.dc_resistivity")
        parameter.wait_for(timeout=LONG)
        for label, wrong, told, right in (
            ("Time on the bench", "6", "'6' has no unit; write for example '15 min'", "6 min"),
            ("Time on the bench", "-6 min", "'-6 min', it must be above 0; give for example '15 min'", "6 min"),
            ("Time on the bench", "1 min", "there are 1 min; give 3 min or more, or a shorter rest", "6 min"),
            ("Largest voltage", "100 V", "no strip is given more than 10 V", "1 V"),
        ):
            card.get_by_label(label).fill(wrong)
            card.get_by_role("button", name="Propose runs").click()
            at_field = card.locator(".q-field").filter(has=page.get_by_label(label))
            at_field.get_by_text(told).wait_for(timeout=LONG)
            assert parameter.count() == 0  # it answered another question
            card.get_by_label(label).fill(right)
        card.get_by_role("button", name="Propose runs").click()
        parameter.wait_for(timeout=LONG)
        card.get_by_text("command and Python").click()
        command = "ipmclab next leak.toml --goal parameters --minutes 6 --limit 'voltage=1 V' --longest '20 s'"
        card.get_by_text(command).wait_for()
        assert not serious(page)
        card.get_by_label("What for").click()
        page.get_by_role("option", name="distinguish it from another model").click()
        card.get_by_label("Other model").fill("leak.exponential")
        kept(page, "next rival", "leak.exponential")
        page.reload()
        card.get_by_label("Other model").wait_for(timeout=LONG)
        assert card.get_by_label("Other model").input_value() == "leak.exponential"
        assert card.get_by_label("Time on the bench").input_value() == "6 min"
