"""What the arrays of a run mean in addition to their numbers: the voltage between rows, quality bits, raw readings."""

from __future__ import annotations

from typing import Final, Literal

from ipmclab.units import CHANNELS

Hold = Literal["zero", "zero-before", "first", "unknown"]
"""What the voltage did between rows.

``zero``: row k is read just as the output takes ``voltage[k]``, which holds until row k+1.
``zero-before``: row k is read just before the output changes, so ``voltage[k]`` held since row k-1.
``first``: straight lines between rows. ``unknown``: a foreign record; the edge delay is estimated.
"""

QUALITY_FLAGS: Final[dict[str, int]] = {
    "missing": 1,
    "sentinel": 2,
    "clipped": 4,
    "contact_lost": 8,
    "masked_by_operator": 16,
}
"""Bits of a ``<channel>_quality`` array: what was known at recording or import."""

SLOW_CHANNELS: Final = ("temperature", "relative_humidity", "chamber_temperature", "chamber_relative_humidity")
"""Channels that have a time base of their own, ``time_environment``."""


def raw_name(name: str) -> str:
    """What the raw array of a channel, or of the output, is called in words."""
    return "commanded output" if name == "output" else f"raw reading of {CHANNELS[name].name}"
