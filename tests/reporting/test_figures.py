"""Figures: what stands in the files, what decimation keeps, and what inlining changes."""

from __future__ import annotations

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from matplotlib.figure import Figure

from ipmclab import Finding, Run, RunMetadata, identify, import_run, load_actuator, simulate, validate
from ipmclab.errors import InputError
from ipmclab.quality import check
from ipmclab.reporting import before_and_after, characteristic, overview, plot
from ipmclab.reporting.decimate import decimate
from ipmclab.reporting.figures.frequency import frequency_figure
from ipmclab.reporting.figures.panels import band, curve, scale_to_lines, stacked
from ipmclab.reporting.figures.prediction import prediction_figure
from ipmclab.reporting.figures.runs import runs_figure
from ipmclab.reporting.svg import inline_svg

MAPS = Path(__file__).parents[2] / "docs" / "import_maps"
BEGINNINGS = {".svg": b"<?xml", ".png": b"\x89PNG", ".pdf": b"%PDF"}


@pytest.fixture(scope="module")
def lost_laser(material) -> Run:
    """A record whose laser loses the tip for a while, as a real one does."""
    run = material.validation_runs[0]
    displacement = run.displacement.copy()
    displacement[200:300] = np.nan
    return replace(run, displacement=displacement)


@pytest.mark.parametrize("suffix", sorted(BEGINNINGS))
def test_plot_writes_what_the_suffix_says(material, tmp_path, suffix) -> None:
    assert plot(material.runs, tmp_path / f"small{suffix}").read_bytes().startswith(BEGINNINGS[suffix])
    assert plot(material.runs, tmp_path / f"LARGE{suffix.upper()}").read_bytes().startswith(BEGINNINGS[suffix])


def test_plot_names_runs_channels_units_and_findings(material, lost_laser, tmp_path) -> None:
    path = plot([*material.runs, lost_laser], tmp_path / "runs.svg")
    texts = {element.text for element in ElementTree.parse(path).iter() if element.text and element.text.strip()}
    assert {"voltage (V)", "current (mA)", "displacement (mm)", "force (mN)", "time (s)"} <= texts
    assert {"step 1 V", "sine 1 V 0.5 Hz", "square 1 V 0.25 Hz"} <= texts
    assert "laser-lost: left out" in texts
    named = plot(material.runs, tmp_path / "named.svg", labels=["before", "after"]).read_text("utf-8")
    assert "before" in named
    assert "sine 1 V" not in named


def test_any_name_can_stand_in_a_figure(material, tmp_path) -> None:
    names = ["_left out_", r"$\frac{$ & <b>", "步骤一 \x00\x1b", "a" * 300]
    for suffix in BEGINNINGS:
        path = plot([material.runs[0]] * 4, tmp_path / f"runs{suffix}", labels=names)
    texts = "".join(ElementTree.parse(tmp_path / "runs.svg").getroot().itertext())
    for wanted in ("_left out_", r"$\frac{$ & <b>", "步骤一", "aaaa…aaaa"):
        assert wanted in texts
    assert path.exists()


def test_plot_refuses_what_it_cannot_do(material, tmp_path) -> None:
    with pytest.raises(InputError, match=r"cannot be written as '.bmp'; end the name in one of .svg, .png, .pdf"):
        plot(material.runs, tmp_path / "runs.bmp")
    with pytest.raises(InputError, match="there is no run to draw"):
        plot([], tmp_path / "runs.svg")
    with pytest.raises(InputError, match="does not exist"):
        plot(material.runs, tmp_path / "nowhere" / "runs.svg")
    with pytest.raises(InputError, match="3 labels for 2 runs"):
        plot(material.runs, tmp_path / "runs.svg", labels=["a", "b", "c"])
    taken = tmp_path / "taken.svg"
    taken.write_text("precious")
    with pytest.raises(InputError, match="exists"):
        plot(material.runs, taken)
    assert [path.name for path in tmp_path.iterdir()] == ["taken.svg"]
    assert taken.read_text() == "precious"


