"""What becomes of the output, in ``rig prove``, when the program or the cable that drives it fails."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import python_child
from ipmclab.rig.channels import Rig
from ipmclab.rig.checks.proof import WITHIN, Item
from ipmclab.rig.daqmx.look import Watcher
from ipmclab.rig.safety.readback import TOLERANCE
from ipmclab.units import VOLTAGE, parse_quantity

Ask = Callable[[str], str]

_LOOK: Final = 5.0  # s: for so long the output is watched
_NO_WATCHDOG: Final = "this hardware holds its output then: put an emergency stop into the supply of the amplifier"


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


def from_outside(rig: Rig, rig_name: str, volts: float) -> Iterator[Item]:
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


def unplugged(rig: Rig, rig_name: str, volts: float, simulated: bool, ask: Ask | None) -> Item:
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


def _asked_volts(ask: Ask, question: str) -> float:
    """A voltage [V] that the operator reads off, asked for until it is one."""
    while True:
        try:
            return parse_quantity(ask(question), VOLTAGE, where="voltmeter")
        except InputError as error:
            question = f"{error.message}: {error.repair}."
