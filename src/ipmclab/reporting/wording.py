"""Numbers as people read them: with their unit, and as many digits as they deserve."""

from __future__ import annotations

import math
import re

from ipmclab.prediction.scores import fit_in_words
from ipmclab.units import Quantity

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NO_BREAK = "\u00a0"
"""A space that keeps a number and its unit on one line."""

_FINEST = 1e-6
"""Nobody reads more digits: an error below this part of the value is written by itself."""

NOT_DETERMINED = "not determined"


def plain(value: float | None, digits: int = 3, *, trim: bool = False) -> str:
    """A number with so many significant digits, without zeros at its end if wanted; a dash where there is none.

    Examples
    --------
    >>> plain(0.00123456), plain(1234.5), plain(6.79e-9), plain(None), plain(0.0), plain(0.25, 6, trim=True)
    ('0.00123', '1230', '6.79 × 10⁻⁹', '–', '0', '0.25')
    """
    if value is None or math.isnan(value):
        return "–"
    if value == 0.0 or math.isinf(value):
        return _minus(f"{value:.0f}").replace("inf", "∞")
    rounded = float(f"{value:.{digits - 1}e}")
    exponent = math.floor(math.log10(abs(rounded)))
    if exponent < -4 or exponent > 5:
        number = _fixed(rounded / 10.0**exponent, digits - 1)
        power = f" × 10{str(exponent).translate(_SUPERSCRIPTS)}"
    else:
        number, power = _fixed(rounded, max(digits - 1 - exponent, 0)), ""
    if trim and "." in number:
        number = number.rstrip("0").rstrip(".")
    return number + power


def power_of_ten(value: float) -> str:
    """The nearest power of ten.

    Examples
    --------
    >>> power_of_ten(0.001)
    '10⁻³'
    """
    return f"10{str(round(math.log10(value))).translate(_SUPERSCRIPTS)}"


def with_unit(value: float | None, quantity: Quantity, digits: int = 3, *, trim: bool = False) -> str:
    r"""An SI value in the display unit of its quantity.

    Examples
    --------
    >>> from ipmclab.units import CURRENT
    >>> with_unit(0.0603480, CURRENT, 4)
    '60.35\xa0mA'
    """
    if value is None or math.isnan(value):
        return plain(value)
    number = plain(quantity.to_display(value), digits, trim=trim)
    return f"{number}{NO_BREAK}{spelled_unit(quantity.display_unit)}".strip()


def with_error(value: float, error: float) -> str:
    """A value and its standard error, rounded to two digits of the error.

    Examples
    --------
    >>> with_error(0.35734, 0.0045), with_error(6.79123e-9, 1.24e-11), with_error(8.0, float("inf"))
    ('0.3573 ± 0.0045', '(6.791 ± 0.012) × 10⁻⁹', 'not determined')
    >>> with_error(43.4204, 1.3e-12)
    '43.4204 ± 1.3 × 10⁻¹²'
    """
    if error == 0.0:
        return plain(value, 6, trim=True)
    if not math.isfinite(error):
        return NOT_DETERMINED
    if error < _FINEST * abs(value):
        return f"{plain(value, 6)} ± {plain(error, 2)}"
    numbers, power = _common([value, error], _decimals(error, 2), max(abs(value), error))
    joined = " ± ".join(numbers)
    return f"({joined}){power}" if power else joined


def in_parts(text: str) -> str:
    """A cell of a narrow column, whose lines end only after a comma, and before what doubts a number.

    Examples
    --------
    >>> in_parts("7.6260 ± 0.0012 mA"), in_parts("99.5 % (95 % in the band)")
    ('7.6260 ±\xa00.0012\xa0mA', '99.5\xa0% (95\xa0%\xa0in\xa0the\xa0band)')
    """
    return re.sub(r"(?<!,) (?!±|\(|to )", NO_BREAK, text)


def interval(low: float, high: float) -> str:
    """An interval with three digits of its width; an open one in words.

    Examples
    --------
    >>> interval(0.34852, 0.36616), interval(0.0, 2.3456), interval(3.2, math.inf), interval(-math.inf, math.inf)
    ('0.3485 to 0.3662', 'below 2.35', 'above 3.20', 'any value')
    """
    closed_below, closed_above = math.isfinite(low) and low != 0.0, math.isfinite(high)
    if not closed_below and not closed_above:
        return "any positive value" if low == 0.0 else "any value"
    if not closed_below:
        return f"below {plain(high)}"
    if not closed_above:
        return f"above {plain(low)}"
    if high - low < _FINEST * max(abs(low), abs(high)):
        return plain(low, 6)
    numbers, power = _common([low, high], _decimals(high - low, 3), max(abs(low), abs(high)))
    joined = " to ".join(numbers)
    return f"({joined}){power}" if power else joined


def estimate(value: float, ends: tuple[float, float], digits: int = 3) -> str:
    """A value beside its interval: to two digits of the width, so that it reads as lying in it, and at least so many.

    Examples
    --------
    >>> estimate(16.5701, (16.567, 16.5726)), estimate(86.41, (78.9, 91.6)), estimate(86.41, (78.9, math.inf))
    ('16.5701', '86.4', '86.4')
    """
    width = ends[1] - ends[0]
    if value == 0.0 or not (math.isfinite(value) and 0.0 < width < math.inf):
        return plain(value, digits)
    width = max(width, _FINEST * abs(value))
    return plain(value, max(digits, math.floor(math.log10(abs(value))) + 1 + _decimals(width, 2)))


def spelled_unit(unit: str) -> str:
    """A unit as it is printed.

    Examples
    --------
    >>> spelled_unit("ohm m"), spelled_unit("1/s^2"), spelled_unit("kg/m^3"), spelled_unit("m/V/s")
    ('Ω m', '1/s²', 'kg/m³', 'm/(V s)')
    """
    if unit == "m/V/s":
        return "m/(V s)"
    if unit == "percent":
        return "%"
    return unit.replace("ohm", "Ω").replace("^2", "²").replace("^3", "³").replace("degC", "°C")


def _decimals(width: float, digits: int) -> int:
    """Decimal places that leave so many significant digits of a width."""
    rounded = float(f"{width:.{digits - 1}e}")
    return digits - 1 - math.floor(math.log10(abs(rounded)))


def _common(values: list[float], decimals: int, largest: float) -> tuple[list[str], str]:
    """Several numbers to the same decimal place, with a shared power of ten where they need one."""
    exponent = math.floor(math.log10(largest))
    if -4 <= exponent <= 5 and decimals >= 0:
        return [_fixed(value, decimals) for value in values], ""
    if -4 <= exponent <= 5:
        return [_fixed(round(value, decimals), 0) for value in values], ""
    scaled = [_fixed(value / 10.0**exponent, max(decimals + exponent, 0)) for value in values]
    return scaled, f" × 10{str(exponent).translate(_SUPERSCRIPTS)}"


def _fixed(value: float, decimals: int) -> str:
    return _minus(f"{value:.{decimals}f}")


def _minus(text: str) -> str:
    return text.replace("-", "−")


def percent(value: float | None) -> str:
    r"""A fit in the words of ``fit_in_words``, as typography has them; a dash where there is none.

    Examples
    --------
    >>> percent(98.7654), percent(-3.21), percent(99.9812), percent(None)
    ('98.8\xa0%', '−3.2\xa0%', '99.98\xa0%', '–')
    """
    if value is None or not math.isfinite(value):
        return "–"
    return _minus(fit_in_words(value)).replace(" ", NO_BREAK)
