"""How a rig is wired: names of its inputs and outputs, and that no two things share one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from ipmclab.errors import InputError, missing_key
from ipmclab.rig.channels import Rig

_NAME: Final = re.compile(r"(?P<module>[A-Za-z][\w-]*)/(?P<kind>ai|ao)(?P<number>\d{1,3})")
_PAIR: Final = 8  # a differential input of the NI 9205 takes the input 8 above it as its other terminal


@dataclass(frozen=True)
class _Wire:
    key: str
    physical: str
    kind: str
    differential: bool = False


def _wires(rig: Rig) -> Iterator[_Wire]:
    yield _Wire("output", rig.output.physical, "ao")
    for channel in rig.channels:
        yield _Wire(f"channels.{channel.name}", channel.physical, "ai", channel.terminal == "differential")
    if rig.thermometer is not None:
        yield _Wire("thermometer", rig.thermometer.physical, "ai")
    if rig.four_probe is not None:
        yield _Wire("four_probe", rig.four_probe.physical, "ai")


def check_wiring(rig: Rig, *, where: str) -> None:
    """Refuse a rig that cannot be wired.

    Parameters
    ----------
    rig : Rig
    where : str
        What the messages name: the file.

    Raises
    ------
    InputError
        A name that no input or output has, none where there is hardware, two things at one terminal.
    """
    taken: dict[tuple[str, int], str] = {}
    for wire in _wires(rig):
        place = f"{where}: {wire.key}.physical"
        example = f"cDAQ1Mod1/{wire.kind}0"
        if not wire.physical:
            if rig.bench == "ni":
                raise missing_key(place, f'add "{example}"')
            continue
        match = _NAME.fullmatch(wire.physical)
        if match is None or match["kind"] != wire.kind:
            kind = "output" if wire.kind == "ao" else "input"
            raise InputError(
                f"{wire.physical!r} is not the name of an analogue {kind}",
                code="bad-channel-name",
                where=place,
                repair=f'write it as in NI MAX, such as "{example}"',
            )
        number = int(match["number"])
        numbers = [number]
        if wire.differential:
            if number // _PAIR % 2:
                raise InputError(
                    f"{wire.physical!r} cannot be differential: it is the other terminal of ai{number - _PAIR}",
                    code="bad-channel-name",
                    where=place,
                    repair="take ai0 to ai7 or ai16 to ai23, or another terminal configuration",
                )
            numbers.append(number + _PAIR)
        for one in numbers:
            terminal = (f"{match['module']}/{wire.kind}".lower(), one)
            if terminal in taken:
                raise InputError(
                    f"{wire.physical!r} is taken by {taken[terminal]} already"
                    + ("" if one == number else f": a differential input takes ai{one} too"),
                    code="duplicate-channel",
                    where=place,
                    repair="wire each to an input of its own",
                )
            taken[terminal] = wire.key
