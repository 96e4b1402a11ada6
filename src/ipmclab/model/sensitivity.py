"""Outputs at the rows of a record, and their exact derivatives: what identification needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator, choose_outputs, state_vector
from ipmclab.model.discretise import transitions
from ipmclab.model.simulate import check_hold, checked_voltage, modal_coefficients
from ipmclab.model.timeline import Timeline, timeline
from ipmclab.run import Hold, check_time

FloatArray = npt.NDArray[np.float64]

_COMPLEX_STEP: Final = 1e-100
"""So small that its square vanishes beside any number here: Im f(p + ih)/h is then f'(p) to the last digit."""

_MOST_EXPONENTIALS: Final = 4096
"""Matrix exponentials taken at once: a record with an irregular clock has as many as rows for each parameter."""


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Outputs and their derivatives, in SI units.

    Parameters
    ----------
    values : float array, shape (n_outputs, n_time)
    parameters : float array, shape (n_outputs, n_time, n_names)
        By each named parameter.
    states : float array, shape (n_outputs, n_time, n_states)
        By each initial state, in the order of ``actuator.state_names``.
    delay : float array, shape (n_outputs, n_time)
        By the delay. Where an edge falls on a row, the jump of the reading itself has no derivative and is left out.
    """

    values: FloatArray
    parameters: FloatArray
    states: FloatArray
    delay: FloatArray


def simulate_outputs(
    actuator: Actuator,
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    hold: Hold,
    *,
    outputs: Sequence[str] | None = None,
    initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    delay: float = 0.0,
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

    Returns
    -------
    values : float array, shape (n_outputs, n_time) [SI]

    Raises
    ------
    InputError
        An unknown output or state, a hold that says nothing, time that does not increase, unequal
        lengths, a voltage that is not finite.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> current = simulate_outputs(load_actuator("friend-2"), [0, 0.02], [1, 1], "zero", outputs=["current"])
    >>> round(float(current[0, 0]), 6)
    0.060348
    """
    from ipmclab.model import kernels

    check_hold(hold)
    times, volts = _record(time, voltage)
    chosen = choose_outputs(outputs)
    values = np.empty((actuator.system.c.shape[0], len(times)))
    if initial_state is None and delay == 0.0 and _is_regular(times):
        coefficients = modal_coefficients(actuator, (times[-1] - times[0]) / (len(times) - 1), hold)
        if coefficients is not None:
            kernels.modal(volts, coefficients, values)
            return values[chosen]
    line = timeline(times, volts, hold, delay=delay, from_rest=initial_state is None)
    run_dense(actuator, line, state_vector(actuator, initial_state), values)
    return values[chosen]


def run_dense(actuator: Actuator, line: Timeline, state: FloatArray, values: FloatArray) -> None:
    """Write the outputs over a time line into ``values``, by the path that does not need poles."""
    from ipmclab.model import kernels

    system = actuator.system
    move = transitions([system], line.durations)
    kernels.dense(
        move.state[0],
        move.constant[0],
        move.slope[0],
        line.interval,
        line.start,
        line.end,
        line.row,
        line.reading,
        system.c,
        np.ascontiguousarray(system.d[:, 0]),
        state,
        values,
    )


def sensitivities(
    actuator: Actuator,
    names: Sequence[str],
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    hold: Hold,
    *,
    outputs: Sequence[str] | None = None,
    initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    delay: float = 0.0,
) -> Sensitivities:
    """Outputs at the rows of a record, with exact derivatives by parameters, initial states and delay.

    The derivatives of the discretised matrices are taken by a complex step through the stages and
    the matrix exponential; they are carried along with the state. No pole is computed, so that
    equal poles are no exception.

    Parameters
    ----------
    names : sequence of str
        Dotted names of parameters.

    The other parameters are those of ``simulate_outputs``.

    Returns
    -------
    sensitivities : Sensitivities

    Raises
    ------
    InputError
        As ``simulate_outputs``, and for an unknown parameter.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> actuator = load_actuator("friend-2")
    >>> slope = sensitivities(actuator, ["coupling.gain"], [0, 0.02, 0.04], [1, 1, 1], "zero", outputs=["force"])
    >>> bool(abs(slope.parameters[0, 2, 0] * actuator["coupling.gain"] / slope.values[0, 2] - 1) < 1e-12)
    True
    """
    from ipmclab.model import kernels

    check_hold(hold)
    times, volts = _record(time, voltage)
    chosen = choose_outputs(outputs)
    line = timeline(times, volts, hold, delay=delay, from_rest=initial_state is None)
    state = state_vector(actuator, initial_state)
    system = actuator.system
    n, n_outputs = len(state), len(chosen)
    move = transitions([system], line.durations)
    kinds, count = len(line.durations), len(names)
    d_state, d_constant = np.empty((kinds, n, n, count)), np.empty((kinds, n, count))
    d_slope, d_c, d_d = np.empty((kinds, n, count)), np.empty((n_outputs, n, count)), np.empty((n_outputs, count))
    stepped = [
        actuator.assembled({**actuator.parameter_values, name: complex(actuator[name], _COMPLEX_STEP)})
        for name in names
    ]
    at_once = max(1, _MOST_EXPONENTIALS // kinds)
    for first in range(0, count, at_once):
        some = slice(first, first + at_once)
        stepped_move = transitions(stepped[some], line.durations)
        d_state[..., some] = np.moveaxis(stepped_move.state.imag, 0, -1) / _COMPLEX_STEP
        d_constant[..., some] = np.moveaxis(stepped_move.constant.imag, 0, -1) / _COMPLEX_STEP
        d_slope[..., some] = np.moveaxis(stepped_move.slope.imag, 0, -1) / _COMPLEX_STEP
    for index, at in enumerate(stepped):
        d_c[..., index] = at.c[chosen].imag / _COMPLEX_STEP
        d_d[..., index] = at.d[chosen, 0].imag / _COMPLEX_STEP
    c, d = system.c[chosen], system.d[chosen, 0]
    tangents = np.hstack([np.zeros((n, count)), np.eye(n)])
    values = np.empty((n_outputs, len(times)))
    derivatives = np.empty((n_outputs, len(times), count + n))
    by_delay = np.empty_like(values)
    kernels.dense_tangents(
        *(move.state[0], move.constant[0], move.slope[0], d_state, d_constant, d_slope),
        *(line.interval, line.start, line.end, line.row, line.reading),
        *(c, d, d_c, d_d, state, tangents, values, derivatives),
    )
    kernels.dense_delay(
        *(move.state[0], move.constant[0], line.interval, line.rate, line.jump, line.read_before_jump),
        *(line.row, line.reading_rate, np.ascontiguousarray(system.b[:, 0]), c, d, by_delay),
    )
    return Sensitivities(
        values=values,
        parameters=derivatives[:, :, :count],
        states=derivatives[:, :, count:],
        delay=by_delay,
    )


def _record(time: npt.ArrayLike, voltage: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    times = np.ascontiguousarray(time, dtype=np.float64)
    check_time("time", times)
    return times, checked_voltage(voltage, len(times))


def _is_regular(times: FloatArray) -> bool:
    steps = np.diff(times)
    return bool(steps.max() - steps.min() <= 1e-6 * steps.mean())
