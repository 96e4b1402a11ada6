"""The first answer of a fit, in a real browser: shown while the rest goes on, and kept without it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import load_actuator, simulate, write_run
from tests.page.browser.conftest import LONG, serious, served

pytest.importorskip("playwright")

WITHOUT_END = Path(__file__).parent / "without_end"
RESISTIVITY = "circuit.dc_resistivity"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A page whose fits go on until somebody ends them, on a folder with a run."""
    folder = tmp_path_factory.mktemp("lab")
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V", duration=20.0, rate=50.0)
    assert run.current is not None
    noise = np.random.default_rng(20261121).normal(0.0, 2e-4, len(run))
    about = replace(run.metadata, origin="measured")
    write_run(replace(run, current=run.current + noise, applied_voltage=None, metadata=about), folder / "step.nc")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PYTHONPATH", os.pathsep.join([str(WITHOUT_END), *filter(None, [os.getenv("PYTHONPATH")])]))
        with served(folder) as found:
            yield found


@pytest.fixture
def page(address: str, open_page):
    """The section, with a fit that has its first answer."""
    page = open_page(f"{address}/identify?run=step.nc", width=1024)
    page.get_by_text("1 to identify from").wait_for()
    page.get_by_text("--free electrical").first.wait_for()
    page.get_by_role("button", name="Identify").click()
    page.get_by_text("Intervals, and what the model lacks, follow").wait_for(timeout=LONG)
    return page


def test_a_first_answer_is_shown_and_kept(page) -> None:
    page.get_by_text("a profile without end").wait_for(timeout=LONG)
    table = page.get_by_role("region", name="First answer of fit")
    rows = [row.split("\t") for row in table.locator("tbody tr").all_inner_texts()]
    values = {name: (value, unit) for name, value, unit in rows}
    assert len(values) == 5 + 1, "the parameters of the group, and what is left of the current"
    value, unit = values[RESISTIVITY]
    assert float(value) == pytest.approx(load_actuator("friend-2").parameter_values[RESISTIVITY], rel=0.1)
    assert unit == "ohm m"
    left, unit = values["residual of the current in step"]
    assert float(left) == pytest.approx(0.2, rel=0.1)  # the noise of the record
    assert unit == "mA"
    assert serious(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= 1024
    page.reload()
    page.get_by_role("region", name="First answer of fit").wait_for()
    page.get_by_role("button", name="Keep this fit").click()
    page.get_by_text("free parameters are determined").wait_for(timeout=LONG)
    assert not page.get_by_role("button", name="Keep this fit").count()
    assert not page.get_by_role("region", name="First answer of fit").count()
    row = page.get_by_role("region", name="Parameters").locator("tr", has_text=RESISTIVITY)
    assert float(row.locator("td").nth(2).inner_text().split()[0]) == pytest.approx(float(value), rel=0.01)
    page.get_by_text("because the fit was interrupted").wait_for()
    page.get_by_role("button", name="Save", exact=True).wait_for()


def test_who_cancels_after_the_first_answer_has_no_fit(page) -> None:
    page.get_by_role("button", name="Cancel").click()
    page.locator(".lab-job").first.get_by_text("cancelled", exact=True).wait_for(timeout=LONG)
    assert not page.get_by_role("region", name="First answer of fit").count()
