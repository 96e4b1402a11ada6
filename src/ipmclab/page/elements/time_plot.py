"""Plots against time: one panel a quantity, a shared cursor, zoom, SVG and CSV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from nicegui.element import Element


@dataclass(frozen=True)
class Band:
    """A stretch of time that is marked.

    Parameters
    ----------
    begin, end : float [s]
    label : str
        Shown where the cursor is in it.
    severity : "info", "warning" or "error"
    channel : str, optional
        Key of the only panel that shows it.
    """

    begin: float
    end: float
    label: str
    severity: str = "info"
    channel: str | None = None


class TimePlot(Element, component="time_plot.js"):
    """Plots against time.

    Parameters
    ----------
    name : str
        What it shows, for screen readers and file names.
    panels : sequence of mapping
        One below the other, as ``curves.Panel.as_dict`` gives them; a live plot gets its own from the bench.
    source : str, optional
        Where the browser asks for the curves, at every zoom: an address of ``curves.CurveStore``.
    live : bool
        Follow the bench instead.
    bands : sequence of Band
    height : int [px]
        Of a panel.
    """

    def __init__(
        self,
        name: str,
        panels: Sequence[Mapping[str, Any]] = (),
        source: str | None = None,
        *,
        live: bool = False,
        bands: Sequence[Band] = (),
        height: int = 130,
    ) -> None:
        super().__init__()
        self._props["options"] = {
            "name": name,
            "panels": list(panels),
            "source": source,
            "live": live,
            "bands": [asdict(band) for band in bands],
            "height": height,
        }

    def show(self, panels: Sequence[Mapping[str, Any]], source: str | None, bands: Sequence[Band] = ()) -> None:
        """Show other curves; a zoom stays where the panels do."""
        options = {"panels": list(panels), "source": source, "bands": [asdict(band) for band in bands]}
        self._props["options"].update(options)
        self.run_method("show", options)
