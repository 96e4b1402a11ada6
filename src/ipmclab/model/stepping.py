"""A strip that is stepped: sample by sample, or block by block, with its state carried on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.assemble import System
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.dense import Dense, parts
from ipmclab.model.ports import OUTPUTS
from ipmclab.model.request import above_zero, check_hold, checked_force, checked_voltage, state_vector
from ipmclab.model.stages.laser import blank_lost, read_far
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]


class Simulator:
    """Steps a strip at a fixed rate; blocks joined equal one call of ``simulate``.

    Parameters
    ----------
    system : System
    parameters : mapping of dotted name to float [SI]
        What a laser reads depends on them.
    rate : float [Hz]
    hold : "zero", "zero-before" or "first"
    initial_state : mapping of state name to float, or float array of shape (n_states,), optional
        Rest where it is left out.

    Raises
    ------
    InputError
        A rate, hold or state that cannot be used.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> simulator = load_actuator("friend-2").simulator(50)
    >>> current, applied_voltage, displacement, force = simulator.step(1.0)
    >>> round(float(current), 6)
    0.060348
    >>> simulator.block([1.0, 1.0, 1.0]).shape
    (4, 3)
    """

    def __init__(
        self,
        system: System,
        parameters: Mapping[str, float],
        rate: float | str,
        hold: Hold = "zero",
        *,
        initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    ) -> None:
        check_hold(hold)
        period = np.array([1.0 / above_zero("rate", rate, "Hz")])
        self._parts = int(parts(system, period)[0])
        self._dense = Dense.of(system, period / self._parts)
        self._outputs = len(system.outputs)
        self._names = system.states
        self._parameters = parameters
        self._hold = hold
        self._state = state_vector(system.states, initial_state)
        self._inputs = system.inputs
        self._last: FloatArray | None = None

    @property
    def state(self) -> dict[str, float]:
        """The physical state by name: capacitor voltages [V], coupling, displacement [m] and velocity [m/s].

        For the hold ``zero`` it is the state at the row that comes next, for the others at the last row.
        """
        return dict(zip(self._names, self._state.tolist(), strict=True))

    def step(self, voltage: float, external_force: float | None = None) -> FloatArray:
        """The outputs at the next row, whose voltage [V] is given: shape (n_outputs,), in the order of ``OUTPUTS``."""
        return self.block([voltage], None if external_force is None else [external_force])[:, 0]

    def block(self, voltages: npt.ArrayLike, external_force: npt.ArrayLike | None = None) -> FloatArray:
        """The outputs at the next rows.

        Parameters
        ----------
        voltages : float array, shape (n_time,) [V]
            One for each row.
        external_force : float array, shape (n_time,) [N], optional
            Of a simulator with this input; none acts where it is left out.

        Returns
        -------
        outputs : float array, shape (n_outputs, n_time) [SI]
            In the order of ``OUTPUTS``: current, applied voltage, displacement, force. Where a laser has lost the
            strip, the displacement is NaN.

        Raises
        ------
        InputError
            A voltage or force that is not finite, or a force for a simulator without this input.
        """
        given = self._given(voltages, external_force)
        rows = np.arange(len(given))
        outputs = np.empty((self._outputs, len(given)))
        if len(given) == 0:
            return outputs
        start = end = given
        if self._hold == "zero":
            row = np.append(rows, -1)
        else:
            # The state stays at the last row; the next interval begins there with the inputs left there.
            if self._last is None:
                row, start, end = rows, given[:-1], given[1:]
            else:
                row, start = np.append(-1, rows), np.concatenate([self._last, given[:-1]])
            if self._hold == "zero-before":
                start = end
        self._last = given[-1:].copy()
        if self._parts > 1:
            start, end, row = self._divided(start, end, row)
        interval = np.zeros(len(start), dtype=np.int64)
        self._dense.run(Course(interval, start, end, row, given), self._state, outputs)
        read_far(outputs, OUTPUTS, self._parameters)
        blank_lost(outputs, OUTPUTS, self._parameters)
        return outputs

    def _given(self, voltages: npt.ArrayLike, external_force: npt.ArrayLike | None) -> FloatArray:
        """The inputs at the rows, shape (n_time, n_inputs)."""
        volts = np.atleast_1d(np.asarray(voltages))
        found = {"voltage": checked_voltage(volts, volts.size)}
        if external_force is not None:
            if "external_force" not in self._inputs:
                raise InputError(
                    "this simulator is driven by the voltage alone",
                    code="unknown-input",
                    where="external_force",
                    repair='make it with inputs=("voltage", "external_force")',
                )
            found["external_force"] = checked_force(np.atleast_1d(np.asarray(external_force)), volts.size)
        return np.column_stack([found.get(name, np.zeros(volts.size)) for name in self._inputs])

    def _divided(
        self, start: FloatArray, end: FloatArray, row: npt.NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
        """The intervals in their parts."""
        count, rise = len(start), (end - start)[:, None]
        begun = (np.arange(self._parts) / self._parts)[:, None]
        ends = start[:, None] + rise * (begun + 1.0 / self._parts)
        ends[:, -1] = end
        rows = np.full(count * self._parts + len(row) - count, -1, dtype=np.int64)
        rows[:: self._parts] = row
        inputs = len(self._inputs)
        return (start[:, None] + rise * begun).reshape(-1, inputs), ends.reshape(-1, inputs), rows
