"""Campaigns at metric level whose truth is known: rows as ``table`` makes them, without records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ipmclab.comparison.table import RunRow
from ipmclab.quality.metrics import Metric


def row(value: float, *, sample: str = "a", mounting: str = "1", waveform: str = "step", **values: float) -> RunRow:
    """A run of which one metric is known."""
    metric = Metric("largest", "displacement", value, "m", None, "as drawn")
    return RunRow("run.nc", sample, mounting, "", "", waveform, values, {"displacement.largest": metric})


def campaign(
    draw: np.random.Generator,
    *,
    effects: Sequence[float] = (0.5, 0.3),
    scatter: tuple[float, float, float] = (0.3, 0.1, 0.1),
    strips: int = 8,
    mountings: int = 2,
    repeats: int = 2,
    answers: float = 0.0,
) -> list[RunRow]:
    """Strips of two thicknesses in three humidities; the loading is a sham that halves them otherwise.

    ``effects`` are those of thickness and humidity on the logarithm, from the lowest level to the highest; ``scatter``
    the standard deviations of strips, mountings and repeats; ``answers`` that of what humidity does to a strip.
    """
    rows = []
    for strip in range(strips):
        thick, loading = strip % 2, strip // 2 % 2
        own = scatter[0] * draw.normal()
        of_humidity = effects[1] + (answers * draw.normal() if answers else 0.0)
        for mounting in range(mountings):
            mounted = own + scatter[1] * draw.normal()
            for humid in (0.0, 0.5, 1.0):
                for _ in range(repeats):
                    log = effects[0] * thick + of_humidity * humid + mounted + scatter[2] * draw.normal()
                    rows.append(
                        row(
                            1e-3 * float(np.exp(log)),
                            sample=f"strip-{strip}",
                            mounting=f"{mounting}",
                            thickness=(0.18 + 0.07 * thick) * 1e-3,
                            loading=0.05 + 0.05 * loading,
                            humidity=60.0 + 20.0 * humid + 0.3 * draw.normal(),
                        )
                    )
    return rows
