"""The page of a comparison: every figure with its numbers, nothing fetched from elsewhere."""

from __future__ import annotations

import base64
import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import ipmclab
from ipmclab.comparison.compare import Comparison, compare
from ipmclab.comparison.factors import chosen_factors
from ipmclab.comparison.table import RunRow
from ipmclab.quality.metrics import Metric
from ipmclab.reporting.comparison import (
    comparison_figures,
    comparison_html,
    figure_csv,
    write_comparison,
    write_comparison_data,
)
from ipmclab.reporting.figures.comparison import effects_figure, factor_figures
from ipmclab.reporting.figures.responses import _log_axes, response_figures
from ipmclab.reporting.style import COLOURS, SERIES
from ipmclab.reporting.wording import NO_BREAK
from tests.comparison.campaigns import campaign

SIGNAL = "multisine 1 V 0.1 Hz 2 Hz harmonics=odd phases=random left_out=4"


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    """A campaign of twelve strips, three sines and a multisine of another."""
    strip = ipmclab.load_actuator("friend-2")
    signals = ("sine 1 V 0.1 Hz", "sine 1 V 0.2 Hz", "sine 1 V 0.5 Hz", SIGNAL)
    found = compare([ipmclab.simulate(strip, one, duration=40.0, rate=20.0) for one in signals])
    rows = campaign(np.random.default_rng(5), scatter=(0.05, 0.03, 0.02), strips=12)
    return replace(found, rows=(*found.rows, *rows))


def test_every_figure_is_there_with_its_numbers(comparison: Comparison, tmp_path: Path) -> None:
    figures = comparison_figures(comparison)
    names = [figure.name for figure in figures]
    assert names == [
        "effects",
        "thickness-step",
        "loading-step",
        "frequency-sine",
        "humidity-step",
        "strips-step-displacement-largest",
        "response-sines",
        "response-1",
    ]
    for figure in figures:
        head, *rows = csv.reader(figure_csv(figure).splitlines())
        assert tuple(head) == figure.columns
        assert rows
        assert all(len(row) == len(head) for row in rows)
        assert "np.float64" not in figure_csv(figure)
    page = write_comparison(comparison, tmp_path / "c.html", command="ipmclab compare *.nc").read_text("utf-8")
    assert page.count('<svg class="figure"') == len(names)
    assert "http" not in page.replace("http://www.w3.org", "")
    told = re.findall(r'download="([^"]+)" href="data:text/csv;base64,([^"]+)"', page)
    assert [name for name, _ in told] == [*(f"{name}.csv" for name in names), "runs.csv"]
    effects = base64.b64decode(dict(told)["effects.csv"]).decode()
    assert effects == figure_csv(figures[0])


def test_a_factor_is_drawn_with_the_rest_held(comparison: Comparison) -> None:
    """Thickness at one humidity, as the thesis draws it; the caption says which."""
    (figure,) = [one for one in comparison_figures(comparison) if one.name == "thickness-step"]
    assert len({row[4] for row in figure.data}) == 2
    assert len(figure.data) == len([row for row in comparison.rows if row.waveform == "step"]) / 3
    assert "relative humidity" in figure.caption


def test_a_strip_has_one_look_and_strips_alike_in_the_other_property_are_joined() -> None:
    """As in figures 5.64 to 5.66: over the loading a line for each membrane; strip c looks the same where a is not."""

    def row(sample: str, thickness: float, loading: float, waveform: str = "step") -> RunRow:
        values = {"thickness": thickness, "loading": loading}
        size = Metric("largest", "displacement", 1e3 * thickness * loading, "m", None, "")
        return RunRow(f"{sample}.nc", sample, "", "", "", waveform, values, {"displacement.largest": size})

    strips = {"a": (183e-6, 0.05), "b": (183e-6, 0.1), "c": (254e-6, 0.05), "d": (254e-6, 0.1)}
    rows = [row(name, *of) for name, of in strips.items()] + [row(n, *strips[n], "sine") for n in ("c", "d")]
    found = Comparison(tuple(rows), chosen_factors(["loading"]), ("displacement.largest",), {}, {}, {}, ())
    step, sine = factor_figures(found)
    panel, other = step.draw().axes[0], sine.draw().axes[0]
    grey = [line.get_ydata().tolist() for line in panel.lines if line.get_color() == COLOURS["muted"]]
    assert np.asarray(grey) == pytest.approx(np.array([[9.15, 18.3], [12.7, 25.4]]))
    assert panel.lines[-2].get_color() == other.lines[-2].get_color() == COLOURS[SERIES[3]]
    assert step.columns[-1] == "thickness [m]"
    assert "one membrane thickness" in step.caption


