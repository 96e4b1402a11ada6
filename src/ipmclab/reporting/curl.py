"""What is said of a strip that curls by itself."""

from __future__ import annotations

import math
from typing import Final

from ipmclab.measurement.curl import Curl
from ipmclab.units import LENGTH, TIME, Quantity, significant

_DIGITS: Final = 2


def curl_in_words(found: Curl) -> str:
    """The rate of a curl and the verdict, in plain words.

    Examples
    --------
    >>> from ipmclab.measurement.curl import Curl
    >>> print(curl_in_words(Curl(5.6e-6, (5.2e-6, 6.0e-6), 0.0, 9, 40.0, 6.4e-5)).partition("; ")[0])
    the tip moves by 5.6 um/s (95 %: 5.2 to 6) where it is fastest, 0 s after the start
    """
    low, high = (f"{1e6 * rate:.{_DIGITS}g}" for rate in found.interval)
    moved = _read(abs(found.rate) * found.test, LENGTH, digits=_DIGITS)
    rate = (
        f"the tip moves by {1e6 * abs(found.rate):.{_DIGITS}g} um/s (95 %: {low} to {high}) where it is fastest, "
        f"{found.since:.3g} s after the start; {moved} in a test of {found.test:g} s, of which "
        f"{_read(found.allowed, LENGTH, digits=_DIGITS)} are allowed. "
    )
    if found.verdict == "yes":
        return rate + "Tests are possible in this air."
    shorter = (
        "" if not math.isfinite(found.longest_test) else f" than {_read(found.longest_test, TIME, digits=_DIGITS)}"
    )
    if found.verdict == "no":
        return (
            rate
            + f"Not in this air: test in a higher humidity, or make each test shorter{shorter} and hydrate between."
        )
    return rate + f"This record does not decide: record it longer, or make each test shorter{shorter}."


def _read(value: float, quantity: Quantity, *, digits: int) -> str:
    return f"{significant(quantity.to_display(value), digits)} {quantity.display_unit}"
