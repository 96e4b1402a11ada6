"""What was chosen and is gone by now, or still at work, in a real browser: it is said, or shown, where it belongs."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import identify, load_actuator, simulate, write_fit, write_run
from tests.page.browser.conftest import LONG, served

pytest.importorskip("playwright")


def test_a_report_says_where_it_was_chosen_that_a_run_or_a_fit_is_gone(tmp_path: Path, open_page) -> None:
    rng = np.random.default_rng(20261122)
    (tmp_path / "runs").mkdir()
    made = {}
    for name, signal in (("step", "step 1 V"), ("sine", "sine 1 V 0.1 Hz")):
        run = simulate(load_actuator("friend-2"), signal, duration=10.0, rate=50.0)
        assert run.current is not None
        made[name] = replace(run, current=run.current + rng.normal(0.0, 1e-4, len(run)))
        write_run(made[name], tmp_path / "runs" / f"{name}.nc")
    fit = identify(load_actuator("friend-2"), made["step"], free=["circuit.dc_resistivity"])
    write_fit(fit, tmp_path / "known.toml")
    with served(tmp_path) as address:  # which ends without a traceback
        page = open_page(f"{address}/runs")
        page.get_by_text("2 of 2 runs").wait_for(timeout=LONG)
        page.goto(f"{address}/report?fit=known.toml")
        group = page.get_by_role("group", name="Runs to predict")
        group.get_by_label("runs/sine.nc").check()
        (tmp_path / "runs" / "sine.nc").rename(tmp_path / "away.nc")
        page.get_by_role("button", name="Make the report").click()
        group.get_by_role("alert").filter(has_text="there is no run 'runs/sine.nc'").wait_for()
        group.get_by_label("runs/sine.nc").uncheck()
        (tmp_path / "known.toml").rename(tmp_path / "known.txt")
        page.get_by_role("button", name="Make the report").click()
        field = page.locator(".q-field").filter(has=page.get_by_label("Fit", exact=True))
        field.get_by_text("there is no file 'known.toml' any more").wait_for()
        assert group.get_by_role("alert").count() == 0
        assert not list(tmp_path.glob("*.html"))


def test_a_download_of_a_run_that_is_gone_says_so(tmp_path: Path, open_page) -> None:
    (tmp_path / "runs").mkdir()
    file = tmp_path / "runs" / "my run.nc"
    write_run(simulate(load_actuator("friend-2"), "step 1 V", duration=10.0, rate=50.0), file)
    with served(tmp_path) as address:
        page = open_page(f"{address}/runs?run=runs/my%20run.nc")
        for kind, name in (("netCDF", "my run.nc"), ("XLSX", "myrun.xlsx")):
            with page.expect_download() as saved:
                page.get_by_role("link", name=kind, exact=True).click(timeout=LONG)
            assert saved.value.suggested_filename == name
        file.rename(tmp_path / "away.nc")
        for kind in ("XLSX", "netCDF"):
            page.get_by_role("link", name=kind, exact=True).click()
            page.locator("#lab-said").filter(has_text="there is no run 'runs/my run.nc'").wait_for()
            page.evaluate("say('', true)")
        # A fault of the server has no words of ours, and is no lost connection.
        page.route(re.compile("xlsx"), lambda route: route.fulfill(status=500, body="Internal Server Error"))
        page.get_by_role("link", name="XLSX", exact=True).click()
        page.locator("#lab-said").filter(has_text="the server answered 500").wait_for()


def test_after_a_reload_the_fit_at_work_is_shown_when_it_is_done(tmp_path: Path, open_page) -> None:
    (tmp_path / "runs").mkdir()
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=10.0, rate=50.0)
    write_run(run, tmp_path / "runs" / "one.nc")
    with served(tmp_path) as address:
        page = open_page(f"{address}/identify?run=runs/one.nc")
        page.get_by_text("1 to identify from").wait_for()
        page.get_by_role("button", name="Identify").click()
        page.get_by_role("heading", name="fit 1").wait_for(timeout=LONG)
        page.get_by_role("button", name="Identify").click()
        page.locator(".lab-job").filter(has_text="fit 2").wait_for()  # it may be done before "Cancel" is seen
        page.reload()
        page.get_by_text("1 to identify from").wait_for()
        page.get_by_role("heading", name="fit 2").wait_for(timeout=LONG)
        first = page.locator(".lab-job").filter(has_text="fit 1")
        button = first.get_by_role("button", name="Show")
        button.evaluate("element => { element.isTheSame = true; }")
        page.get_by_role("button", name="Identify").click()
        newest = page.locator(".lab-job").filter(has_text="fit 3")
        newest.wait_for()
        button.click()
        page.get_by_role("heading", name="fit 1").wait_for(timeout=LONG)
        newest.get_by_role("button", name="Show").wait_for(timeout=LONG)
        # A button that is drawn again as another fit ends would lose a click that is on its way.
        assert button.evaluate("element => element.isTheSame === true")
        page.wait_for_timeout(700)  # who looks at another one goes on with it
        assert page.get_by_role("heading", name="fit 1").is_visible()


def test_a_page_that_stood_still_itself_does_not_say_that_the_link_is_lost(tmp_path: Path, open_page) -> None:
    """What came meanwhile waits to be heard; a link that is silent from then on is lost as ever."""
    with served(tmp_path) as address:
        page = open_page(f"{address}/runs")
        page.wait_for_function("window.lab?.state")
        page.evaluate(
            """() => {
              const clock = performance.now.bind(performance), began = clock(), lose = lab.lose;
              lab.socket.onmessage = null; // nothing is heard any more
              lab.patience = 3500;
              performance.now = () => clock() + 60000; // a minute has passed at once
              lab.lose = function () { window.lostAfter ??= (clock() - began) / 1000; lose.call(this); };
            }"""
        )
        page.wait_for_function("window.lostAfter !== undefined")
        assert page.evaluate("window.lostAfter") > 3.0
        page.wait_for_selector("#lab-lost:not([hidden])", state="attached")
