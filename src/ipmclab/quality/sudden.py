"""Sudden changes that the voltage did not cause: isolated spikes, slips, changes of contact."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ipmclab.quality.noise import STALE_EXCESS, noise_of_readings
from ipmclab.quality.record import Channel, IntArray, Record, counted, ranges_of
from ipmclab.run import Finding

_SPIKE_ROWS: Final = 3  # rows: a spike that lasts longer is no spike (convention)
_SIGNIFICANT: Final = 8.0 * math.sqrt(2.0)  # of a difference: eight standard deviations of a reading (convention)
_NEIGHBOURS: Final = 60  # rows on either side that show the noise there (convention)
_MOST: Final = 0.02  # part of the rows: more changes beyond the noise are how the channel is (convention)
_USUAL: Final = 0.9  # part of the changes of a channel that are its usual ones (convention)
_UNUSUAL: Final = 10.0  # times these: so many changes are sudden where they are that much larger (convention)
_SMALLEST_JUMP: Final = 0.005  # part of the range of the readings: a smaller jump is none (convention)
_FEWEST_OPEN: Final = 10  # rows before it, at one voltage, that show that nothing moved (convention)
_MEAN_ROWS: Final = 5  # rows of a moving mean (convention)


def sudden_changes(record: Record) -> list[Finding]:
    """``spike``, ``slip`` (displacement, force) and ``contact-changed`` (current).

    A change from one row to the next counts when it exceeds eight standard deviations of the
    noise (of the record and of its neighbourhood) and is not within three rows of a jump of the
    voltage. It is a spike when the reading comes back within three rows. Otherwise it is a slip
    or a change of contact, if it is three times its neighbours and 0.5 % of the range.
    """
    found: list[Finding] = []
    for channel in record.channels.values():
        spikes, jumps = _changes(record, channel)
        if spikes:
            found.append(_spike(record, channel, spikes))
        if jumps:
            found.append(_jump(record, channel, jumps))
            if channel.name == "current":
                found += _lost_contact(record, channel, jumps)
    return found


def _changes(record: Record, channel: Channel) -> tuple[list[tuple[int, int]], list[tuple[int, float]]]:
    """Spikes as row ranges; jumps as (row, height)."""
    spikes: list[tuple[int, int]] = []
    jumps: list[tuple[int, float]] = []
    rows, values, steps = channel.rows, channel.values, channel.steps
    # Over a gap of the time a slow change is as large as a jump.
    time, near_in_time = record.run.time, (_SPIKE_ROWS + 0.5) * record.period
    if len(steps) < 8:
        return spikes, jumps
    if channel.stale > STALE_EXCESS:
        fresh = np.concatenate(([True], steps != 0.0))
        rows, values = rows[fresh], values[fresh]
        steps = values[1:] - values[:-1]
    least = _SIGNIFICANT * channel.noise + 2.0 * channel.quantum
    size = np.abs(steps)
    excess = size.copy()  # from the mean of the neighbouring changes, so that a fast response is none
    excess[1:-1] = np.abs(steps[1:-1] - 0.5 * (steps[2:] + steps[:-2]))
    if float(excess.max()) <= least:
        return spikes, jumps
    candidates = np.flatnonzero((size > least) & (excess > least) & ~record.near_edge[rows[1:]])
    candidates = candidates[(candidates >= 2) & (candidates < len(steps) - 2)]
    if len(candidates) > _MOST * len(steps):
        # The nature of this signal, for example an answer to random voltage, but for those far above all others.
        candidates = candidates[size[candidates] > _UNUSUAL * float(np.quantile(size, _USUAL))]
    done = -1
    for place in candidates:
        if place <= done or _with_voltage(record, int(rows[place + 1])):
            continue
        height = float(steps[place])
        back = np.cumsum(steps[place : place + 1 + _SPIKE_ROWS])
        returned = np.flatnonzero(np.abs(back[1:]) <= 0.3 * abs(height))
        # At a corner of the response, such as where a sine gives way to a rest, it comes as it came before and turns.
        leaves = abs(height - 0.5 * float(steps[place - 1] + steps[place - 2])) > least
        is_spike = leaves and len(returned) and rows[place + 1 + returned[0]] - rows[place] <= 2 * _SPIKE_ROWS
        others = np.concatenate((size[max(place - 2, 0) : place], size[place + 1 : place + 3]))
        is_jump = (
            abs(height) >= max(_SMALLEST_JUMP * channel.span, 3.0 * float(others.max()))
            and time[rows[place + 1]] - time[rows[place]] <= near_in_time
        )
        near = slice(max(place - _NEIGHBOURS, 0), place + _NEIGHBOURS)
        if not (is_spike or is_jump) or abs(height) <= _SIGNIFICANT * noise_of_readings(values[near]):
            continue
        if is_spike:
            done = int(place + 1 + returned[0])
            spikes.append((int(rows[place + 1]), int(rows[min(done + 1, len(rows) - 1)])))
        else:
            jumps.append((int(rows[place + 1]), height))
    return spikes, jumps


def _lost_contact(record: Record, channel: Channel, jumps: list[tuple[int, float]]) -> list[Finding]:
    """Stretches without current that end in a new inrush while the voltage is constant: the contact was open."""
    found = []
    for row, height in jumps:
        voltage = record.run.voltage[row]
        if height * voltage <= 0.0:
            continue
        before = channel.readings[: row - 1] * math.copysign(1.0, voltage)
        if len(before) < _MEAN_ROWS:
            continue
        means = np.convolve(before, np.full(_MEAN_ROWS, 1.0 / _MEAN_ROWS), mode="valid")
        flows = np.flatnonzero(means > 5.0 * channel.noise / math.sqrt(_MEAN_ROWS))
        start = int(flows[-1]) + _MEAN_ROWS // 2 + 1 if len(flows) else row
        held = np.abs(record.run.voltage[start:row] - voltage) < 0.05 * abs(voltage)
        if row - start < _FEWEST_OPEN or not held.all():
            continue
        found.append(
            Finding(
                code="contact-lost",
                severity="error",
                channel="current",
                message=(
                    f"at constant voltage no current flows for {row - start} rows from {record.at(start)}, and it "
                    f"comes back with an inrush of {channel.show(height)} at {record.at(row)}: the contact was open"
                ),
                repair=(
                    "the strip saw another voltage than the record says, from there on to the end: end the run before "
                    "it (leaving out the stretch alone does not mend the rest), tighten the clamp, record again"
                ),
                samples=((start, row),),
                values={"first_row": start, "count": row - start, "inrush": height},
            )
        )
    return found


def _with_voltage(record: Record, row: int) -> bool:
    """Whether the voltage has a small jump of its own there, below what counts as an edge."""
    voltage = record.run.voltage[max(row - 8, 0) : row + 8]
    size = np.abs(np.diff(voltage))
    largest = float(size.max())
    usual = float(np.partition(size, len(size) // 2)[len(size) // 2])
    return largest > max(3.0 * usual, 0.002 * float(np.abs(record.run.voltage).max()))


def _spike(record: Record, channel: Channel, spikes: list[tuple[int, int]]) -> Finding:
    rows: IntArray = np.unique(np.concatenate([np.arange(start, stop) for start, stop in spikes]))
    worst = int(rows[np.abs(channel.readings[rows] - np.median(channel.values)).argmax()])
    return Finding(
        code="spike",
        severity="warning",
        channel=channel.name,
        message=(
            f"{counted(len(spikes), 'isolated spike')}, the first at {record.at(spikes[0][0])}, "
            f"the largest reads {channel.show(float(channel.readings[worst]))}; "
            f"the noise has a standard deviation of {channel.show(channel.noise)}"
        ),
        repair="these rows are left out; look for a loose connector or a switching load nearby",
        samples=ranges_of(rows),
        effect="mask",
        values={
            "count": len(spikes),
            "first_row": spikes[0][0],
            "largest": float(channel.readings[worst]),
            "noise": channel.noise,
        },
    )


def _jump(record: Record, channel: Channel, jumps: list[tuple[int, float]]) -> Finding:
    row, height = max(jumps, key=lambda jump: abs(jump[1]))
    current = channel.name == "current"
    return Finding(
        code="contact-changed" if current else "slip",
        severity="warning",
        channel=channel.name,
        message=(
            f"the {channel.name} jumps with no jump of the voltage, {counted(len(jumps), 'time')}; the largest is "
            f"{channel.show(height)} at {record.at(row)}"
        ),
        repair=(
            "the contact changed there, so the strip no longer saw the voltage of the record: end the run before the "
            "jump, clean or tighten the clamp, and record again"
            if current
            else "something slipped or was touched there: use the part before the jump, or record again"
        ),
        samples=tuple((jump[0], jump[0] + 1) for jump in jumps),
        values={"count": len(jumps), "row": row, "height": height, "first_row": jumps[0][0]},
    )
