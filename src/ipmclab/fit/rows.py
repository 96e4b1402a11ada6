"""The numbers of a fit as people read them: parameters and known quantities, one row each."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from ipmclab.units import CHANNELS, TIME, Quantity, significant

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit, FittedParameter

NOT_DETERMINED: Final = "not determined"

KNOWN: Final = "known from these readings"
"""The title of the quantities that are known where parameters are not determined."""

_DRIFTS: Final = {
    "current": Quantity("drift of the current", "A/s", "uA/s"),
    "displacement": Quantity("drift of the displacement", "m/s", "um/s"),
    "force": Quantity("drift of the force", "N/s", "uN/s"),
}


@dataclass(frozen=True)
class Row:
    """One number of a table, as people read it.

    Parameters
    ----------
    name, value, interval, unit : str
    remark : str
        That it is at its bound, what was known beforehand, or on which fixed value it leans.
    determined : bool
    """

    name: str
    value: str
    interval: str
    unit: str
    remark: str = ""
    determined: bool = True


def parameter_rows(fit: Fit) -> tuple[Row, ...]:
    """The free parameters, in the units that people read."""
    rows = []
    for name, one in fit.parameters.items():
        row = _row(name, one.value, one.interval, quantity_of(fit, name), one.unit)
        remark = "at its bound" if one.at_bound else prior_in_words(one)
        value = row.value if one.determined else NOT_DETERMINED
        rows.append(Row(row.name, value, row.interval, row.unit, remark, one.determined))
    return tuple(rows)


def prior_in_words(one: FittedParameter) -> str:
    """That something was known of a parameter beforehand, and who knew it; empty where nothing was."""
    if one.prior is None:
        return ""
    return "with the literature's prior" if one.prior_of_literature else "with its prior"


def quantity_of(fit: Fit, name: str) -> Quantity | None:
    """What a parameter of a fit is: of the actuator, shared or of one run, or of an observation."""
    base = name.partition("[")[0]
    known = fit.actuator.parameters()
    if base in known:
        return known[base].quantity
    if base == "observation.delay":
        return TIME
    output = base.rsplit(".", 1)[-1]
    return (CHANNELS if base.startswith("observation.offset") else _DRIFTS).get(output)


def known_rows(fit: Fit) -> tuple[Row, ...]:
    """The quantities that the readings determine, in the units that people read."""
    rows = []
    for one in fit.known:
        row = _row(one.words, one.value, one.interval, one.quantity, one.quantity.unit)
        fixed = one.leans[0].rpartition(".")[2].replace("_", " ") if one.leans else ""
        rows.append(replace(row, remark=f"if {fixed} is exact" if fixed else ""))
    return tuple(rows)


def _row(name: str, value: float, interval: tuple[float, float], quantity: Quantity | None, unit: str) -> Row:
    shown = quantity.to_display if quantity is not None else float
    low, high = shown(interval[0]), shown(interval[1])
    is_open = math.isinf(low) or math.isinf(high)
    digits = 3 if is_open else digits_of(shown(value), high - low)
    return Row(
        name,
        significant(shown(value), digits),
        interval_in_words(low, high, digits),
        quantity.display_unit if quantity is not None else unit,
    )


def digits_of(value: float, width: float) -> int:
    """Significant digits of a value that show two digits of the width of its interval."""
    if not (0.0 < width < math.inf) or value == 0.0 or not math.isfinite(value):
        return 4
    # Not of the ratio, which may be beyond all numbers.
    return min(max(2 + math.ceil(math.log10(abs(value)) - math.log10(width)), 3), 12)


def interval_in_words(low: float, high: float, digits: int) -> str:
    """An interval, an open one in words.

    Examples
    --------
    >>> interval_in_words(612.0, 880.4, 3), interval_in_words(0.0, 2.34, 3), interval_in_words(287.3, math.inf, 3)
    ('612 to 880', 'below 2.34', 'above 287')
    >>> interval_in_words(0.0, math.inf, 3), interval_in_words(-math.inf, math.inf, 3)
    ('any positive value', 'any value')
    """
    open_below = low == 0.0 or math.isinf(low)
    if open_below and math.isinf(high):
        return "any positive value" if low == 0.0 else "any value"
    if math.isinf(high):
        return f"above {significant(low, digits)}"
    if open_below:
        return f"below {significant(high, digits)}"
    return f"{significant(low, digits)} to {significant(high, digits)}"


def size_in_words(size: float, output: str) -> str:
    """A residual [SI] in the unit that people read.

    Examples
    --------
    >>> size_in_words(1.97e-3, "current")
    '1.97 mA'
    """
    quantity = CHANNELS[output]
    return f"{significant(quantity.to_display(size), 3)} {quantity.display_unit}"


def listed(names: Iterable[str]) -> str:
    """Names as a text has them; empty where there are none.

    Examples
    --------
    >>> listed(["a"]), listed(["a", "b", "c"])
    ('a', 'a, b and c')
    """
    *most, last = list(names) or [""]
    return f"{', '.join(most)} and {last}" if most else last
