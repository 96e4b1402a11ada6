"""The C Series modules as data.

Figures are those of the NI 9205, NI 9217 and NI 9263 data sheets; where a data sheet gives a typical value, that one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Differential, Referenced, NonReferenced = 10106, 10083, 10078  # DAQmx_Val_Diff, _RSE, _NRSE


@dataclass(frozen=True)
class Range:
    """One input or output range of a module.

    Parameters
    ----------
    low, high : float [V, or ohm]
        What the range is called, and what the client gets.
    full_scale : float [V, or ohm]
        Half of what the converter covers (all of it for a resistance): a little more than the range is called.
    noise : float [V, or ohm]
        Standard deviation of one sample.
    """

    low: float
    high: float
    full_scale: float
    noise: float


@dataclass(frozen=True)
class Module:
    """A kind of module.

    Parameters
    ----------
    product : str
        As NI-DAQmx calls it.
    number : int
        NI's product number.
    kind : {"ai", "ao"}
    channels : int
    bits : int
        Of the converter.
    ranges : tuple of Range
        From the smallest to the largest.
    rate : float [S/s]
        Of one channel.
    aggregate_rate : float [S/s]
        Of all channels of the module together.
    terminals : tuple of int
        Terminal configurations; the first is the default.
    resistive : bool
        Whether it measures resistances and RTDs, and not voltages.
    slow : bool
        Whether it repeats its last conversion when the sample clock is faster than it is.
    offset : float
        Largest offset, as a part of the range.
    """

    product: str
    number: int
    kind: Literal["ai", "ao"]
    channels: int
    bits: int
    ranges: tuple[Range, ...]
    rate: float
    aggregate_rate: float
    terminals: tuple[int, ...] = ()
    resistive: bool = False
    slow: bool = False
    offset: float = 0.0

    def differential_only(self, index: int) -> bool:
        """Whether channel `index` is the upper half of differential pairs, and so single-ended only."""
        return self.product == "NI 9205" and (index // 8) % 2 == 1


# The 9205 covers 4.86 % more than its ranges are called: 320, 160, 32 and 6.4 uV a step.
_OVER = 1.048576

NI9205 = Module(
    product="NI 9205",
    number=29360,
    kind="ai",
    channels=32,
    bits=16,
    ranges=(
        Range(-0.2, 0.2, 0.2 * _OVER, 10e-6),
        Range(-1.0, 1.0, 1.0 * _OVER, 26e-6),
        Range(-5.0, 5.0, 5.0 * _OVER, 116e-6),
        Range(-10.0, 10.0, 10.0 * _OVER, 240e-6),
    ),
    rate=250_000.0,
    aggregate_rate=250_000.0,
    terminals=(Differential, Referenced, NonReferenced),
    offset=20e-6,
)
NI9263 = Module(
    product="NI 9263",
    number=28958,
    kind="ao",
    channels=4,
    bits=16,
    ranges=(Range(-10.0, 10.0, 10.7, 0.0),),
    rate=100_000.0,
    aggregate_rate=400_000.0,
)
NI9217 = Module(
    product="NI 9217",
    number=29338,
    kind="ai",
    channels=4,
    bits=24,
    ranges=(Range(0.0, 400.0, 400.0, 8e-3),),  # 0.02 K of a Pt100, in the high-speed mode
    rate=400.0,
    aggregate_rate=400.0,
    terminals=(Differential,),
    resistive=True,
    slow=True,
)

MODULES = {module.product: module for module in (NI9205, NI9217, NI9263)}
EXCITATION = 1e-3  # A, of the NI 9217
HIGH_SPEED_CONVERSION = 2.5e-3  # s a channel, NI 9217
HIGH_RESOLUTION_CONVERSION = 0.2  # s a channel, NI 9217
HIGH_RESOLUTION_NOISE = 0.15  # of the noise in the high-speed mode: 0.003 K instead of 0.02 K
