"""``rig prove``: what the hardware of a rig does when things go wrong, tested with a dummy load in the clamp."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import datetime
from typing import Final

from ipmclab.errors import InputError
from ipmclab.rig.chambers.drivers import open_chamber
from ipmclab.rig.channels import Rig
from ipmclab.rig.checks.chamber import chamber_items
from ipmclab.rig.checks.from_outside import Ask, from_outside, unplugged
from ipmclab.rig.checks.on_bench import WrongLoad, on_bench, series_resistance
from ipmclab.rig.checks.proof import Item, Proof, rig_fingerprint
from ipmclab.rig.checks.prove_child import RATE
from ipmclab.rig.daqmx.look import Watcher, describe
from ipmclab.rig.safety.readback import TOLERANCE
from ipmclab.version import __version__

_FILL: Final = 0.8
_WAIT: Final = 0.5  # s of sampling that a stand-in is timed by
_WAITS: Final = 3  # of them, and the shortest counts: a busy computer makes them longer only
_AHEAD: Final = 0.95  # of it: on a real clock the rows fill the wait to the last one


def prove(
    rig: Rig,
    rig_name: str,
    *,
    ask: Ask | None = None,
    operator: str = "",
    on_item: Callable[[Item], None] | None = None,
) -> Proof:
    """Go through the check list, with the dummy load in the place of the strip.

    Parameters
    ----------
    rig : Rig
    rig_name : str
        The path of its file, for the programs that are started and killed.
    ask : callable, optional
        Puts a question to the operator and gives the answer. Without it what needs the operator is not done.
    operator : str
    on_item : callable, optional
        Hears of each item when it is done.

    Raises
    ------
    InputError
        A virtual bench, a rig on which this cannot be tried, a stand-in whose clock runs ahead of real time.
    IpmclabError
        The chassis is not there.
    """
    if rig.bench != "ni":
        raise InputError(
            "a virtual bench has no hardware to prove",
            code="no-hardware",
            where="bench",
            repair='write bench = "ni"; ipmclab rig serve gives a stand-in to try this on',
        )
    volts = _volts(rig)
    about, simulated = describe(rig)
    if simulated:
        _refuse_a_clock_that_runs_ahead(rig)
    items: list[Item] = []

    def note(item: Item) -> None:
        items.append(item)
        if on_item is not None:
            on_item(item)

    try:
        for item in on_bench(rig, volts):
            note(item)
        for item in from_outside(rig, rig_name, volts):
            note(item)
        note(unplugged(rig, rig_name, volts, simulated, ask))
        for item in _in_chamber(rig):
            note(item)
    except WrongLoad:
        pass  # the item says so; a strip is not put through the rest
    return Proof(
        rig=rig.name,
        fingerprint=rig_fingerprint(rig),
        date=datetime.now().astimezone().isoformat(timespec="seconds"),
        bench=about,
        simulated=simulated,
        operator=operator,
        items=tuple(items),
        software_version=__version__,
    )


def _volts(rig: Rig) -> float:
    """The voltage that is given out: 1 V, or what the ranges hold."""
    names = [channel.name for channel in rig.channels]
    if "current" not in names:
        raise InputError(
            "there is no channel current",
            code="missing-key",
            where="channels.current",
            repair="the dummy load is known by its current: describe the shunt",
        )
    current = rig["current"]
    most = _FILL * abs(current.gain) * current.converter.high * series_resistance(rig)
    volts = min(1.0, most, _FILL * rig["voltage"].converter.high, rig.output.high)
    if volts < 3.0 * TOLERANCE:
        raise InputError(
            f"the ranges of voltage and current hold {volts:.2g} V over the dummy load, {3 * TOLERANCE:g} V are needed",
            code="range-too-small",
            where="channels.current.range",
            repair="take a larger range",
        )
    return float(f"{volts:.2g}")


def _refuse_a_clock_that_runs_ahead(rig: Rig) -> None:
    """Raise where the time of a stand-in is not that of this computer."""
    watcher = Watcher(rig)
    try:
        waited = min(watcher.waited(RATE, round(_WAIT * RATE)) for _ in range(_WAITS))
    finally:
        watcher.close()
    if waited < _AHEAD * _WAIT:
        raise InputError(
            f"{_WAIT:g} s of the stand-in passed in {waited:.2g} s: what happens after a kill cannot be timed",
            code="not-real-time",
            where=rig.address or "bench",
            repair="serve it with --clock real",
        )


def _in_chamber(rig: Rig) -> Iterator[Item]:
    """Whether the chamber answers and comes to standby, where a program can set it."""
    if rig.chamber is None or rig.chamber.is_virtual:
        return
    with closing(open_chamber(rig.chamber)) as chamber:
        yield from chamber_items(chamber)
