"""The joined system of an actuator as numbers, with their exact derivatives by parameters."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import System, assemble
from ipmclab.model.kinds import edition
from ipmclab.model.numerics.reduce import reduced, seen_states
from ipmclab.model.ports import OUTPUT_PORTS, left_at_rest
from ipmclab.model.program import Program
from ipmclab.model.structure import Structure
from ipmclab.model.terms import REFUSED, Terms, is_zero

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

_COMPLEX_STEP: Final = 1e-100
"""So small that its square vanishes compared with any number here: Im f(p + ih)/h is then f'(p) to the last digit."""


class Numbers(NamedTuple):
    """A system that is driven by a voltage v and by laws w; or its derivatives, with an axis of columns behind.

    With x the state, y the outputs and p what the laws read, ``x' = a x + drive (v, w)``, ``y = outputs (v, x, w)`` and
    ``p = ports (v, x, w)``.

    Parameters
    ----------
    a, drive, outputs, ports : float arrays
        Shapes (n, n), (n, 1 + n_laws), (n_outputs, 1 + n + n_laws), (n_laws, 1 + n + n_laws).
    coefficients : float array, shape (n_laws, 3)
        Of the laws (``blocks.Law``).
    """

    a: FloatArray
    drive: FloatArray
    outputs: FloatArray
    ports: FloatArray
    coefficients: FloatArray


@dataclass(frozen=True, eq=False)
class Joined:
    """A system that some outputs see, at some parameters.

    Parameters
    ----------
    at : Numbers
    by : Numbers
        Derivatives, a column for each parameter, and columns of zeros behind.
    forms : int array, shape (n_laws,)
    states : tuple of str
        Names of all states of the actuator.
    seen : int array
        The places of those that the system has.
    count : int
        How many parameters.
    by_states, by_delay : int
        Columns for derivatives by the initial states that are seen, and by the delay, behind those of the parameters.
    """

    at: Numbers
    by: Numbers
    forms: IndexArray
    states: tuple[str, ...]
    seen: IndexArray
    count: int
    by_states: int
    by_delay: int

    @property
    def columns(self) -> int:
        """How many derivatives there are."""
        return self.count + self.by_states + self.by_delay

    @property
    def width(self) -> int:
        """The columns, filled up."""
        return int(self.by.a.shape[-1])

    @classmethod
    def of(cls, actuator: Actuator, names: Sequence[str], chosen: Sequence[int], asked: Collection[str]) -> Joined:
        """The system of an actuator.

        Parameters
        ----------
        actuator : Actuator
        names : sequence of str
            The parameters of the derivatives.
        chosen : sequence of int
            Places of the outputs in ``ports.OUTPUTS``.
        asked : collection of "states" and "delay"
            What more columns are for.

        Raises
        ------
        InputError
            The actuator has no such parameter.
        """
        actuator.values(names)
        asking = _asking(
            actuator.structure, tuple(names), tuple(chosen), "states" in asked, "delay" in asked, edition()
        )
        return asking.at(actuator) if asking is not None else _by_steps(actuator, names, chosen, asked)


@dataclass(frozen=True, eq=False)
class _Asking:
    """What is asked of a structure, as a program.

    Parameters
    ----------
    program : Program
    moved : int array, shape (n_parameters,)
        Their places in the program; negative where nothing depends on one.
    cuts : tuple of pair of slice and shape
        Which entries each matrix has.
    width : int
    like : Joined
        At no parameters.
    """

    program: Program
    moved: IndexArray
    cuts: tuple[tuple[slice, tuple[int, ...]], ...]
    width: int
    like: Joined

    def at(self, actuator: Actuator) -> Joined:
        """The system of an actuator."""
        given = actuator.parameter_values
        values = np.array([given[name] for name in self.program.names], dtype=np.float64)
        entries, slopes = self.program.run(values, self.moved, self.width)
        at = Numbers(*(entries[cut].reshape(shape) for cut, shape in self.cuts))
        by = Numbers(*(slopes[cut].reshape(*shape, self.width) for cut, shape in self.cuts))
        return replace(self.like, at=at, by=by)