def test_figures_leave_no_global_state() -> None:
    # A user's own pyplot session must look the same after our figures.
    program = (
        "import matplotlib, sys; before = matplotlib.rcParams.copy(); import tempfile, pathlib\n"
        "from ipmclab import Run; from ipmclab.reporting import plot\n"
        "run = Run.from_arrays(time=[0, 1, 2], voltage=[0, 1, 1], current=[0, 1, 0.5])\n"
        "plot(run, pathlib.Path(tempfile.mkdtemp()) / 'x.svg')\n"
        "assert matplotlib.rcParams.copy() == before; assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)


def test_overview_has_a_column_for_each_run(material) -> None:
    validation = validate(material.fit.actuator, material.validation_runs)
    figure = overview(material.fit, material.runs, validation)
    titles = {panel.get_title(loc="left").strip() for panel in figure.axes} - {""}
    assert titles == {"step 1 V", "sine 1 V 0.5 Hz", "square 1 V 0.25 Hz"}
    # Current in all three runs; displacement in one; force in two.
    assert sum(panel.get_visible() for panel in figure.axes) == 6


def test_two_inlined_figures_share_no_id_and_no_style(material) -> None:
    figures = [frequency_figure(np.geomspace(0.01, 1, 9), {"a & b": {"current": np.ones(9, complex)}}) for _ in "12"]
    texts = [inline_svg(figure, name, "<gain>") for figure, name in zip(figures, ("one", "two"), strict=True)]
    ids = [{element.get("id") for element in ElementTree.fromstring(text).iter()} - {None} for text in texts]
    assert ids[0]
    assert not ids[0] & ids[1]
    assert all("<style" not in text and "&lt;gain&gt;" in text for text in texts)


def test_a_text_in_a_figure_cannot_leave_it() -> None:
    figure = Figure()
    figure.text(0.5, 0.5, "</text></svg><script>alert(1)</script>")
    assert "<script" not in inline_svg(figure, "hostile", "x")


@given(arrays.arrays(np.float64, st.integers(2, 3000), elements=st.floats(-1e6, 1e6)), st.integers(2, 60))
def test_decimation_keeps_ends_and_peaks(values, buckets) -> None:
    x = np.arange(float(len(values)))
    fewer_x, fewer = decimate(x, values, buckets=buckets)
    assert len(fewer) <= max(6 * buckets + 2, len(values) if len(values) <= 2 * buckets else 0)
    assert (fewer_x[0], fewer_x[-1]) == (x[0], x[-1])
    assert (fewer.min(), fewer.max()) == (values.min(), values.max())
    assert np.all(np.diff(fewer_x) >= 0)
    assert np.array_equal(values[fewer_x.astype(int)], fewer)


@pytest.mark.parametrize("edge", [5000, 5007, 5024])
def test_an_edge_of_one_row_stays_upright(edge: int) -> None:
    """Wherever it lies in a stretch of 25 rows: no point that is kept lies between the rows beside it."""
    values = np.where(np.arange(10000) >= edge, 3.0, 0.0)
    values[8003:8010] = 5.0  # a pulse within a stretch
    x, fewer = decimate(np.arange(10000.0), values)
    for row in (edge, 8003, 8010):
        assert {row - 1.0, float(row)} <= set(x)
        assert np.interp([row - 1.0, float(row)], x, fewer) == pytest.approx(values[row - 1 : row + 1])
    assert len(x) < 820


def test_decimation_keeps_gaps() -> None:
    values = np.sin(np.arange(10000) / 500)
    values[3000:7000] = np.nan
    x, fewer = decimate(np.arange(10000.0), values)
    assert np.all(np.isnan(fewer[(x > 3050) & (x < 6950)]))
    assert np.all(np.isfinite(fewer[(x < 2950) | (x > 7050)]))


def test_readings_that_were_left_out_do_not_set_the_scale(material) -> None:
    run = material.validation_runs[0]
    displacement = run.displacement.copy()
    displacement[205:260] = displacement[310:330] = -0.0999999  # what a laser without a target says
    lost = replace(run, displacement=displacement)
    figure = runs_figure([lost], ["lost"], [check(lost)])
    panel = next(panel for panel in figure.axes if panel.get_title(loc="left").startswith("displacement"))
    assert panel.get_ylim()[0] > -2


def test_a_warning_that_leaves_nothing_out_is_noted_at_its_place() -> None:
    run = Run.from_arrays(time=np.arange(100.0), voltage=np.ones(100), current=np.ones(100))
    noted = Finding("current-rises", "warning", "m", channel="current", samples=((20, 30),))
    everywhere = Finding("stale-values", "warning", "m", channel="current", samples=((0, 100),))
    figure = runs_figure([run], ["a"], [[noted, everywhere]])
    panel = next(panel for panel in figure.axes if panel.get_title(loc="left").startswith("current"))
    assert [text.get_text() for text in panel.get_legend().get_texts()] == ["noted: current-rises"]


def test_what_is_marked_is_where_it_was_found_and_not_everywhere() -> None:
    """A current that rises for most of a record is marked; readings that are stale here and there all along are not."""
    run = Run.from_arrays(time=np.arange(1000.0), voltage=np.ones(1000), current=np.ones(1000))
    rises = Finding("current-rises", "warning", "m", channel="current", samples=((100, 750),))
    spread = Finding(
        "stale-values", "warning", "m", channel="current", samples=tuple((k, k + 1) for k in range(0, 1000, 2))
    )
    figure = runs_figure([run], ["a"], [[rises, spread]])
    panel = next(panel for panel in figure.axes if panel.get_title(loc="left").startswith("current"))
    assert [text.get_text() for text in panel.get_legend().get_texts()] == ["noted: current-rises"]


def test_a_lost_laser_does_not_set_the_scale(real_runs) -> None:
    run = import_run(real_runs / "step_2V.csv.gz", MAPS / "step_2V.toml")
    figure = runs_figure([run], ["step_2V"], [check(run)])
    panel = next(panel for panel in figure.axes if panel.get_title(loc="left").startswith("displacement"))
    # The strip moved 12 mm before the laser lost it; the readings on the way out of range say 80 mm.
    assert panel.get_ylim()[1] < 15


def test_the_characteristic_is_current_over_voltage() -> None:
    """Of a resistance a line through 0 with its conductance; a reading that is left out leaves a gap."""
    time = np.arange(0.0, 20.0, 0.02)
    voltage = np.sin(0.2 * np.pi * time)
    current = voltage / 50.0
    current[100:110] = np.nan
    run = Run.from_arrays(time=time, voltage=voltage, current=current)
    (panel,) = characteristic(run).axes
    line = panel.lines[-1]
    drawn = np.asarray(line.get_ydata())
    assert np.isnan(drawn[100:110]).all()
    np.testing.assert_allclose(drawn[:100], 20.0 * np.asarray(line.get_xdata())[:100], rtol=1e-12)
    assert (panel.get_xlabel(), panel.get_title(loc="left")) == ("voltage (V)", "current (mA)")
    long = Run.from_arrays(time=np.arange(40_000.0), voltage=np.zeros(40_000), current=np.zeros(40_000))
    assert len(characteristic(long).axes[0].lines[-1].get_xdata()) <= 6000
    with pytest.raises(InputError, match="no run has a current"):
        characteristic(Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 1.0]))
    with pytest.raises(InputError, match="no run has a current"):
        characteristic([])


