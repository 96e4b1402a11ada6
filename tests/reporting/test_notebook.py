"""What a notebook shows: whole HTML with a figure, its numbers those of the value, nothing of a user's text run."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from typing import Any

import matplotlib.figure
import numpy as np

from ipmclab import forecast, load_actuator, plot, simulate, validate
from ipmclab.choosing.choice import Candidate, Choice
from ipmclab.choosing.compare import Difference


def parsed(value: Any) -> tuple[ElementTree.Element, list[list[str]]]:
    """The HTML as the tree that it is, and the cells of its tables."""
    tree = ElementTree.fromstring(value._repr_html_())
    rows = [["".join(cell.itertext()) for cell in row] for row in tree.iter("tr")]
    return tree, rows


def has_figure(tree: ElementTree.Element) -> bool:
    figures = [element for element in tree.iter() if element.tag.endswith("svg")]
    return bool(figures) and "var(--" not in ElementTree.tostring(tree, encoding="unicode")


def test_a_run_and_an_actuator() -> None:
    actuator = load_actuator("friend-2")
    run = simulate(actuator, "step 1 V", duration=10.0, rate=50.0)
    tree, _ = parsed(run)
    assert has_figure(tree)
    assert "step 1 V" in "".join(tree.itertext())
    tree, rows = parsed(actuator)
    assert has_figure(tree)
    assert ["Y", "beam.modulus", "1450", "MPa"] in rows
    # A name that is written as a colour of the page is one nevertheless.
    assert "var(--mine) under step 1 V" in replace(actuator, name="var(--mine)")._repr_html_()


def test_a_fit_and_its_validation(material: Any) -> None:
    tree, rows = parsed(material.fit)
    assert has_figure(tree)
    assert not list(tree.iter("script"))  # the name of its strip is one
    resistivity = next(row for row in rows if row[0] == "circuit.dc_resistivity")
    assert resistivity[1:4] == ["43.42", "42.55 to 44.29", "Ω m"]
    assert next(row for row in rows if row[0] == "coupling.zero")[1] == "not determined"
    validation = validate(material.fit.actuator, material.validation_runs)
    tree, rows = parsed(validation)
    assert has_figure(tree)
    name, score = next(iter(validation.runs[0].scores.items()))
    assert [validation.runs[0].label, name, score.fit_text] in [row[:3] for row in rows]


def test_a_choice_and_a_forecast() -> None:
    candidates = tuple(
        Candidate(name, log_predictive=value, parameters=5) for name, value in (("a", -10.0), ("b", -12.5))
    )
    differences = {
        ("a", "b"): Difference("a", "b", 2.5, 1.0, 2.0, 4),
        ("b", "a"): Difference("b", "a", -2.5, 1.0, 2.0, 4),
    }
    choice = Choice(candidates, "a", differences, "runs", 4, ("current",), ("one.nc",), 100, 50.0)
    tree, rows = parsed(choice)
    assert has_figure(tree)
    assert ["b", "-12.5", ""] in rows
    actuator = load_actuator("friend-2+relaxation.displacement")
    run = simulate(actuator, "step 1 V", duration=40.0, rate=25.0)
    ahead = forecast(actuator, run, origin=20.0)
    tree, rows = parsed(ahead)
    assert has_figure(tree)
    assert rows[-1][2] == f"{1e3 * ahead.mean[-1]:.4g}"


def test_two_figures_of_one_notebook_share_no_id() -> None:
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=2.0, rate=50.0)
    ids = [[element.get("id") for element in parsed(run)[0].iter() if element.get("id")] for _ in range(2)]
    assert not set(ids[0]) & set(ids[1])


def test_plot_without_a_path_is_a_figure() -> None:
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=2.0, rate=50.0)
    figure = plot([run, replace(run, current=2 * run.current)])
    assert isinstance(figure, matplotlib.figure.Figure)
    drawn = [np.asarray(line.get_ydata()) for line in figure.axes[2].lines]
    assert any(
        np.max(values, where=~np.isnan(values), initial=0.0) == 2e3 * run.current.max() for values in drawn
    )  # mA
