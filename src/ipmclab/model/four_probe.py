"""Four probes on a sheet: from the resistance that they read to that of a square."""

from __future__ import annotations

import math
from typing import Final, Literal

from ipmclab.errors import InputError

Contacts = Literal["line", "points"]
"""``line``: contacts across the whole width, the outer two carry the current. ``points``: four in a row, equally far
apart, along the middle of the strip and midway between its ends."""

_TERMS: Final = 1000
_FAR: Final = 50.0
_NEGLIGIBLE: Final = 1e-16


def point_factor(spacing: float, width: float, length: float = math.inf) -> float:
    """Sheet resistance over V/I, for four points in a row on a rectangle (Smits, Bell Syst. Tech. J. 37, 711, 1958).

    The current cannot leave the edges: every contact has images beyond them, in rows at multiples of the width and the
    length. The sum over a row is closed; on an infinite strip all that is left is pi/ln(2 cosh(pi s/w)), and on an
    infinite sheet pi/ln 2 = 4.532.

    Parameters
    ----------
    spacing : float [m]
        From one contact to the next.
    width, length : float [m]
        Of the rectangle, across and along the row.

    Raises
    ------
    InputError
        Contacts that do not lie on the rectangle.

    Examples
    --------
    >>> round(point_factor(1e-3, 1e6), 4), round(point_factor(1e-3, 2e-3, 4e-3), 4)
    (4.5324, 1.9454)
    """
    if not (spacing > 0.0 and width > 0.0 and length >= 3.0 * spacing):
        raise InputError(
            f"four contacts {1e3 * spacing:g} mm apart do not lie on a sheet of {1e3 * length:g} mm by "
            f"{1e3 * width:g} mm",
            code="out-of-range",
            where="spacing",
            repair="give the distance from one contact to the next; the outer two are three times as far",
        )
    step = math.pi * spacing / width
    total = step + math.log1p(math.exp(-2.0 * step))
    for m in range(1, _TERMS):
        ends = 2.0 * math.pi * m / width
        added = math.exp(-ends * (length - 2.0 * spacing)) / m if math.isfinite(length) else 0.0
        if added < _NEGLIGIBLE:
            break
        total += added * math.expm1(-6.0 * m * step) * math.expm1(-2.0 * m * step) / (1.0 + math.exp(-ends * length))
    return math.pi / total


def sheet_factor(contacts: Contacts, spacing: float, width: float, length: float = math.inf) -> float:
    """Sheet resistance [ohm/sq] over the resistance [ohm] that the probes read.

    Lines across the strip see width over spacing of a square's conductance, R_s = R w/d; points as ``point_factor``.

    Examples
    --------
    >>> sheet_factor("line", 10e-3, 5e-3)
    0.5
    """
    return width / spacing if contacts == "line" else point_factor(spacing, width, length)


def one_face(spacing: float, outer: float, length: float, transfer: float) -> float:
    """What lines on one face of a strip read, as a part of what they would read if the other face carried nothing.

    Current crosses the membrane to the other face, and back. With the resistance r per length of each face and the
    conductance g per length between them the difference of their voltages obeys u'' = u/lambda^2, lambda^2 = 1/(2 r g);
    no current leaves the ends of the strip.

    Parameters
    ----------
    spacing, outer : float [m]
        Between the inner, and between the outer contacts, in the middle of the strip.
    length : float [m]
        Of the strip.
    transfer : float [m]
        lambda, over which the current crosses: sqrt(rho_dc h/(2 R_s)).

    Examples
    --------
    >>> round(one_face(10e-3, 20e-3, 30e-3, 63e-3), 4), round(one_face(10e-3, 20e-3, 30e-3, 1e-4), 4)
    (0.9882, 0.5)
    """
    reach = 0.5 / transfer
    if reach * length > _FAR:  # the hyperbolic functions of a long strip overflow
        left = math.exp(-reach * (outer - spacing)) / (2.0 * reach * spacing)
    else:
        ends = math.cosh(reach * (length - outer)) / math.cosh(reach * length)
        left = math.sinh(reach * spacing) / (reach * spacing) * ends
    return 0.5 * (1.0 + left)
