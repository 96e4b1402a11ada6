"""The fast path of a strip with one leak at its node: the numbers of ``law_modal_loop.law_modal``."""

from __future__ import annotations

import cmath
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import assemble
from ipmclab.model.blocks import Block
from ipmclab.model.numerics.dense import LONGEST
from ipmclab.model.numerics.modal import Modes, exponential_integrals, modes
from ipmclab.model.numerics.reduce import reduced, seen_states
from ipmclab.model.numerics.regular import Regular
from ipmclab.model.ports import OUTPUT_PORTS, left_at_rest
from ipmclab.model.stages.circuit import Circuit
from ipmclab.model.structure import Structure
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

JUMPS: Final = {"zero": 1, "zero-before": -1, "first": 0}


Loop = Callable[[FloatArray, FloatArray], None]
"""A function (voltage, outputs) that writes the four outputs at the rows of a voltage."""


def law_loop(structure: Structure, values: Mapping[str, float], period: float, hold: Hold) -> Loop | None:
    """The compiled loop for a strip with one leak at its node, from rest.

    Parameters
    ----------
    structure : Structure
    values : mapping of dotted name to float [SI]
    period : float [s]
    hold : "zero", "zero-before" or "first"

    Returns
    -------
    loop : callable or None
        None where another way must answer: another structure, poles that nearly meet, a period so long that it is
        divided.
    """
    if not goes_by_modes(structure, period):
        return None
    linear, plain = without_leak(structure)
    found = modes(plain.blocks(values), external="voltage", outputs=OUTPUT_PORTS, at_rest=left_at_rest(["voltage"]))
    numbers = None if found is None else modal_numbers(found, period)
    if numbers is None:
        return None
    (law,) = structure.laws(values)
    series = Circuit(structure.branches).elements(values).series.real
    circuit = np.array([*numbers.circuit, series, numbers.weights[1, 6]])
    k = np.array(law.coefficients, dtype=np.float64)
    jumps, form = JUMPS[hold], law.form
    motion = None if linear == plain else _motion(linear.blocks(values), period)

    def loop(voltage: FloatArray, outputs: FloatArray) -> None:
        from ipmclab.model.numerics.law_modal_loop import law_modal

        fronts = np.empty((3, 0 if motion is None else len(voltage)))
        law_modal(voltage, jumps, circuit, numbers.mechanical, numbers.weights, form, k, outputs, fronts)
        if motion is not None:
            motion.along(fronts[0, 1:], fronts[1, 1:], fronts[2], outputs[2:])

    return loop


def goes_by_modes(structure: Structure, period: float) -> bool:
    """Whether a strip has one leak at its node, and rows [s] between which what leaks goes in a straight line."""
    lumped = bool(structure.leak) and not structure.slow_leak and replace(structure, leak="").is_lumped
    return lumped and period <= LONGEST * (1 + 1e-6)


def without_leak(structure: Structure) -> tuple[Structure, Structure]:
    """A strip without its leak, which is a lower voltage at the front of the electrodes, and one that moves plainly.

    What hangs on the node does not load it: of the motion the loop over the modes computes the plain one, and a richer
    one comes after.
    """
    linear = replace(structure, leak="", hydration=False, coating=False, environment=())
    return linear, Structure(structure.branches, laser=structure.laser)


def _motion(blocks: Sequence[Block], period: float) -> Regular:
    """Displacement and force of a linear strip, driven by the voltage at the front of its electrodes."""
    system = assemble(blocks, inputs=("voltage",), outputs=OUTPUT_PORTS[2:], at_rest=left_at_rest(["voltage"]))
    every = range(len(system.outputs))
    return Regular(reduced(system, every, seen_states([system], every)), period)


@dataclass(frozen=True, eq=False)
class ModalNumbers:
    """In the layout that ``law_modal_loop.law_modal`` documents; ``circuit`` without its last two."""

    circuit: list[float]
    mechanical: FloatArray
    weights: FloatArray


def modal_numbers(found: Modes, period: float) -> ModalNumbers | None:
    """Transitions of the modes and weights of the outputs; None when these modes do not fit the loop."""
    if len(found.poles) != 3 or any(pole.imag for pole in found.poles[0]) or any(len(s) > 2 for s in found.poles):
        return None
    weights = np.zeros((len(found.outputs), 7))
    weights[:, 6] = [output.direct.real for output in found.outputs]
    moves: list[list[float]] = []
    for place, section in enumerate(found.poles):
        own = [_move(pole, period) for pole in section]
        if any(pole.imag for pole in section):
            (a, begin, end), first = own[0], section[0]
            moves.append([a.real, -a.imag, a.imag, a.real, begin.real, begin.imag, end.real, end.imag])
            for row, output in enumerate(found.outputs):
                residue = output.residues.get(first, 0j)
                weights[row, 2 * place : 2 * place + 2] = 2.0 * residue.real, -2.0 * residue.imag
        else:
            own += [(0j, 0j, 0j)] * (2 - len(own))
            (a1, begin1, end1), (a2, begin2, end2) = own
            moves.append([x.real for x in (a1, 0j, 0j, a2, begin1, begin2, end1, end2)])
            for row, output in enumerate(found.outputs):
                for index, pole in enumerate(section):
                    weights[row, 2 * place + index] = output.residues.get(pole, 0j).real
    if np.any(weights[:2, 2:6]) or np.any(weights[3, 4:6]):
        return None
    a1r, _, _, a2r, *gains = moves[0]
    circuit = [a1r, gains[0], gains[2], a2r, gains[1], gains[3]]
    return ModalNumbers(circuit, np.array(moves[1:]), weights)


def _move(pole: complex, period: float) -> tuple[complex, complex, complex]:
    """One pole over a period: ``x+ = a x + begin e0 + end e1`` for an input that goes from e0 to e1."""
    first, second = exponential_integrals(pole * period)
    return cmath.exp(pole * period), period * (first - second), period * second
