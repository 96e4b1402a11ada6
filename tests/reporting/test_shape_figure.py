"""The strip from the side: what the figure draws, and when the report shows it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from ipmclab import Finding, load_actuator, read_fit, simulate, write_fit
from ipmclab.fit.fit_table import fit_to_table
from ipmclab.model import Actuator
from ipmclab.reporting.document import html
from ipmclab.reporting.figures.shape import shape_figure
from ipmclab.reporting.fit_verdict import verdict
from ipmclab.run import Severity
from tests.reporting.conftest import make_fit


def far() -> Actuator:
    strip = load_actuator("friend-2+laser")
    return strip.replace(**{"coupling.gain": 18.0 * strip["coupling.gain"]})


def curves(figure: Figure) -> dict[str, np.ndarray]:
    """What is drawn under a label, shape (n_points, 2)."""
    (panel,) = figure.axes
    return {str(line.get_label()): line.get_xydata() for line in panel.lines}


def test_the_strip_is_drawn_to_scale_and_its_laser_reads_it() -> None:
    strip = far()
    run = simulate(strip, "step 1.2 V", duration=20.0, rate=10.0)
    figure = shape_figure(strip, run, times=[0.0, 0.6, 20.0])
    assert figure.axes[0].get_aspect() == 1.0
    drawn = curves(figure)
    assert {"laser", "0 s", "0.6 s", "19.9 s, lost by the laser"} <= set(drawn)
    for name in ("0.6 s", "19.9 s, lost by the laser"):
        steps = np.hypot(*np.diff(drawn[name], axis=0).T)
        assert steps.sum() == pytest.approx(25.0, rel=1e-3)  # a strip keeps its length [mm]
    assert np.all(drawn["0 s"][:, 1] == 0.0)
    assert drawn["19.9 s, lost by the laser"][-1, 0] < 21.0
    dots = [line.get_xydata()[0] for line in figure.axes[0].lines if line.get_marker() == "o"]
    assert run.displacement is not None
    # Slow enough that the beam's inertia does not show.
    assert [round(float(y), 2) for _, y in dots] == [0.0, pytest.approx(1e3 * run.displacement[6], rel=0.01)]
    assert np.isnan(run.displacement[-1])


def test_both_sides_and_the_end_are_chosen() -> None:
    strip = far()
    run = simulate(strip, "square 0.5 V 0.05 Hz", duration=25.0, rate=10.0)
    (panel,) = shape_figure(strip, run).axes
    ends = [line.get_xydata()[-1, 1] for line in panel.lines if len(line.get_xydata()) > 10]
    assert min(ends) < -3.0
    assert max(ends) > 3.0
    assert 4 <= len(ends) <= 5


def test_the_report_shows_it_where_the_strip_bends_far() -> None:
    strip = far()
    runs = [simulate(strip, "step 1 V", duration=12.0, rate=20.0)]
    assert "the strip from the side" in html(make_fit(strip, runs), runs, runs)
    small = load_actuator("friend-2")
    runs = [simulate(small, "step 1 V", duration=12.0, rate=20.0)]
    assert "the strip from the side" not in html(make_fit(small, runs), runs, runs)


@pytest.mark.parametrize(
    ("severity", "interval", "words"),
    [
        ("info", (0.4, 0.6), None),
        ("warning", (1.2, 1.6), "The force relaxes back by as much as the coupling gives, or more"),
        ("warning", (0.8, 1.6), "These runs do not show whether a set point of the force can be held"),
        ("warning", (None, None), "These runs do not show whether a set point of the force can be held"),
        ("warning", (0.8, None), "These runs do not show whether a set point of the force can be held"),
        ("warning", (1.2, None), "The force relaxes back by as much as the coupling gives, or more"),
    ],
)
def test_the_verdict_says_whether_a_set_point_can_be_held(
    severity: Severity, interval: tuple[float | None, float | None], words: str | None, tmp_path: Path
) -> None:
    strip = load_actuator("friend-2")
    runs = [simulate(strip, "step 1 V", duration=4.0, rate=20.0)]
    values = dict(zip(("low", "high"), interval, strict=True))
    finding = Finding("set-point", severity, "r against 1", channel="force", values=values)
    fit = make_fit(strip, runs, findings=(finding,))
    path = tmp_path / "fit.toml"  # a file holds no bound that is not finite
    write_fit(replace(fit, actuator=replace(strip, fit_table=fit_to_table(fit))), path)
    for one in (fit, read_fit(path)):
        told = " ".join(verdict(one, [])[0])
        assert ("set point" in told) == (words is not None)
        assert (words or "") in told
