"""The numbers of the modal loop by way of partial fractions, pole by pole, in complex numbers.

The state x of one pole p moves over a period T by ``x+ = a x + b0 u + b1 u+`` with a = exp(p T). With
``z = (x - b1 u)/(b0 + a b1)`` this is ``z+ = a z + u``.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass
from typing import Final, NamedTuple

from ipmclab.model.numerics.modal import SECTIONS, Modes, exponential_integrals
from ipmclab.run import Hold


@dataclass(frozen=True)
class _Mode:
    """One pole over a period: ``z+ = a z + u``, ``x = gain z + ahead u``, and z at row 0 per volt there."""

    a: complex
    gain: complex
    ahead: complex
    start: complex


_NOBODY: Final = _Mode(0j, 0j, 0j, 0j)
"""Fills up a section that has one pole."""


def _mode(pole: complex, period: float, hold: Hold) -> _Mode | None:
    """One pole for one hold, from rest; None where it vanishes."""
    first, second = exponential_integrals(pole * period)
    a = cmath.exp(pole * period)
    if hold == "zero":
        return _Mode(a, period * first, 0j, 0j)
    if hold == "zero-before":
        if abs(a) < 1e-100:  # gone within a period: it cannot be carried in this form
            return None
        return _Mode(a, a * period * first, period * first, -1.0 / a)
    if abs(first) < 1e-3:  # an undamped mode that turns a whole number of times in a period
        return None
    return _Mode(a, period * first**2, period * second, -second / first**2)


class Recursion(NamedTuple):
    """The six modes over a period: how they move, what each output is of them and of the voltage, and their start.

    ``numbers`` are a1, a2, and p, q, s of both pairs; ``weights`` has six entries for each output, ``direct`` one;
    ``starts`` are the modes at row 0 for 1 V there (see ``kernels.modal``).
    """

    numbers: list[float]
    weights: list[list[float]]
    direct: list[float]
    starts: list[float]


def recursion(modes: Modes, period: float, hold: Hold) -> Recursion | None:
    """The modes over a period, for any outputs; None when these modes do not fit the recursion."""
    if len(modes.poles) != SECTIONS or any(pole.imag for pole in modes.poles[0]):
        return None
    numbers: list[float] = []
    starts: list[float] = []
    weights: list[list[float]] = [[] for _ in modes.outputs]
    directs = [output.direct for output in modes.outputs]
    for place, section in enumerate(modes.poles):
        own: list[_Mode] = []
        gains: list[list[complex]] = [[] for _ in modes.outputs]  # of both modes, for each output
        for pole in sorted(section, key=abs):  # slow first: a chain must not carry what is gone within a period
            mode = _mode(pole, period, hold)
            if mode is None:
                return None
            own.append(mode)
            for index, output in enumerate(modes.outputs):
                residue = output.residues.get(pole, 0j)
                gains[index].append(residue * mode.gain)
                directs[index] += residue * mode.ahead
        own += [_NOBODY] * (2 - len(own))
        for of_output in gains:
            of_output += [0j] * (2 - len(of_output))
        (one, other), a1, a2 = own, own[0].a, own[1].a
        apart = a1.imag if a1.imag else (a2 - a1).real
        if place == 0:
            numbers += [a1.real, a2.real]
            starts += [one.start.real, other.start.real]
            combined = [[w1.real, w2.real] for w1, w2 in gains]
        elif hold != "zero" and abs(apart) < 1e-9:
            return None  # the chained modes at row 0 divide by it
        elif a1.imag:
            numbers += [a1.real, -(apart**2), a1.real]
            starts += [one.start.real, one.start.imag / apart if hold != "zero" else 0.0]
            combined = [[2.0 * w1.real, -2.0 * w1.imag * apart] for w1, _ in gains]
        else:
            numbers += [a1.real, 0.0, a2.real]
            starts += [one.start.real, (other.start - one.start).real / apart if hold != "zero" else 0.0]
            combined = [[(w1 + w2).real, w2.real * apart] for w1, w2 in gains]
        for row, pair in zip(weights, combined, strict=True):
            row += pair
    return Recursion(numbers, weights, [value.real for value in directs], starts)