def test_before_and_after_show_the_same_readings_and_both_models() -> None:
    truth = load_actuator("friend-2")
    start = truth.replace(**{"circuit.branches.1.permittivity": 0.1})
    run = simulate(truth, "step 1 V", duration=10.0, rate=50.0)
    figure = before_and_after(replace(run, force=None), start, truth)
    panels = figure.axes
    assert len(panels) == 4  # current and displacement, before and after
    for left, right, output in ((panels[0], panels[1], run.current), (panels[2], panels[3], run.displacement)):
        for panel in (left, right):
            np.testing.assert_allclose(panel.lines[0].get_ydata(), 1e3 * np.asarray(output), rtol=1e-14)
        np.testing.assert_allclose(right.lines[1].get_ydata(), right.lines[0].get_ydata(), atol=1e-9)
        assert np.abs(np.subtract(left.lines[1].get_ydata(), left.lines[0].get_ydata())).max() > 0.01
    alone = before_and_after(replace(run, force=None), None, start).axes
    assert len(alone) == 2
    for panel, left in zip(alone, panels[::2], strict=True):
        np.testing.assert_array_equal(panel.lines[1].get_ydata(), left.lines[1].get_ydata())
    with pytest.raises(InputError, match="to hold a model against"):
        before_and_after([], start, truth)


def test_only_what_the_fit_identified_is_drawn_after_it() -> None:
    """A circuit alone says nothing of the motion, and a load cell that nothing touched nothing of any model."""
    truth = load_actuator("friend-2")
    run = simulate(truth, "step 1 V", duration=10.0, rate=50.0)
    untouched = replace(run, force=np.random.default_rng(20261126).normal(0.0, 1e-5, len(run)))
    figure = before_and_after(untouched, truth, identify(truth, untouched, free="electrical").actuator)
    assert [panel.get_ylabel() for panel in figure.axes] == ["current (mA)", ""]
    said = "Not drawn: displacement, which the fit did not identify; force, of which no reading counts."
    assert said in [text.get_text() for text in figure.texts]
    both = before_and_after(untouched, truth, truth)  # no fit: whose values these are is not asked
    assert [panel.get_ylabel() for panel in both.axes[::2]] == ["current (mA)", "displacement (mm)"]


