"""What the outputs of an actuator read at the rows of a record, by the fastest way that its structure allows."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import System
from ipmclab.model.blocks import Block
from ipmclab.model.kinds import edition
from ipmclab.model.numerics.cascade import Wiring, entries_of
from ipmclab.model.numerics.dense import Dense, parts
from ipmclab.model.numerics.law_modal import Loop, law_loop
from ipmclab.model.numerics.reduce import reduced, seen_states
from ipmclab.model.numerics.regular import Regular
from ipmclab.model.numerics.timeline import Timeline, divided, is_regular, side_by_side, timeline
from ipmclab.model.ports import INPUTS, OUTPUT_PORTS, OUTPUTS, choose_outputs, left_at_rest
from ipmclab.model.request import check_hold, checked_force, checked_record, state_vector
from ipmclab.model.stages.laser import read_far
from ipmclab.model.structure import Structure
from ipmclab.model.written_out import WrittenOut, written_out
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

EVERY: Final = tuple(range(len(OUTPUTS)))
"""The places of all outputs."""

_SHORT_RECORD: Final = 5000
_has_simulated = False


def simulate_outputs(
    actuator: Actuator,
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    hold: Hold,
    *,
    outputs: Sequence[str] | None = None,
    initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    delay: float = 0.0,
    external_force: npt.ArrayLike | None = None,
) -> FloatArray:
    """What the outputs read at the rows of a record.

    Parameters
    ----------
    actuator : Actuator
    time : float array, shape (n_time,) [s]
        Increasing; need not be regular.
    voltage : float array, shape (n_time,) [V]
    hold : "zero", "zero-before" or "first"
    outputs : sequence of str, optional
        Some of ``OUTPUTS``, in the wanted order; all where it is left out.
    initial_state : mapping of state name to float, or float array of shape (n_states,), optional
        The state at row 0. None: at rest and at 0 V until the first edge.
    delay : float [s]
        By how much the voltage reaches the strip later than its rows say; negative for earlier.
        With a given state, the voltage before the first edge is the first voltage.
    external_force : float array, shape (n_time,) [N], optional
        On the strip at its sensing point, positive as the displacement; between rows it does as the voltage does.

    Returns
    -------
    values : float array, shape (n_outputs, n_time) [SI]

    Raises
    ------
    InputError
        An unknown output or state, a hold that says nothing, time that does not increase, unequal
        lengths, a voltage that is not finite.

    Where a laser has lost the strip, its reading continues in a straight line here, for a search to follow;
    ``simulate`` gives none (NaN).

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> current = simulate_outputs(load_actuator("friend-2"), [0, 0.02], [1, 1], "zero", outputs=["current"])
    >>> round(float(current[0, 0]), 6)
    0.060348
    """
    check_hold(hold)
    times, volts = checked_record(time, voltage)
    chosen = choose_outputs(outputs)
    if external_force is None and initial_state is None and delay == 0.0 and is_regular(times):
        period = (times[-1] - times[0]) / (len(times) - 1)
        regular = regular_outputs(actuator, volts, period, hold, chosen)
        if regular is not None:
            return regular
    from_rest = initial_state is None
    lines = [timeline(times, volts, hold, delay=delay, from_rest=from_rest)]
    if external_force is not None:
        if actuator.structure.laser:
            raise InputError(
                "a laser's reading is that of a strip that bends as an arc: a force at one point bends it otherwise",
                code="force-and-laser",
                where="external_force",
                repair="leave the force out, or take an actuator without laser",
            )
        force = checked_force(external_force, len(times))
        lines.append(timeline(times, force, hold, delay=delay, from_rest=from_rest))
    system = actuator.driven_by(INPUTS[: len(lines)])
    state = state_vector(actuator.state_names, initial_state)
    seen = seen_states([system], chosen)
    values = np.empty((len(chosen), len(times)))
    run_dense(reduced(system, chosen, seen), lines, state[seen], values)
    read_far(values, [OUTPUTS[place] for place in chosen], actuator.parameter_values)
    return values


def regular_outputs(
    actuator: Actuator, volts: FloatArray, period: float, hold: Hold, chosen: Sequence[int] = EVERY
) -> FloatArray | None:
    """Some outputs at rows of one period [s], from rest; None where a period must be divided."""
    values = np.empty((len(OUTPUTS), len(volts)))
    if _by_modes(actuator, volts, period, hold, values):
        values = values if tuple(chosen) == EVERY else values[list(chosen)]
    else:
        dense = _regular(actuator, period, chosen)
        if dense is None:
            return None
        values = np.empty((len(chosen), len(volts)))
        dense.write(volts, hold, values)
    read_far(values, [OUTPUTS[place] for place in chosen], actuator.parameter_values)
    return values


def _by_modes(actuator: Actuator, volts: FloatArray, period: float, hold: Hold, every: FloatArray) -> bool:
    """Write all outputs from rest by the modes of the actuator; false where another way must answer."""
    coefficients = modal_coefficients(actuator, period, hold)
    if coefficients is not None:
        _modal_loop(len(volts))(volts, coefficients, every)
        return True
    with_law = leaking_loop(actuator, period, hold)
    if with_law is not None:
        with_law(volts, every)
        return True
    found = modal_sections(actuator, period, hold)
    if found is not None:
        from ipmclab.model.numerics import kernels

        kernels.modal_sections(volts, *found, every)
    return found is not None


def _modal_loop(rows: int) -> Callable[[FloatArray, FloatArray, FloatArray], None]:
    """The compiled loop, or the same loop as plain Python for the first short record of a process.

    Loading the compiler takes most of a second, the plain loop some 10 ms for a short record; the digits
    are the same. Whoever simulates again gets the compiled one.
    """
    global _has_simulated  # a process has one first time
    first_time, _has_simulated = not _has_simulated, True
    if first_time and rows <= _SHORT_RECORD and "ipmclab.model.numerics.kernels" not in sys.modules:
        from ipmclab.model.numerics.modal_loop import modal

        return np.errstate(over="ignore", invalid="ignore")(modal)  # the result is looked at
    from ipmclab.model.numerics.kernels import modal as compiled

    return compiled


def modal_coefficients(actuator: Actuator, period: float, hold: Hold) -> FloatArray | None:
    """The numbers of the modal recursion, kept with the actuator; None where another way must answer."""

    def made() -> FloatArray | None:
        wiring, entries = _wired(actuator)
        return None if wiring is None else wiring.coefficients(entries, period, hold)

    return actuator.keep(("modal", period, hold), made)


def modal_sections(actuator: Actuator, period: float, hold: Hold) -> tuple[FloatArray, int] | None:
    """The same for a cascade of any number of sections, and that number; kept with the actuator."""

    def made() -> tuple[FloatArray, int] | None:
        wiring, entries = _wired(actuator)
        found = None if wiring is None else wiring.sections_over(entries, period, hold)
        return None if wiring is None or found is None else (found, wiring.sections)

    return actuator.keep(("sections", period, hold), made)


def _wired(actuator: Actuator) -> tuple[Wiring | None, FloatArray]:
    """Which block of an actuator drives which, and their entries; None where they are no cascade of modes."""
    if actuator.structure.leak:  # a law at a port has no modes
        return None, np.zeros(0)
    written, wiring = set_up(actuator.structure)
    if written is not None:
        return wiring, written.entries(actuator.parameter_values)
    blocks = actuator.blocks()
    return _wiring(blocks), entries_of(blocks)


def set_up(structure: Structure) -> tuple[WrittenOut | None, Wiring | None]:
    """The blocks of a structure written out, and which of them drives which."""
    return _set_up(structure, edition())


@lru_cache(maxsize=256)
def _set_up(structure: Structure, _edition: int) -> tuple[WrittenOut | None, Wiring | None]:
    written = written_out(structure)
    return written, None if written is None else _wiring(written.blocks)


def _wiring(blocks: Sequence[Block]) -> Wiring | None:
    return Wiring.of(blocks, external="voltage", outputs=OUTPUT_PORTS, at_rest=left_at_rest(["voltage"]))


def leaking_loop(actuator: Actuator, period: float, hold: Hold) -> Loop | None:
    """The loop of a strip with one leak at its node, kept with the actuator; None where another way must answer."""
    if not actuator.structure.leak:
        return None
    values = actuator.parameter_values
    return actuator.keep(("leaking", period, hold), lambda: law_loop(actuator.structure, values, period, hold))


def _regular(actuator: Actuator, period: float, chosen: Sequence[int]) -> Regular | None:
    """The path without poles over rows of one period, kept with the actuator; None where a period must be divided."""
    system = actuator.system
    if parts(system, np.array([period]))[0] > 1:
        return None

    def made() -> Regular:
        seen = seen_states([system], chosen)
        return Regular(reduced(system, chosen, seen), period)

    return actuator.keep(("regular", period, *chosen), made)


def run_dense(system: System, lines: Sequence[Timeline], state: FloatArray, values: FloatArray) -> None:
    """Write the outputs over the time lines of all inputs into ``values``, by the path that does not need poles.

    The state is overwritten: on return it is that at the end.
    """
    lines = [divided(line, parts(system, line.durations)) for line in lines]
    Dense.of(system, lines[0].durations).run(side_by_side(lines), state, values)
