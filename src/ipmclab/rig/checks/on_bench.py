"""What ``rig prove`` finds while the bench runs as it does in a recording."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.rig.bench import Block
from ipmclab.rig.channels import Rig
from ipmclab.rig.checks.proof import WITHIN, Item
from ipmclab.rig.checks.prove_child import RATE
from ipmclab.rig.daqmx.look import Watcher
from ipmclab.rig.plant import DUMMY_CAPACITANCE, DUMMY_RESISTANCE
from ipmclab.rig.safety.readback import left_at_output
from ipmclab.signals import Samples, Step

if TYPE_CHECKING:
    from ipmclab.rig.ni import NiBench

FloatArray = npt.NDArray[np.float64]

_SHORT: Final = 1.0  # s of a reading
_RESISTANCE_TOLERANCE, _CAPACITANCE_TOLERANCE = 0.3, 0.5  # an electrolytic capacitor is as good as that
_OFFSET: Final = 0.005  # of the range
_NOISE: Final = 5.0  # times that of the data sheet


class WrongLoad(Exception):
    """It is not the dummy load that is in the clamp."""


def series_resistance(rig: Rig) -> float:
    """Of the dummy, the shunt and the source [ohm]."""
    return DUMMY_RESISTANCE + rig.shunt_resistance + rig.source_resistance


def on_bench(rig: Rig, volts: float) -> Iterator[Item]:
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
            raise WrongLoad
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
    usable = current > 0.05 * volts / series_resistance(rig)
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
