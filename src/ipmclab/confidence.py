"""The 95 % of every interval, the 0.1 % of every test, and what few readings cost."""

from __future__ import annotations

from typing import Final

NORMAL_95: Final = 1.959963984540054
"""How many standard errors of a normal quantity hold 95 % to both sides."""

REJECT: Final = 1e-3
"""What is assumed is given up where readings would be that rare under it (p < 0.1 %): of a hundred questions that a fit
tests, one in ten fits then gets one wrong answer."""


def wider_for_few(freedom: float) -> float:
    """How many times as wide an interval of 95 % is where its scatter was itself estimated (Student).

    Parameters
    ----------
    freedom : float
        Degrees of freedom of the scatter, above 0.

    Examples
    --------
    >>> round(wider_for_few(2), 2), round(wider_for_few(1e6), 3)
    (2.2, 1.0)
    """
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.975)) / NORMAL_95
