"""Frequency response of an actuator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.actuator import Actuator, choose_outputs
from ipmclab.model.numerics.reduce import small_signal


def frequency_response(
    actuator: Actuator, frequency: npt.ArrayLike, outputs: Sequence[str] | None = None
) -> npt.NDArray[np.complex128]:
    """Output over voltage at some frequencies, in closed form.

    With a leak it is that of small voltages about 0 V, where a leak above a threshold draws nothing: at larger
    voltages there is no frequency response, and ``simulate`` tells what happens.

    Parameters
    ----------
    actuator : Actuator
    frequency : float array, shape (n_frequency,) [Hz]
    outputs : sequence of str, optional
        Some of ``OUTPUTS``; all of them where it is left out.

    Returns
    -------
    response : complex array, shape (n_outputs, n_frequency) [SI unit of the output per V]

    Raises
    ------
    InputError
        An unknown output, or a frequency that is negative or not finite.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> response = frequency_response(load_actuator("friend-2"), [0.0], ["displacement"])
    >>> round(1e3 * abs(complex(response[0, 0])), 4)
    0.6254
    """
    chosen = choose_outputs(outputs)
    frequencies = np.atleast_1d(np.asarray(frequency, dtype=np.float64))
    if frequencies.ndim != 1 or not np.all(np.isfinite(frequencies) & (frequencies >= 0)):
        raise InputError(
            "a frequency is negative or not finite, or there is more than one row of them",
            code="bad-frequency",
            where="frequency",
            repair="give a list of frequencies in Hz, from 0 up",
        )
    system = small_signal(actuator.system)
    s = 2j * np.pi * frequencies[:, None, None]
    state = np.linalg.solve(s * np.eye(len(system.states)) - system.a, system.b[None].astype(complex))
    response: npt.NDArray[np.complex128] = (system.c @ state + system.d)[:, :, 0].T
    return np.ascontiguousarray(response[chosen])
