"""What the modules of a chassis can do a second, as far as their data sheets state it without the chassis."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from typing import Final

from ipmclab.errors import InputError
from ipmclab.rig.channels import Rig
from ipmclab.run import SLOW_CHANNELS

INPUT_RATE: Final = 250e3
"""Samples a second [Hz] that an NI 9205 takes, of all its channels together."""

OUTPUT_RATE: Final = 100e3
"""Samples a second [Hz] that an NI 9263 gives out."""

_ROUNDING: Final = 1.0 + 1e-9


def check_modules(rig: Rig, measured: Collection[str], rate: float) -> None:
    """Refuse a rate at which no NI 9205 reads so many channels, or no NI 9263 gives its output.

    Parameters
    ----------
    rig : Rig
        A virtual one can do any rate.
    measured : collection of str
        What a run asks for; the voltage, the current and the air are read too.
    rate : float [Hz]

    Raises
    ------
    InputError
        ``"bad-rate"``

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> try:
    ...     check_modules(replace(THESIS_RIG, bench="ni"), ["current", "force"], 100e3)
    ... except InputError as error:
    ...     print(error.message)
    100000 Hz is asked for, the 4 channels on cDAQ1Mod1 are read at 62500 Hz at most
    """
    if rig.bench != "ni":
        return
    read = {"voltage", "current", *measured, *SLOW_CHANNELS}
    wires = [channel.physical for channel in rig.channels if channel.name in read]
    modules = Counter(physical.strip("/").partition("/")[0] for physical in wires)
    allowed = [
        (INPUT_RATE / count, f"the {count} channels on {module} are read")
        if count > 1
        else (INPUT_RATE, f"the channel on {module} is read")
        for module, count in modules.items()
    ]
    most, what = min([*allowed, (OUTPUT_RATE, "the output is given out")])
    if rate > most * _ROUNDING:
        raise InputError(
            f"{rate:.12g} Hz is asked for, {what} at {most:.12g} Hz at most",
            code="bad-rate",
            where="rate",
            repair="give a lower rate, or record fewer channels",
        )
