"""The figure of pairs shows samples and fit in one unit: the one that people read."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ipmclab.reporting.figures.pairs import pairs_figure
from ipmclab.units import LENGTH

NAMES = ("geometry.thickness", "geometry.width")


def sampled(name: str, samples: np.ndarray) -> Any:
    low, high = np.quantile(samples, (0.025, 0.975))
    return SimpleNamespace(
        name=name, unit="m", symbol=name[9], quantity=LENGTH, interval=(float(low), float(high)), is_free=True
    )


def test_the_fit_stands_among_its_samples_and_inside_the_panel() -> None:
    generator = np.random.default_rng(20261121)
    samples = {name: 2e-3 + 1e-4 * generator.standard_normal((2, 2000)) for name in NAMES}
    parameters = {name: sampled(name, values.ravel()) for name, values in samples.items()}
    posterior: Any = SimpleNamespace(parameters=parameters, samples=samples)
    intervals = (1.85e-3, 2.15e-3), (0.0, np.inf)  # of the second nothing is known
    fit: Any = SimpleNamespace(
        parameters={
            name: SimpleNamespace(interval=interval, value=2e-3)
            for name, interval in zip(NAMES, intervals, strict=True)
        }
    )
    figure = pairs_figure(posterior, fit)
    first, _, _, second = figure.axes[:4]
    factor = LENGTH.to_display(1.0)
    assert factor != 1.0
    assert first.lines[0].get_xdata() == pytest.approx([1.85e-3 * factor, 2.15e-3 * factor])
    assert first.lines[1].get_xdata() == pytest.approx([2e-3 * factor])
    assert second.lines[0].get_xdata() == pytest.approx(second.get_xlim())
    assert LENGTH.display_unit in second.get_xlabel()
