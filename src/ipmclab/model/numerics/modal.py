"""Poles and residues of a cascade in closed form."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.model.blocks import Block

NEARLY_MEET: Final = 1e-4
"""Relative gap between two poles below which residues are not used: they lose about 1e-15/gap."""

SECTIONS: Final = 3
"""Pairs of modes that the compiled recursion carries; see ``kernels.modal`` for who reads which."""


@dataclass(frozen=True)
class Fractions:
    """A transfer function as ``direct + sum of residue/(s - pole)``; complex poles come with their conjugates."""

    direct: complex
    residues: dict[complex, complex]

    def at(self, s: complex) -> complex:
        """Its value at one s."""
        total = self.direct
        for pole, residue in self.residues.items():
            total += residue / (s - pole)
        return total

    def __mul__(self, other: Fractions) -> Fractions:
        """One after the other; they share no pole."""
        if not self.residues:
            return Fractions(self.direct * other.direct, {p: r * self.direct for p, r in other.residues.items()})
        own = {pole: residue * other.at(pole) for pole, residue in self.residues.items()}
        others = {pole: residue * self.at(pole) for pole, residue in other.residues.items()}
        return Fractions(self.direct * other.direct, own | others)

    def __add__(self, other: Fractions) -> Fractions:
        """Side by side; equal poles are one pole."""
        residues = dict(self.residues)
        for pole, residue in other.residues.items():
            residues[pole] = residues.get(pole, 0.0) + residue
        return Fractions(self.direct + other.direct, residues)


def poles(block: Block) -> tuple[complex, ...] | None:
    """The poles of a block with at most two states, in closed form; None for a larger one."""
    if len(block.states) > 2:
        return None
    if len(block.states) < 2:
        return tuple(complex(value) for value in block.a.ravel())
    (a11, a12), (a21, a22) = block.a.tolist()
    middle, half_difference = 0.5 * (a11 + a22), 0.5 * (a11 - a22)
    root = cmath.sqrt(half_difference**2 + a12 * a21)
    if root.imag:
        return complex(middle, root.imag), complex(middle, -root.imag)
    # The larger root by addition, the smaller from the product, so that neither cancels.
    larger = middle - root.real if middle < 0 else middle + root.real
    return complex(larger), complex((a11 * a22 - a12 * a21) / larger) if larger else 0j


def _fractions(block: Block, own_poles: Sequence[complex], output: int, port: int) -> Fractions:
    """One transfer function of a block with at most two states, from ``c adj(s - a) b / det(s - a)``."""
    b, c = block.b[:, port].tolist(), block.c[output].tolist()
    direct = complex(block.d[output, port])
    if not any(b) or not any(c):
        return Fractions(direct, {})
    if len(own_poles) == 1:
        return Fractions(direct, {own_poles[0]: c[0] * b[0]})
    (a11, a12), (a21, a22) = block.a.tolist()
    linear = c[0] * b[0] + c[1] * b[1]
    constant = c[0] * (a12 * b[1] - a22 * b[0]) + c[1] * (a21 * b[0] - a11 * b[1])
    first, second = own_poles
    return Fractions(
        direct,
        {
            first: (linear * first + constant) / (first - second),
            second: (linear * second + constant) / (second - first),
        },
    )


@dataclass(frozen=True)
class Modes:
    """Poles, one tuple for each block of the cascade, and the fractions of each output."""

    poles: tuple[tuple[complex, ...], ...]
    outputs: tuple[Fractions, ...]


def modes(
    blocks: Sequence[Block], *, external: str, outputs: Sequence[str], at_rest: Sequence[str] = ()
) -> Modes | None:
    """Poles and residues of a cascade in closed form.

    Parameters
    ----------
    blocks : sequence of Block
        In the order of the cascade.
    external : str
        The port that is driven from outside.
    outputs : sequence of str
        The ports that are read.
    at_rest : sequence of str
        Input ports that stay at 0.

    Returns
    -------
    modes : Modes or None
        None where there is no closed form: a block of more than two states, a loop, or two
        poles that nearly meet.
    """
    sections: list[tuple[complex, ...]] = []
    signals = {external: Fractions(1.0, {})}
    for block in blocks:
        own_poles = poles(block)
        if own_poles is None or any(port not in signals and port not in at_rest for port in block.inputs):
            return None
        earlier = [pole for section in sections for pole in section]
        for index, pole in enumerate(own_poles):
            for other in (*earlier, *own_poles[:index]):
                if abs(pole - other) <= NEARLY_MEET * max(abs(pole), abs(other)):
                    return None
        sections.append(own_poles)
        made: dict[bytes, Fractions] = {}
        for row, name in enumerate(block.outputs):
            reads = block.c[row].tobytes() + block.d[row].tobytes()
            if reads in made:  # both drives are often one
                signals[name] = made[reads]
                continue
            total = Fractions(0.0, {})
            for column, port in enumerate(block.inputs):
                if port in at_rest:
                    continue
                transfer = _fractions(block, own_poles, row, column)
                if transfer.direct or transfer.residues:
                    total = total + transfer * signals[port]
            signals[name] = made[reads] = total
    return Modes(tuple(sections), tuple(signals[name] for name in outputs))


def exponential_integrals(z: complex) -> tuple[complex, complex]:
    """phi_1(z) = (exp(z) - 1)/z and phi_2(z) = (phi_1(z) - 1)/z, by series where they would cancel."""
    if abs(z) > 0.5:
        first = (cmath.exp(z) - 1.0) / z
        return first, (first - 1.0) / z
    second = term = 0.5 + 0j
    for k in range(3, 19):
        term *= z / k
        second += term
    return 1.0 + z * second, second
