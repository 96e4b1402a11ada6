"""What the report says of runs and mountings, and its pictures of bands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from ipmclab import Run, identify, leave_one_run_out, validate
from ipmclab.fit.fit import Fit
from ipmclab.reporting.document import html
from ipmclab.reporting.figures.mountings import mountings_figure
from ipmclab.reporting.figures.prediction import prediction_figure
from tests.identification.many import ELECTRICAL, FRIEND, mounted, noisy
from tests.reporting.test_report import Page

SEED = 20261121


@pytest.fixture(scope="module")
def mountings() -> tuple[Fit, list[Run]]:
    generator = np.random.default_rng(SEED)
    runs = []
    for name in ("<a>", "b", "c"):
        strip, _ = mounted(generator, 0.1)
        runs.append(noisy(generator, "square 1 V 0.1 Hz", strip=strip, mounting=name))
    return leave_one_run_out(identify(FRIEND, runs)), runs


def test_both_intervals_stand_in_the_report(mountings: tuple[Fit, list[Run]]) -> None:
    fit, runs = mountings
    page = Page(html(fit, runs, [noisy(np.random.default_rng(SEED), "sine 1 V 0.2 Hz", mounting="d")]))
    said = " ".join(page.text.split())
    assert "next mounting" in said
    assert "How far the strip differs between 3 mountings (<a>, b, c)" in said
    assert "Each run predicted by a fit of the others" in said
    assert "in band" in said
    assert "its band is that of the next mounting" in said
    assert "cannot be estimated" not in said


def test_what_cannot_be_known_is_said_without_a_number(mountings: tuple[Fit, list[Run]]) -> None:
    _, runs = mountings
    fit = identify(FRIEND, runs[:2])
    said = " ".join(Page(html(fit, runs[:2])).text.split())
    assert "The value at another mounting cannot be estimated from two mountings" in said
    assert "from one to the next" not in said


def test_each_dot_is_a_mounting_and_each_bar_the_next_one(mountings: tuple[Fit, list[Run]]) -> None:
    fit, _ = mountings
    (panel,) = mountings_figure(fit, ELECTRICAL).axes
    assert fit.mountings is not None
    dots = [line.get_xydata()[0] for line in panel.lines if line.get_marker() == "o"]
    assert len(dots) == 3 * len(ELECTRICAL)
    values = [one.values[ELECTRICAL[0]] for one in fit.mountings.each]
    middle = np.exp(np.mean(np.log(values)))
    assert sorted(x for x, y in dots if abs(y) < 0.5) == pytest.approx(sorted(values / middle))
    bar = panel.patches[0]
    low, high = fit.parameters[ELECTRICAL[0]].interval_next_mounting or (0.0, 0.0)
    assert (bar.get_x(), bar.get_x() + bar.get_width()) == pytest.approx((low / middle, high / middle))


def test_a_band_is_drawn_about_the_prediction_and_its_error() -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, noisy(generator, "step 1 V"))
    (one,) = validate(fit.actuator, noisy(generator, "sine 1 V 0.2 Hz")).runs
    panels = prediction_figure(one.run, {"model": one.comparisons}).axes
    bands = [[shape for shape in panel.collections if isinstance(shape, PolyCollection)] for panel in panels]
    assert [len(shapes) for shapes in bands] == [0, 1, 1]
    reach = one.comparisons["current"].reach
    assert reach is not None
    height = np.abs(bands[2][0].get_paths()[0].vertices[:, 1]).max()
    assert height == pytest.approx(1e3 * reach.max())
    bare = {name: replace(found, reach=None) for name, found in one.comparisons.items()}
    assert not any(panel.collections for panel in prediction_figure(one.run, {"model": bare}).axes)
