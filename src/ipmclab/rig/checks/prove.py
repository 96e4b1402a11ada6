"""``rig prove``: what the hardware of a rig does when things go wrong, tested with a dummy load in the clamp."""

from __future__ import annotations

import math
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from datetime import datetime
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import python_child
from ipmclab.rig.bench import Block
from ipmclab.rig.chambers.drivers import open_chamber
from ipmclab.rig.channels import Rig
from ipmclab.rig.checks.chamber import chamber_items
from ipmclab.rig.checks.proof import Item, Proof, rig_fingerprint
from ipmclab.rig.checks.prove_child import RATE
from ipmclab.rig.daqmx.look import Watcher, describe
from ipmclab.rig.plant import DUMMY_CAPACITANCE, DUMMY_RESISTANCE
from ipmclab.rig.safety.readback import TOLERANCE, left_at_output
from ipmclab.signals import Samples, Step
from ipmclab.units import VOLTAGE, parse_quantity
from ipmclab.version import __version__

if TYPE_CHECKING:
    from ipmclab.rig.ni import NiBench

FloatArray = npt.NDArray[np.float64]
Ask = Callable[[str], str]

WITHIN: Final = 1.0
"""The output is at 0 V so soon [s] after whatever ends the recorder."""

_LOOK: Final = 5.0  # s: for so long the output is watched
_START: Final = 60.0  # s for the child to start and to give its voltage out
_FILL: Final = 0.8
_SHORT: Final = 1.0  # s of a reading
_WAIT: Final = 0.5  # s of sampling that a stand-in is timed by
_WAITS: Final = 3  # of them, and the shortest counts: a busy computer makes them longer only
_AHEAD: Final = 0.95  # of it: on a real clock the rows fill the wait to the last one
_RESISTANCE_TOLERANCE, _CAPACITANCE_TOLERANCE = 0.3, 0.5  # an electrolytic capacitor is as good as that
_OFFSET: Final = 0.005  # of the range
_NOISE: Final = 5.0  # times that of the data sheet
_NO_WATCHDOG: Final = "this hardware holds its output then: put an emergency stop into the supply of the amplifier"


class _WrongLoad(Exception):
    """It is not the dummy load that is in the clamp."""


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
        for item in _on_bench(rig, volts):
            note(item)
        for item in _from_outside(rig, rig_name, volts):
            note(item)
        note(_unplugged(rig, rig_name, volts, simulated, ask))
        for item in _in_chamber(rig):
            note(item)
    except _WrongLoad:
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


def _series(rig: Rig) -> float:
    return DUMMY_RESISTANCE + rig.shunt_resistance + rig.source_resistance


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
    most = _FILL * abs(current.gain) * current.converter.high * _series(rig)
    volts = min(1.0, most, _FILL * rig["voltage"].converter.high, rig.output.high)
    if volts < 3.0 * TOLERANCE:
        raise InputError(
            f"the ranges of voltage and current hold {volts:.2g} V over the dummy load, {3 * TOLERANCE:g} V are needed",
            code="range-too-small",
            where="channels.current.range",
            repair="take a larger range",
        )
    return float(f"{volts:.2g}")


def _on_bench(rig: Rig, volts: float) -> Iterator[Item]:
    """What is found while the bench runs as it does in a recording."""
    from ipmclab.rig.ni import NiBench

    bench = NiBench(rig)
    try:
        bench.open(["voltage", "current"], RATE)
        began = time.monotonic()
        rest = list(bench.apply(Step(0.0), round(_SHORT * RATE)))
        yield _clock(time.monotonic() - began)
        yield from (_at_rest(rig, name, _joined(rest, name)) for name in ("voltage", "current"))
        load = _load(rig, bench, volts)
        yield load
        if load.status != "passed":
            raise _WrongLoad
        yield _order(rig, bench, volts)
        yield _stop(rig, bench, volts)
        for _ in bench.apply(Step(volts), round(0.5 * RATE)):
            pass
    finally:
        bench.close()
    watcher = Watcher(rig)
    try:
        left = watcher.output()
        yield Item(
            "end",
            "the output after a signal that did not end at 0 V, and the bench was closed",
            "passed" if left == 0.0 else "failed",
            f"{left:.3g} V",
            "" if left == 0.0 else "the bench does not bring the output to 0 V: report it with this file",
        )
        watcher.release()
        terminal = watcher.clock_terminal(RATE)
    finally:
        watcher.close()
    yield Item("clock-terminal", "the terminal of the sample clock that output and inputs share", "noted", terminal)


