"""What a report shows of the residuals of a fit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from ipmclab.reporting.figures.diagnoses import diagnoses_figure
from ipmclab.reporting.svg import inline_svg
from ipmclab.reporting.wording import NO_BREAK

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit

_MOST: Final = 9
"""Outputs of runs that a figure shows: more would be skipped over."""


def diagnoses_part(fit: Fit) -> dict[str, Any] | None:
    """The figure of what is left of each output of each run, those that are no white noise first; None without any."""
    shown = sorted((one for one in fit.diagnoses if one.lags), key=lambda one: one.verdict == "white")
    if not shown:
        return None
    hidden = len(shown) - _MOST
    rest = f" {hidden} further outputs of runs are not shown." if hidden > 0 else ""
    return {
        "svg": inline_svg(
            diagnoses_figure(shown[:_MOST]), "what-is-left", "Correlations of what the fit left, over the lag"
        ),
        "caption": "Correlation of what the fit left with itself (left) and with the voltage (right). What is new in "
        "each residual, under the noise that was found, is white where model and noise are right: then "
        f"95{NO_BREAK}% of its correlations lie within the band, on both sides. A correlation outside the band "
        f"on the right is no noise: the model lacks something that responds to the voltage.{rest}",
    }
