"""Step 1: the sheet resistance by four probes (Friend, section 3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from ipmclab.errors import InputError
from ipmclab.measurement.uncertain import Uncertain, derived, exact, mean_of
from ipmclab.measurement.written import REPAIR, Written, scatter_of
from ipmclab.model.four_probe import Contacts, one_face, sheet_factor
from ipmclab.procedure.hand import taken
from ipmclab.procedure.step import CURES
from ipmclab.rig.channels import FourProbe

OFFSET: Final = "offset of the meter"
OTHER_FACE: Final = "current through the other face"
_RECTANGLE: Final = 3.0**-0.5
"""Standard deviation of what may lie anywhere within a limit, as a part of the limit."""


@dataclass(frozen=True)
class FourProbes:
    """Four contacts and what the meter read between the inner two.

    Parameters
    ----------
    contacts : "line" or "points"
    resistance : Uncertain [ohm]
        With the scatter of the readings, without the meter's offset.
    spacing : Uncertain [m]
        Between the inner contacts; of points, between neighbours.
    offset : float [ohm]
        By how much the meter may read wrong everywhere; counted as anywhere within.
    zero : Uncertain [ohm], optional
        What it read with the contacts shorted; then there is no other offset.
    outer : Uncertain [m], optional
        Between the outer of four lines, where what the other face carries is to be taken off.
    """

    contacts: Contacts
    resistance: Uncertain
    spacing: Uncertain
    offset: float = 0.05
    zero: Uncertain | None = None
    outer: Uncertain | None = None

    @classmethod
    def of_rig(cls, probe: FourProbe, readings: list[float], zero: float | None = None) -> FourProbes:
        """What a rig's own meter read; its spacing is known as well as contacts are placed by hand."""
        spread = taken("spacing", probe.spacing)
        texts = tuple(f"{one:.5g} ohm" for one in readings)
        return cls(
            probe.contacts,
            replace(
                mean_of(readings, scatter_of("meter")), written={"meter": Written("readings", texts, tuple(readings))}
            ),
            Uncertain(probe.spacing, {"spacing": spread}, frozenset({"spacing"})),
            probe.offset,
            None if zero is None else exact(zero),
        )


def sheet_resistance(probes: FourProbes, width: Uncertain, length: Uncertain) -> Uncertain:
    """The resistance of a square [ohm/sq]: R_s = R w/d for lines across the strip, ``point_factor`` for points.

    Parameters
    ----------
    probes : FourProbes
    width, length : Uncertain [m]
        Of the whole strip; of lines the length only says whether they lie on it.

    Raises
    ------
    InputError
        Readings that are not above the offset of the meter, contacts that do not lie on the strip.

    Examples
    --------
    >>> probes = FourProbes("line", exact(2.667), exact(10e-3))
    >>> found = sheet_resistance(probes, exact(5e-3), exact(30e-3))
    >>> round(found.value, 3), round(found.uncertainty / found.value, 4), list(found.shares)
    (1.333, 0.0108, ['offset of the meter'])
    """
    zero = Uncertain(0.0, {OFFSET: _RECTANGLE * probes.offset}) if probes.zero is None else probes.zero

    def square(read: float, off: float, spacing: float, across: float, along: float) -> float:
        return (read - off) * sheet_factor(probes.contacts, spacing, across, along)

    if probes.contacts == "line":
        _on_strip(probes, length)
        length = exact(math.inf)  # it does not matter, and neither does how well it is known
    found = derived(square, probes.resistance, zero, probes.spacing, width, length)
    if found.value <= 2.0 * found.uncertainty:
        raise _no_resistance(probes, zero, found)
    return found


def _no_resistance(probes: FourProbes, zero: Uncertain, found: Uncertain) -> InputError:
    """Why a sheet resistance is no larger than its uncertainty: one reading, the meter, or what else is not known."""
    source, share = next(iter(found.shares.items()), ("", 0.0))
    written = next((one for name, one in found.written.items() if source in (name, scatter_of(name))), None)
    slip = written.slip() if written is not None and source.startswith(scatter_of("")) else None
    if slip is None and probes.resistance.value - zero.value <= 2.0 * zero.uncertainty:
        return InputError(
            f"the meter reads {probes.resistance.value:.4g} ohm, no more than its own offset may be: "
            + (f"up to {probes.offset:g} ohm" if probes.zero is None else f"{zero.value:.4g} ohm"),
            code="no-sheet-resistance",
            where="sheet_resistance.resistance",
            repair="look whether something still joins the contacts, and whether they lie on the strip in their order",
        )
    text = f"the sheet resistance, {found.said('ohm/sq')}, is not known: {100.0 * share:.0f} % of its variance is the "
    if slip is not None:
        return InputError(f"{text}{source}: {slip[1]}", code="no-sheet-resistance", where=slip[0], repair=REPAIR)
    return InputError(
        f"{text}{source}" + (f": {written.said}" if written is not None else ""),
        code="no-sheet-resistance",
        where=written.where if written is not None else "sheet_resistance",
        repair=CURES.get(source, "read it again, more often; is every unit right?"),
    )


def _on_strip(probes: FourProbes, length: Uncertain) -> None:
    """Refuse lines that are farther apart than the strip is long, or outer ones within the inner ones."""
    inner = probes.spacing.value
    outer = inner if probes.outer is None else probes.outer.value
    if inner <= outer <= length.value:
        return
    text = f"{1e3 * inner:g} mm apart" + ("" if probes.outer is None else f", the outer two {1e3 * outer:g} mm,")
    raise InputError(
        f"four lines of which the inner two are {text} do not lie on a strip of {1e3 * length.value:g} mm",
        code="out-of-range",
        where="sheet_resistance.spacing" if inner > length.value else "sheet_resistance.outer_spacing",
        repair="give spacing between the inner two lines, outer_spacing between the outer two, both on the strip",
    )


def share_of_one_face(
    outer: float, spacing: float, length: float, thickness: float, square: float, resistivity: float
) -> float:
    """What four lines read, as a part of what they would read if the other face carried nothing.

    Parameters
    ----------
    outer, spacing, length, thickness : float [m]
    square : float [ohm/sq]
    resistivity : float [ohm m]
        rho_dc, at which the membrane lets current through.
    """
    return one_face(spacing, outer, length, math.sqrt(resistivity * thickness / (2.0 * square)))


def without_other_face(
    found: Uncertain, probes: FourProbes, length: Uncertain, thickness: Uncertain, resistivity: Uncertain
) -> Uncertain:
    """A sheet resistance with half of what the other face may carry taken off, and that half as a limit.

    The dc resistance is that of 1 V; at the few millivolts of the meter the membrane may let less through, or nothing.

    Parameters
    ----------
    found : Uncertain [ohm/sq]
        As if the other face carried nothing.
    probes : FourProbes
        With ``outer``.
    length, thickness : Uncertain [m]
    resistivity : Uncertain [ohm m]
    """
    assert probes.outer is not None

    def corrected(square: float, outer: float, spacing: float, along: float, h: float, rho: float) -> float:
        return square / (0.5 + 0.5 * share_of_one_face(outer, spacing, along, h, square, rho))

    middle = derived(corrected, found, probes.outer, probes.spacing, length, thickness, resistivity)
    limit = abs(middle.value - found.value)
    return replace(middle, parts={**middle.parts, OTHER_FACE: _RECTANGLE * limit})
