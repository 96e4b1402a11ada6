"""An actuator that is stepped: sample by sample, or block by block, with its state carried on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import OUTPUTS, Actuator, state_vector
from ipmclab.model.numerics.dense import Dense, parts
from ipmclab.model.simulate import above_zero, check_hold, checked_voltage
from ipmclab.model.stages.laser import blank_lost, read_far
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]


class Simulator:
    """Steps an actuator at a fixed rate; blocks joined equal one call of ``simulate``.

    Parameters
    ----------
    actuator : Actuator
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
        actuator: Actuator,
        rate: float,
        hold: Hold = "zero",
        *,
        initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    ) -> None:
        check_hold(hold)
        system = actuator.system
        period = np.array([1.0 / above_zero("rate", rate, "Hz")])
        self._parts = int(parts(system, period)[0])
        self._dense = Dense.of(system, period / self._parts)
        self._outputs = len(system.outputs)
        self._names = system.states
        self._parameters = actuator.parameter_values
        self._hold = hold
        self._state = state_vector(actuator, initial_state)
        self._last_voltage: float | None = None

    @property
    def state(self) -> dict[str, float]:
        """The physical state by name: capacitor voltages [V], coupling, displacement [m] and velocity [m/s].

        For the hold ``zero`` it is the state at the row that comes next, for the others at the last row.
        """
        return dict(zip(self._names, self._state.tolist(), strict=True))

    def step(self, voltage: float) -> FloatArray:
        """The outputs at the next row, whose voltage [V] is given: shape (n_outputs,), in the order of ``OUTPUTS``."""
        return self.block([voltage])[:, 0]

    def block(self, voltages: npt.ArrayLike) -> FloatArray:
        """The outputs at the next rows.

        Parameters
        ----------
        voltages : float array, shape (n_time,) [V]
            One for each row.

        Returns
        -------
        outputs : float array, shape (n_outputs, n_time) [SI]
            In the order of ``OUTPUTS``: current, applied voltage, displacement, force. Where a laser has lost the
            strip, the displacement is NaN.

        Raises
        ------
        InputError
            A voltage that is not finite.
        """
        given = np.atleast_1d(np.asarray(voltages))
        volts = checked_voltage(given, given.size)
        rows = np.arange(len(volts))
        outputs = np.empty((self._outputs, len(volts)))
        if len(volts) == 0:
            return outputs
        start = end = volts
        if self._hold == "zero":
            row = np.append(rows, -1)
        else:
            # The state stays at the last row; the next interval begins there with the voltage left there.
            if self._last_voltage is None:
                row, start, end = rows, volts[:-1], volts[1:]
            else:
                row, start = np.append(-1, rows), np.append(self._last_voltage, volts[:-1])
            if self._hold == "zero-before":
                start = end
        self._last_voltage = float(volts[-1])
        if self._parts > 1:
            start, end, row = self._divided(start, end, row)
        interval = np.zeros(len(start), dtype=np.int64)
        self._dense.run(interval, start, end, row, volts, self._state, outputs)
        read_far(outputs, OUTPUTS, self._parameters)
        blank_lost(outputs, OUTPUTS, self._parameters)
        return outputs

    def _divided(
        self, start: FloatArray, end: FloatArray, row: npt.NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.int64]]:
        """The intervals in their parts."""
        count, rise = len(start), end - start
        begun = np.arange(self._parts) / self._parts
        ends = start[:, None] + rise[:, None] * (begun + 1.0 / self._parts)
        ends[:, -1] = end
        rows = np.full(count * self._parts + len(row) - count, -1, dtype=np.int64)
        rows[:: self._parts] = row
        return (start[:, None] + rise[:, None] * begun).ravel(), ends.ravel(), rows