def _joined(blocks: Sequence[Block], name: str) -> FloatArray:
    return np.concatenate([block.readings[name] for block in blocks])


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


def _clock(elapsed: float) -> Item:
    ratio = _SHORT / elapsed
    what = f"{_SHORT:g} s of sampling by the clock of this computer"
    good = 0.5 < ratio < 1.1  # it takes its time to start
    return Item(
        "clock",
        what,
        "passed" if good else "failed",
        f"{elapsed:.2f} s",
        "" if good else "the sample clock is wrong, or this computer is too busy",
    )


def _at_rest(rig: Rig, name: str, volts: FloatArray) -> Item:
    """Offset and noise of an input at 0 V."""
    channel = rig[name]
    offset, noise = float(volts.mean()), float(volts.std())
    quantity = channel.quantity
    expected = math.hypot(channel.converter.noise, channel.converter.step / math.sqrt(12.0))
    good = abs(offset) <= _OFFSET * channel.converter.high and noise <= _NOISE * expected

    def shown(value: float) -> str:
        return f"{quantity.to_display(abs(channel.gain) * value):.2g} {quantity.display_unit}"

    return Item(
        f"noise-{name}",
        f"offset and noise of {name} in its range of ±{channel.converter.high:g} V, with the output at 0 V",
        "passed" if good else "failed",
        f"offset {shown(offset)}, noise {shown(noise)} (data sheet {shown(expected)})",
        "" if good else "look at wiring, grounds and shields, and at the offset of the amplifier",
    )


def _load(rig: Rig, bench: NiBench, volts: float) -> Item:
    """Whether it is the dummy load: its resistance and capacitance from the current after an edge."""
    blocks = list(bench.apply(Step(volts), round(_SHORT * RATE)))
    channel = rig["current"]
    current = channel.gain * _joined(blocks, "current")[1:]
    time_since = np.arange(1, len(current) + 1) / RATE
    bench.zero()
    usable = current > 0.05 * volts / _series(rig)
    what = "10 ohm and 100 mF in series are in the place of the strip"
    repair = "take the strip out and clamp the dummy load; see that the amplifier is on"
    if usable.sum() < 5:
        return Item("load", what, "failed", f"{1e3 * float(np.abs(current).max()):.2g} mA at {volts:g} V", repair)
    slope, start = np.polyfit(time_since[usable], np.log(current[usable]), 1)
    resistance = volts / math.exp(start)
    capacitance = -1.0 / (slope * resistance) if slope < 0 else math.inf
    own = resistance - rig.shunt_resistance - rig.source_resistance
    good = (
        abs(own / DUMMY_RESISTANCE - 1.0) < _RESISTANCE_TOLERANCE
        and abs(capacitance / DUMMY_CAPACITANCE - 1.0) < _CAPACITANCE_TOLERANCE
    )
    found = f"{own:.3g} ohm and {1e3 * capacitance:.3g} mF"
    return Item("load", what, "passed" if good else "failed", found, "" if good else repair)


def _order(rig: Rig, bench: NiBench, volts: float) -> Item:
    """Whether an input is read before the output changes on the same edge."""
    rows = round(_SHORT * RATE)
    edge = rows // 2
    time_of = np.arange(rows) / RATE
    signal = Samples(time=time_of, voltage=np.where(np.arange(rows) >= edge, volts, 0.0))
    blocks = list(bench.apply(signal, rows))
    bench.zero()
    read = rig["voltage"].gain * _joined(blocks, "voltage") + rig["voltage"].offset
    changed = np.flatnonzero(read > 0.5 * volts)
    late = int(changed[0]) - edge if len(changed) else None
    found = "the edge was not read" if late is None else f"an edge at a row is read {late} row{'s' * (late != 1)} later"
    return Item(
        "order",
        "order of input and output at an edge: each row is read just before the output changes",
        "passed" if late == 1 else "failed",
        found,
        "" if late == 1 else "the time of every edge is off by a row: report it with this file",
    )


def _stop(rig: Rig, bench: NiBench, volts: float) -> Item:
    """What is read after ``zero`` in the middle of a signal."""
    rows = round(2.0 * RATE)
    zeroed_at: float | None = None
    after: float | None = None
    for block in bench.apply(Step(volts), rows):
        now = time.monotonic()
        if zeroed_at is None and block.first_row >= 0.5 * RATE:
            bench.zero()
            zeroed_at = now
        elif zeroed_at is not None:
            readings = {name: float(values[-1]) for name, values in block.readings.items()}
            if left_at_output(rig, readings) is None:
                after = now - zeroed_at
                break
    bench.zero()
    good = after is not None and after <= WITHIN
    return Item(
        "stop",
        "the output after a stop in the middle of a signal",
        "passed" if good else "failed",
        "it did not go to 0 V" if after is None else f"0 V is read {after:.2f} s later",
        "" if good else "switch the amplifier off; report it with this file",
    )


