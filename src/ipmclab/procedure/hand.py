"""What was measured by hand, as it is written in a file: a number, a number and its uncertainty, or readings."""

from __future__ import annotations

import re
from typing import Any, Final

from ipmclab.consistency.known import ASSUMED
from ipmclab.errors import InputError, unknown_name
from ipmclab.measurement.uncertain import Uncertain, mean_of
from ipmclab.measurement.written import Written, scatter_of
from ipmclab.units import Quantity, parse_quantity

_KEYS: Final = ("value", "readings", "standard_uncertainty")
_MOST: Final = 100_000  # readings of a hand: more are a file that was given by mistake (convention)

# Standard uncertainties [SI] where nobody states one, and whether they are relative.
_ALSO_ASSUMED: Final[tuple[tuple[str, float, bool, str], ...]] = (
    ("spacing", 1e-4, False, "contacts that were placed by hand"),
    ("position", 5e-4, False, "a ruler at the edge of the clamp"),
    ("mass", 1e-6, False, "a balance that shows 1 mg"),
    *ASSUMED,
)


def taken(name: str, value: float) -> float:
    """The standard uncertainty that is taken where nobody states one [SI].

    Examples
    --------
    >>> taken("geometry.thickness", 0.245e-3)
    5e-06
    """
    size, relative = next((u, part) for pattern, u, part, _ in _ALSO_ASSUMED if re.fullmatch(pattern, name))
    return size * abs(value) if relative else size


def read_hand(
    raw: Any,
    quantity: Quantity,
    *,
    name: str,
    source: str,
    where: str,
    positive: bool = True,
    assume: bool = True,
) -> Uncertain:
    """Read a measured quantity.

    Parameters
    ----------
    raw : str, list of str, or table
        ``"25 mm"``; ``["112 mg", "113 mg"]``; ``{ value = "25 mm", standard_uncertainty = "0.2 mm" }``, with
        ``readings`` in place of ``value`` where there are several.
    quantity : Quantity
    name : str
        What it is, for the uncertainty that is taken where none is stated.
    source : str
        What the contribution is called.
    where : str
        The key in the file.
    positive : bool
        Whether it has to be above 0.
    assume : bool
        Whether a usual uncertainty is taken where none is stated; else there is none in addition to the scatter of
        readings.

    Raises
    ------
    InputError
        Another kind of value, an unknown key, a wrong unit, a number that cannot be.
    """
    stated: float | None = None
    if isinstance(raw, dict):
        for key in raw:
            if key not in _KEYS:
                raise unknown_name("key", key, _KEYS, where=f"{where}.{key}")
        if ("value" in raw) == ("readings" in raw):
            raise InputError(
                "it needs either a value or readings",
                code="missing-key",
                where=where,
                repair=f'write {{ value = "... {quantity.display_unit}", standard_uncertainty = "..." }}',
            )
        if "standard_uncertainty" in raw:
            place = f"{where}.standard_uncertainty"
            stated = _number(raw["standard_uncertainty"], quantity, place)
            if stated < 0:
                raise InputError(
                    f"{raw['standard_uncertainty']!r} is below 0",
                    code="out-of-range",
                    where=place,
                    repair="give one standard deviation",
                )
        raw, where = (raw["value"], f"{where}.value") if "value" in raw else (raw["readings"], f"{where}.readings")
    if isinstance(raw, list):
        if not 1 <= len(raw) <= _MOST:
            raise InputError(
                f"{len(raw)} readings", code="out-of-range", where=where, repair="give at least one reading"
            )
        values = [_number(one, quantity, f"{where}[{place}]") for place, one in enumerate(raw)]
    else:
        values = [_number(raw, quantity, where)]
    found = mean_of(values, scatter_of(source))
    if positive and not found.value > 0:
        raise InputError(
            f"{found.value:g} {quantity.unit} is not above 0",
            code="out-of-range",
            where=where,
            repair="give what was measured",
        )
    usual = taken(name, found.value) if assume else 0.0
    size = usual if stated is None else stated
    assumed = frozenset({source} if stated is None and size else ())
    parts = {**found.parts, source: size} if size else dict(found.parts)
    texts = tuple(raw) if isinstance(raw, list) else (raw,)
    return Uncertain(found.value, parts, assumed, {source: Written(where, texts, tuple(values))})


def _number(raw: Any, quantity: Quantity, where: str) -> float:
    if not isinstance(raw, str):
        raise InputError(
            f"{raw!r} is not a {quantity.name}",
            code="bad-value",
            where=where,
            repair=f'write it in quotes with its unit, such as "12.3 {quantity.display_unit}"',
        )
    return parse_quantity(raw, quantity, where=where)
