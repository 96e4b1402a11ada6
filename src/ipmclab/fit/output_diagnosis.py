"""What a fit left of one output of one run, in the numbers that a reader looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

from ipmclab.tabled import Tabled

Verdict = Literal["white", "autocorrelated", "follows the voltage", "bends with the voltage"]
"""``autocorrelated``: in time, but not related to the voltage. ``bends with the voltage``: as no linear model would."""

WORDS: Final[Mapping[Verdict, str]] = {
    "white": "white noise",
    "autocorrelated": "autocorrelated, but not related to the voltage",
    "follows the voltage": "follows the voltage",
    "bends with the voltage": "follows the voltage, not in proportion",
}
"""Verdicts as tables say them."""


@dataclass(frozen=True)
class OutputDiagnosis(Tabled):
    """What was left of one output of one run.

    Parameters
    ----------
    label : str
        Of the run.
    output : str
    verdict : str
        One of ``WORDS``; of the output in all runs that are not white.
    rms : float [SI]
        Of the residuals, what the noise says of offset and trend taken off.
    scatter : float [SI]
        Of neighbouring readings: what is left where a model explains everything.
    lags : tuple of float [s]
    autocorrelation : tuple of float
        Of the residuals, at each lag.
    whitened : tuple of float
        Of what is new in each residual under the noise that was found: that is to be white.
    with_voltage : tuple of float
        Correlation of what is new with the voltage so much earlier, whitened by the same noise model, of which what the
        free parameters can imitate is taken off.
    band : float
        Within which 95 % of the correlations of white noise lie.
    """

    label: str
    output: str
    verdict: Verdict
    rms: float
    scatter: float
    lags: tuple[float, ...]
    autocorrelation: tuple[float, ...]
    whitened: tuple[float, ...]
    with_voltage: tuple[float, ...]
    band: float

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> OutputDiagnosis:
        """From what ``to_table`` gave.

        Raises
        ------
        ValueError
            An unknown verdict, or correlations that are not one for each lag.
        """
        values: dict[str, Any] = {
            key: tuple(map(float, one)) if isinstance(one, list) else one for key, one in table.items()
        }
        found = cls(**values)
        of_lags = (found.autocorrelation, found.whitened, found.with_voltage)
        if found.verdict not in get_args(Verdict) or any(len(one) != len(found.lags) for one in of_lags):
            raise ValueError("what is left of an output is not as identify writes it")
        return found
