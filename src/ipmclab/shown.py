"""Values that show themselves in a notebook."""

from __future__ import annotations

import importlib


class Shown:
    """Shows itself in Jupyter as a small table with a figure.

    How is said where figures are drawn, above everything that is shown. It is found there by its name when it is asked
    for, as the root of the package finds its names, so that no value imports what draws it.
    """

    def _repr_html_(self) -> str:
        html: str = importlib.import_module("ipmclab.reporting.notebook").html_of(self)
        return html