@lru_cache(maxsize=256)
def _asking(
    structure: Structure, names: tuple[str, ...], chosen: tuple[int, ...], states: bool, delay: bool, _edition: int
) -> _Asking | None:
    """None where a stage takes no terms."""
    from ipmclab.model.numerics.vectors_loop import filled

    terms = Terms(structure.declarations)
    try:
        system = _joined(structure, terms)
        seen = seen_states([_pattern(system)], chosen)
        numbers, forms = _numbers(reduced(system, chosen, seen))
        program = Program.of(entry for matrix in numbers for entry in matrix.flat)
    except REFUSED:
        return None
    ends = accumulate(matrix.size for matrix in numbers)
    cuts = tuple((slice(end - matrix.size, end), matrix.shape) for end, matrix in zip(ends, numbers, strict=True))
    places = {name: place for place, name in enumerate(program.names)}
    moved = np.array([places.get(name, -1) for name in names], dtype=np.int64)
    like = Joined(numbers, numbers, forms, system.states, seen, len(names), len(seen) if states else 0, int(delay))
    return _Asking(program, moved, cuts, filled(like.columns), like)


def _joined(structure: Structure, values: Mapping[str, Any]) -> System:
    return assemble(
        structure.blocks(values),
        inputs=("voltage",),
        outputs=OUTPUT_PORTS,
        laws=structure.laws(values),
        at_rest=left_at_rest(["voltage"]),
    )


def _pattern(system: System) -> System:
    """The system with ones in place of what is not 0."""

    def of(matrix: npt.NDArray[Any]) -> FloatArray:
        return np.array([float(not is_zero(entry)) for entry in matrix.flat]).reshape(matrix.shape)

    ports = system.law_ports
    return replace(
        system, a=of(system.a), c=of(system.c), law_ports=None if ports is None else replace(ports, c=of(ports.c))
    )


def _numbers(system: System) -> tuple[Numbers, IndexArray]:
    """The matrices of a system, of numbers or terms, and the forms of its laws."""
    ports, n = system.law_ports, len(system.states)
    read = np.concatenate([system.d, system.c], axis=-1)
    if ports is None:
        nothing = np.zeros((0, 1 + n)), np.zeros((0, 3))
        return Numbers(system.a, system.b, read, *nothing), np.zeros(0, dtype=np.int64)
    forms = np.array([law.form for law in ports.laws], dtype=np.int64)
    coefficients = np.array([law.coefficients for law in ports.laws])
    return Numbers(
        system.a,
        np.concatenate([system.b, ports.drive], axis=-1),
        np.concatenate([read, ports.reach], axis=-1),
        np.concatenate([ports.d, ports.c, ports.loop], axis=-1),
        coefficients,
    ), forms


def _by_steps(actuator: Actuator, names: Sequence[str], chosen: Sequence[int], asked: Collection[str]) -> Joined:
    """Of stages that take no terms: with derivatives by a complex step of each parameter."""
    from ipmclab.model.numerics.vectors_loop import filled

    values: dict[str, Any] = dict(actuator.parameter_values)
    system = actuator.system
    others = [actuator.assembled({**values, name: complex(actuator[name], _COMPLEX_STEP)}) for name in names]
    seen = seen_states([system, *others], chosen)
    (at, forms), *moved = (_numbers(reduced(one, chosen, seen)) for one in (system, *others))
    numbers = Numbers(*(np.ascontiguousarray(matrix, dtype=np.float64) for matrix in at))
    extra = len(seen) if "states" in asked else 0, int("delay" in asked)
    width = filled(len(names) + sum(extra))
    by = Numbers(*(np.zeros((*matrix.shape, width)) for matrix in numbers))
    for column, (other, _) in enumerate(moved):
        for slopes, matrix in zip(by, other, strict=True):
            slopes[..., column] = np.imag(matrix) / _COMPLEX_STEP
    return Joined(numbers, by, forms, system.states, seen, len(names), *extra)