def test_runs_whose_strip_is_not_named_are_not_joined() -> None:
    """In effects each counts as a strip of its own, and here a line went through them as through one strip."""

    def row(run: str, sample: str, volts: float) -> RunRow:
        size = Metric("largest", "displacement", 1e-3 * volts, "m", None, "")
        return RunRow(run, sample, "", "", "", "step", {"voltage": volts}, {"displacement.largest": size})

    def drawn(sample: str) -> tuple[str, list[float]]:
        rows = (row("a.nc", sample, 1.0), row("b.nc", sample, 2.0))
        (figure,) = factor_figures(
            Comparison(rows, chosen_factors(["voltage"]), ("displacement.largest",), {}, {}, {}, ())
        )
        return figure.caption, figure.draw().axes[0].lines[-1].get_ydata().tolist()

    caption, line = drawn("strip-1")
    assert "not joined" not in caption
    assert line[:2] == pytest.approx([1.0, 2.0])
    caption, line = drawn("")
    assert "Runs that name no sample are not joined." in caption
    assert line == pytest.approx([1.0, np.nan, 2.0, np.nan], nan_ok=True)


def test_a_power_of_ten_does_not_stand_in_the_name_of_a_panel() -> None:
    key = "displacement.strain_amplitude"

    def row(volts: float) -> RunRow:
        size = Metric("strain_amplitude", "displacement", 2.5e-5 * volts, "", None, "")
        return RunRow(f"{volts}.nc", "a", "", "", "", "sine", {"voltage": volts}, {key: size})

    found = Comparison((row(1.0), row(2.0)), chosen_factors(["voltage"]), (key,), {}, {}, {}, ())
    figure = factor_figures(found)[0].draw()
    figure.draw_without_rendering()
    panel = figure.axes[0]
    power = panel.yaxis.get_offset_text()
    assert "1e" in power.get_text()
    assert not power.get_window_extent().overlaps(panel._left_title.get_window_extent())


def test_tables_and_figures_as_files(tmp_path: Path) -> None:
    strip = ipmclab.load_actuator("friend-2")
    found = compare([ipmclab.simulate(strip, f"step {one} V", duration=10.0, rate=10.0) for one in (1, 2, 3, 4)])
    paths = write_comparison_data(found, tmp_path)
    assert [path.name for path in paths] == [
        "runs.csv",
        "effects.csv",
        "effects.svg",
        "voltage-step.csv",
        "voltage-step.svg",
    ]
    rows = list(csv.DictReader(paths[0].read_text("utf-8").splitlines()))
    assert [float(row["voltage [V]"]) for row in rows] == [1.0, 2.0, 3.0, 4.0]
    assert float(rows[1]["force.largest [N]"]) == pytest.approx(2.0 * float(rows[0]["force.largest [N]"]))


def test_performance_says_under_which_condition(tmp_path: Path) -> None:
    strip = ipmclab.load_actuator("friend-2")
    signals = ("sine 1 V 0.1 Hz", "sine 1 V 0.5 Hz", "step 1 V")
    runs = [ipmclab.simulate(strip, one, duration=20.0, rate=20.0) for one in signals]
    dry = [replace(run, metadata=replace(run.metadata, relative_humidity=60.0, temperature=20.0)) for run in runs]
    page = write_comparison(compare(dry), tmp_path / "c.html").read_text("utf-8")
    told = " ".join(re.sub(r"<[^>]*>", " ", page[page.index('id="performance"') :]).split())
    assert "step 1 V 60 %, 20 °C 0.576 mm" in told
    assert "displacement 1 V, 60 %, 20 °C 2" in told