@contextmanager
def _child(rig_name: str, mode: str, volts: float) -> Iterator[subprocess.Popen[str]]:
    """A program that drives the load; it gives its voltage out when this begins."""
    command = python_child("ipmclab.rig.checks.prove_child", rig_name, mode, repr(volts))
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        line = process.stdout.readline().strip()
        if line != "on":
            raise IpmclabError(
                f"the program that should drive the load ended: {line or 'without a word'}",
                code="child-failed",
                where="rig prove",
                repair="see that no other program uses the chassis, then try again",
            )
        yield process
    finally:
        process.kill()
        process.communicate()


def _from_outside(rig: Rig, rig_name: str, volts: float) -> Iterator[Item]:
    """What becomes of the output when the program that drives it is killed, hangs, or is overruled."""
    from ipmclab.rig.daqmx.reset import reset

    watcher = Watcher(rig)
    try:
        with _child(rig_name, "alone", volts) as process:
            process.kill()
            process.wait()
            first, after = watcher.time_to_zero(0.5)
        held = after is None
        yield Item(
            "kill-alone",
            "the output after a kill of the program, without a guardian",
            "noted",
            f"it holds {first:.2g} V" if held else f"0 V after {after:.2f} s",
            "without the guardian nothing would bring it to 0 V" if held else "",
        )
        watcher.release()
        with _child(rig_name, "guarded", volts) as process:
            process.kill()
            yield _in_time("kill", "the output after a kill of the program, with its guardian", watcher)
        watcher.release()
        with _child(rig_name, "hang", volts):
            yield _in_time("hang", "the output after the program hangs, with its guardian", watcher)
        watcher.release()
        with _child(rig_name, "alone", volts):
            reset(rig)
            yield _in_time("reset", "the output after a reset from another process, while the program runs", watcher)
    finally:
        watcher.close()
        reset(rig)


def _in_time(name: str, what: str, watcher: Watcher) -> Item:
    first, after = watcher.time_to_zero(_LOOK)
    good = after is not None and after <= WITHIN
    found = f"it still gives {first:.2g} V after {_LOOK:g} s" if after is None else f"0 V after {after:.2f} s"
    return Item(
        name, what, "passed" if good else "failed", found, "" if good else "switch the amplifier off; report it"
    )


def _unplugged(rig: Rig, rig_name: str, volts: float, simulated: bool, ask: Ask | None) -> Item:
    """What the output gives without its cable: only a voltmeter and its reader can know."""
    name, what = "unplugged", "the output after the cable is pulled in the middle of a signal"
    if simulated:
        return Item(name, what, "noted", "a stand-in has no cable")
    if ask is None:
        return Item(name, what, "not done", "nobody was asked", "run it in a terminal, with a voltmeter at the output")
    ask(f"Put a voltmeter at the output. It is going to give {volts:g} V. Press Enter.")
    with _child(rig_name, "guarded", volts) as process:
        left = _asked_volts(ask, "Pull the cable of the chassis now. What does the voltmeter show (for example 1 V)?")
        ended = process.poll() is not None
    ask("Plug the cable in again, wait until the chassis is ready, and press Enter.")
    from ipmclab.rig.daqmx.reset import reset

    reset(rig)
    program = "the program noticed" if ended else "the program had not noticed yet"
    held = abs(left) > TOLERANCE
    return Item(name, what, "noted", f"{left:g} V by the voltmeter; {program}", _NO_WATCHDOG if held else "")


def _in_chamber(rig: Rig) -> Iterator[Item]:
    """Whether the chamber answers and comes to standby, where a program can set it."""
    if rig.chamber is None or rig.chamber.is_virtual:
        return
    with closing(open_chamber(rig.chamber)) as chamber:
        yield from chamber_items(chamber)


def _asked_volts(ask: Ask, question: str) -> float:
    """A voltage [V] that the operator reads off, asked for until it is one."""
    while True:
        try:
            return parse_quantity(ask(question), VOLTAGE, where="voltmeter")
        except InputError as error:
            question = f"{error.message}: {error.repair}."
