"""The axis on which models are ranked holds the nearest and the farthest of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ipmclab.reporting.figures.choice import choice_figure


def ranked(*apart: tuple[float, float]) -> Any:
    """Models whose differences to the best [nat] and their errors are given; what is beyond two errors is told."""
    names = [f"branches={number}" for number in range(1, len(apart) + 2)]
    differences = {
        (name, names[0]): SimpleNamespace(
            value=value, standard_error=error, limit=2.0, is_distinguished=-value > 2.0 * error
        )
        for name, (value, error) in zip(names[1:], apart, strict=True)
    }
    models = [SimpleNamespace(name=name, parameters=4) for name in names]
    return SimpleNamespace(ranked=models, best=names[0], preferred=names[0], differences=differences)


@pytest.mark.parametrize(
    ("apart", "scale"),
    [
        ([], "linear"),
        ([(0.0, 0.0)], "linear"),
        ([(-182.0, 82.0)], "linear"),  # a single rival has all of the axis
        ([(-1.7, 570.0), (-4.7, 590.0)], "linear"),
        ([(-20.0, 5.0), (-300.0, 10.0)], "linear"),
        ([(-5.0, 3.0), (-500.0, 82.0)], "symlog"),
        ([(-0.2, 0.1), (-300.0, 10.0)], "symlog"),
    ],
)
def test_a_model_a_hundred_times_worse_hides_no_other(apart: list[tuple[float, float]], scale: str) -> None:
    figure = choice_figure(ranked(*apart))
    (panel,) = figure.axes
    assert panel.get_xscale() == scale
    assert ("logarithmic" in panel.get_xlabel()) is (scale == "symlog")
    points = [line.get_xdata()[0] for line in panel.lines if line.get_marker() in ("o", "D")]
    across = np.diff(sorted(panel.transData.transform([(value, 0.0) for value in points])[:, 0]))
    assert scale == "linear" or across.min() > 0.02 * panel.bbox.width