def test_one_run_alone_makes_a_page(tmp_path: Path) -> None:
    strip = ipmclab.load_actuator("friend-2")
    found = compare([ipmclab.simulate(strip, "step 1 V", duration=10.0, rate=10.0)])
    page = write_comparison(found, tmp_path / "c.html").read_text("utf-8")
    assert "Comparison of 1 runs" not in page
    assert "Comparison of one run" in page


def test_each_metric_says_its_own_levels_where_they_differ() -> None:
    """Displacement at 1 and 3 V, force at 1 and 2 V: no title holds for both, and no name is cut for it."""
    strip = ipmclab.load_actuator("friend-2")

    def measured(channel: str, volts: float) -> ipmclab.Run:
        run = ipmclab.simulate(strip, f"step {volts:g} V", duration=10.0, rate=10.0)
        values = (1.0 + 0.01 * next(scatter)) * run.channels[channel]
        return replace(run, **{"current": None, "displacement": None, "force": None, channel: values})

    scatter = iter((0.0, 1.0, 2.0, 0.5, 1.5, 0.2, 0.7, 1.1))
    runs = [measured("displacement", volts) for volts in (0.987, 0.987, 2.96, 2.96)]
    runs += [measured("force", volts) for volts in (0.987, 0.987, 1.98, 1.98)]
    figure = effects_figure(compare(runs))
    assert figure is not None
    (panel,) = figure.draw().axes
    assert panel.get_title(loc="left").endswith("highest level over lowest")
    said = " ".join(label.get_text() for label in panel.get_yticklabels())
    assert "2.96 V over 0.987 V" in said
    assert "1.98 V over 0.987 V" in said
    assert "step: displacement, largest" in said  # it was "step: displacement, la…t, 2.96 V over 0.987 V"


def test_a_mean_says_of_how_many_runs_and_from_where_to_where() -> None:
    """Free displacements of 12 and 0.4 mm are no strip of 6.2 mm."""

    def row(name: str, **values: float) -> RunRow:
        metrics = {f"{one}.largest": Metric("largest", one, value, "", None, "") for one, value in values.items()}
        return RunRow(name, "s", "", "", "step 2 V", "step", {"voltage": 2.0}, metrics)

    rows = (row("1", displacement=12e-3, force=1e-3), row("2", displacement=-0.4e-3))
    by = chosen_factors(["voltage"])
    page = comparison_html(Comparison(rows, by, (), {}, {}, {}, ())).replace(NO_BREAK, " ")
    assert "6.20 mm (mean of 2 runs, 0.400 mm to 12.0 mm)" in page
    assert '<td class="number">1.00 mN</td>' in page  # of one run
    assert "<p>No effect: as far as is known the runs do not differ in voltage.</p>" in page


@pytest.mark.parametrize(
    ("gains", "marks"),
    [
        ((0.9, 3.2), [1.0, 1.5, 2.0, 3.0]),
        ((0.09, 2.1), [0.1, 0.2, 0.5, 1.0, 2.0]),
    ],
)
def test_a_narrow_range_of_gains_has_round_marks(gains: tuple[float, float], marks: list[float]) -> None:
    gain, phase = Figure().subplots(2)
    gain.set_ylim(*gains)
    _log_axes(gain, phase, "current")
    assert gain.get_yticks() == pytest.approx(marks)


def test_only_the_channels_that_respond_have_a_panel() -> None:
    strip = ipmclab.load_actuator("friend-2")
    both = [ipmclab.simulate(strip, f"sine 1 V {frequency} Hz", duration=20.0, rate=20.0) for frequency in (0.1, 0.5)]
    moved = [
        ipmclab.Run.from_arrays(
            time=run.time, voltage=run.voltage, displacement=run.displacement, hold=run.hold, metadata=run.metadata
        )
        for run in both
    ]
    figure = response_figures(compare(moved))[0].draw()
    assert [panel.get_title(loc="left") for panel in figure.axes] == ["displacement (mm/V)", "phase (deg)"]