def test_readings_that_were_left_out_set_no_scale_beside_a_model() -> None:
    """A laser that lost its strip says 90 mm: it moved by less than one."""
    truth = load_actuator("friend-2")
    run = simulate(truth, "step 1 V", duration=20.0, rate=50.0)
    lost = np.asarray(run.displacement).copy()
    lost[500:520] = 90e-3
    (one,) = validate(truth, replace(run, displacement=lost, metadata=RunMetadata(starts_from_rest=True))).runs
    assert not one.comparisons["displacement"].used[500:520].any()
    one = replace(one, run=replace(one.run, current=None, force=None))
    shown = {"displacement": one.comparisons["displacement"]}
    for figure in (prediction_figure(one.run, {"model": shown}), before_and_after(one.run, truth, truth)):
        for panel in figure.axes[-2:]:
            assert max(np.abs(panel.get_ylim())) < 2.0
        assert max(np.nanmax(line.get_ydata()) for panel in figure.axes for line in panel.lines) > 80.0  # but are shown


@pytest.mark.parametrize(("reach", "low", "high"), [(1.0, -1.5, 2.5), (0.1e-3, -0.2, 1.2)])
def test_a_wide_band_does_not_set_the_scale(reach: float, low: float, high: float) -> None:
    """Lines from 0 to 1 mm: of a band of metres half a millimetre is seen on either side, of a narrow one all."""
    time = np.arange(11.0)
    _, (panel,) = stacked([2.0])
    curve(panel, "displacement", time, 1e-4 * time)
    band(panel, "displacement", time, 1e-4 * time, np.full(11, reach))
    scale_to_lines(panel)
    bottom, top = panel.get_ylim()
    assert low < bottom < 0.0
    assert 1.0 < top < high


@pytest.mark.parametrize("count", [10, 1000])
def test_a_band_holds_every_row_and_hardly_more(count: int) -> None:
    """Of 1,000 rows stretches of two are drawn: a wide row among narrow ones stays wide."""
    time, middle, reach = np.arange(float(count)), np.full(count, 2e-3), np.full(count, 1e-3)
    wide = [0, 3, count // 2, count - 1]
    reach[wide] = 5e-3
    _, (panel,) = stacked([2.0])
    band(panel, "displacement", time, middle, reach, label="95 % band")
    (shade,) = panel.collections
    (path,) = shade.get_paths()
    assert shade.get_label() == "95 % band"
    # Within a row's own edges, which lie on those of the stretches.
    at = time + np.where(time < time[-1], 1e-3, -1e-3)
    for side in (-1.0, 1.0):
        held = path.contains_points(np.column_stack([at, 1e3 * (middle + side * 0.999 * reach)]))
        assert held.all()
        apart = np.abs(time[:, None] - time[wide]).min(axis=1) > (0.0 if count == 10 else 2.0)
        beyond = path.contains_points(np.column_stack([at, 1e3 * (middle + side * 1.01 * reach)]))
        assert not beyond[apart].any()
    assert path.vertices[:, 0].min() == 0.0
    assert path.vertices[:, 0].max() == time[-1]


def test_legends_of_many_runs_have_room(material, lost_laser) -> None:
    """Ten runs need three rows above the first panel; five kinds of readings that were left out two above another."""
    run = replace(lost_laser, force=None)
    codes = ("laser-lost", "spike", "rate-jump", "at-limit", "contact-missing")
    masked = [
        Finding(code, "warning", "m", channel="displacement", samples=((9, 20),), effect="mask") for code in codes
    ]
    figure = runs_figure([run] * 10, [f"the run of day {day}" for day in range(10)], [masked] * 10)
    figure.draw_without_rendering()
    displacement = next(panel for panel in figure.axes if panel.get_title(loc="left").startswith("displacement"))
    assert len(figure.axes[0].get_legend().get_texts()) == 10
    assert len(displacement.get_legend().get_texts()) == len(codes)
    for panel in (figure.axes[0], displacement):
        box = panel.get_legend().get_window_extent()
        assert box.y1 <= figure.bbox.y1
        assert not any(box.overlaps(other.get_window_extent()) for other in figure.axes)
