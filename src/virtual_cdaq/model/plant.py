"""What lies behind the terminals of the chassis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Plant(Protocol):
    """Whatever is wired to the chassis.

    It may have an attribute ``noise``, a mapping of terminal to standard deviation [V, or ohm]: what the sensors add to
    each sample, which must not depend on how often the plant is asked.
    """

    def advance(self, times: Floats, outputs: Mapping[str, Floats]) -> Mapping[str, Floats]:
        """Let time pass and return what the terminals carry.

        Parameters
        ----------
        times : array of float, shape (n,) [s]
            Strictly ascending, all later than those of the call before; n is at least 1. Every time is a multiple of
            12.5 ns, but the difference of two floats is only nearly one: a plant that keeps a discretisation per step
            rounds the step first.
        outputs : mapping of physical channel to array of float, shape (n,) [V]
            ``outputs[c][k]`` is what output `c` gave from ``times[k - 1]`` until ``times[k]``.

        Returns
        -------
        mapping of physical channel to array of float, shape (n,) [V, or ohm for a NI 9217]
            What is at the terminal at ``times[k]``, read just before an output changes there. A terminal that is
            left out is not wired: 0 V, or open for a NI 9217.
        """


class RcPlant:
    """A resistor and a capacitor, enough to see that the chassis works.

    The output ``cDAQ1Mod2/ao0`` is wired to ``cDAQ1Mod1/ai3`` and charges a capacitor (``ai1``) through a resistor; the
    current runs through a 1 ohm shunt (``ai0``). A 100 ohm resistor is at ``cDAQ1Mod3/ai0`` and a Pt100 at 22 degC
    at ``cDAQ1Mod3/ai1``.

    Parameters
    ----------
    resistance : float [ohm]
    capacitance : float [F]
    chassis : str
        Name of the chassis.

    Examples
    --------
    >>> plant = RcPlant(resistance=10.0, capacitance=0.1)
    >>> out = plant.advance(np.array([1.0, 2.0]), {"cDAQ1Mod2/ao0": np.array([0.0, 1.0])})
    >>> bool(np.isclose(out["cDAQ1Mod1/ai1"][1], 1 - np.exp(-1.0)))
    True
    """

    def __init__(self, resistance: float = 10.0, capacitance: float = 0.1, chassis: str = "cDAQ1") -> None:
        self._resistance = resistance
        self._tau = resistance * capacitance
        self._chassis = chassis
        self._time = 0.0
        self._volts = 0.0

    def advance(self, times: Floats, outputs: Mapping[str, Floats]) -> Mapping[str, Floats]:
        """Exact for an output that is constant between two times."""
        name = self._chassis
        applied = outputs[f"{name}Mod2/ao0"]
        # Rounded, so that one sample period gives one and the same step wherever it lies in time.
        steps = np.round(times - np.concatenate(([self._time], times[:-1])), 10)
        kept = np.exp(-steps / self._tau)
        volts = np.empty_like(times)
        level = self._volts
        for k, (keep, drive) in enumerate(zip(kept.tolist(), applied.tolist(), strict=True)):
            level = drive + (level - drive) * keep
            volts[k] = level
        self._time, self._volts = float(times[-1]), level
        return {
            f"{name}Mod1/ai0": (applied - volts) / self._resistance * 1.0,
            f"{name}Mod1/ai1": volts,
            f"{name}Mod1/ai3": applied,
            f"{name}Mod3/ai0": np.full_like(times, 100.0),
            f"{name}Mod3/ai1": np.full_like(times, 108.5729),
        }
