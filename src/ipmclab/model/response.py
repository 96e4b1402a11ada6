"""Frequency response of a strip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.assemble import System
from ipmclab.model.numerics.reduce import small_signal
from ipmclab.model.ports import choose_outputs


def frequency_response(
    system: System, frequency: npt.ArrayLike, outputs: Sequence[str] | None = None
) -> npt.NDArray[np.complex128]:
    """Output over the first input at some frequencies, in closed form.

    With a leak it is that of small voltages about 0 V, where a leak above a threshold draws nothing: at larger
    voltages there is no frequency response, and ``simulate`` shows what happens.

    Parameters
    ----------
    system : System
    frequency : float array, shape (n_frequency,) [Hz]
    outputs : sequence of str, optional
        Some of ``OUTPUTS``; all of them where it is left out.

    Returns
    -------
    response : complex array, shape (n_outputs, n_frequency) [SI unit of the output per that of the input]

    Raises
    ------
    InputError
        An unknown output, or a frequency that is negative or not finite.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> response = frequency_response(load_actuator("friend-2").system, [0.0], ["displacement"])
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
    about_rest = small_signal(system)
    s = 2j * np.pi * frequencies[:, None, None]
    state = np.linalg.solve(s * np.eye(len(about_rest.states)) - about_rest.a, about_rest.b[None].astype(complex))
    response: npt.NDArray[np.complex128] = (about_rest.c @ state + about_rest.d)[:, :, 0].T
    return np.ascontiguousarray(response[chosen])
