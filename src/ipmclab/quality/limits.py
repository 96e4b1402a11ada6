"""Readings at the end of what the instrument can read."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ipmclab.quality.noise import noise_of_readings, runs_of_true
from ipmclab.quality.record import NO_VOLTAGE, BoolArray, Channel, IntArray, Record, counted, ranges_of
from ipmclab.run import QUALITY_FLAGS, Effect, Finding

_NEAR_LIMIT: Final = 0.02  # part of the end of a range: a reading that near is at it (convention)
_ROUND: Final = (1.0, 2.0, 5.0, 10.0)  # leading digits of the ends of usual ranges (convention)
_FEWEST_QUANTA: Final = 30.0  # steps of the converter: a smaller signal is flat for its steps (convention)
_AROUND: Final = 30
"""Rows on either side of a flat top that show how noisy it is there (convention)."""
_CHANCE: Final = 1e-2  # chance that noise alone makes such a flat top (convention)


def clipping(record: Record) -> list[Finding]:
    """``clipped``: rows flagged at recording, and flat tops.

    A flat top is a run of at least three rows (four where stale readings repeat) at exactly the
    largest or smallest reading that the noise around it would not repeat so often, or that is entered and left more
    abruptly than a smooth top of rounded readings. An end at an edge of the voltage or of the
    record says nothing. The voltage is flat by its nature: of it only flagged rows are reported.
    """
    found = []
    for channel in (*record.channels.values(), record.voltage):
        flags = record.run.quality.get(channel.name)
        # A row without a reading bounds nothing.
        known = None if flags is None else ((flags & QUALITY_FLAGS["clipped"]) != 0) & np.isfinite(channel.readings)
        for top in (True, False):
            rows = _flat_rows(record, channel, top=top) if channel is not record.voltage else np.zeros(0, dtype=np.intp)
            if known is not None and known.any():
                upper = channel.readings >= (0.5 * (channel.high + channel.low) if channel.span else 0.0)
                rows = np.union1d(rows, np.flatnonzero(known & (upper if top else ~upper)))
            if len(rows):
                found.append(_clipped(record, channel, rows, top=top))
    return found


def range_limits(record: Record) -> list[Finding]:
    """``range-limit``: readings within 2 % of a limit that the run states for the channel."""
    found = []
    for name, limits in record.run.metadata.ranges.items():
        channel = record.voltage if name == record.voltage.name else record.channels.get(name)
        if channel is None:
            continue
        for limit, top in ((limits[1], True), (limits[0], False)):
            near = limit - _NEAR_LIMIT * abs(limit) if top else limit + _NEAR_LIMIT * abs(limit)
            if limit == 0.0 or not math.isfinite(limit) or (channel.high < near if top else channel.low > near):
                continue
            with np.errstate(invalid="ignore"):
                rows = np.flatnonzero(channel.readings >= near if top else channel.readings <= near)
            found.append(
                Finding(
                    code="range-limit",
                    severity="warning",
                    channel=name,
                    message=(
                        f"{counted(len(rows), 'reading')} within 2 % of the {'upper' if top else 'lower'} limit "
                        f"of the range, {channel.show(limit)}; the first is {record.at(rows[0])}"
                    ),
                    repair=_repair(channel),
                    samples=ranges_of(rows),
                    effect=_bound(channel, top=top),
                    values={"limit": float(limit), "count": len(rows), "first_row": int(rows[0])},
                )
            )
    return found


def possible_range_limit(record: Record) -> list[Finding]:
    """``possible-range-limit``: an inrush peak at a round number or a power of two of quanta, no range being stated.

    The peak is kept: nothing proves that it was cut.
    """
    if record.run.metadata.origin != "measured":
        return []
    found = []
    for channel in record.channels.values():
        if channel.name in record.run.metadata.ranges or channel.quantum == 0.0 or channel.span <= 3 * channel.quantum:
            continue
        extreme = channel.high if channel.high >= -channel.low else channel.low
        limit = _suspicious_limit(abs(extreme), channel.quantum)
        if limit is None or not _on_grid(channel):
            continue
        rows = np.flatnonzero(channel.readings == extreme)
        if not record.near_edge[rows].any() and not (np.diff(rows) == 1).any():
            continue  # a response passes any number; an inrush peak or a repeated one may have been cut
        found.append(
            Finding(
                code="possible-range-limit",
                severity="warning",
                channel=channel.name,
                message=(
                    f"the largest reading, {channel.show(extreme)} at {record.at(rows[0])}, is at {limit}: "
                    "the instrument may have cut the true peak"
                ),
                repair="the reading is kept as inrush; find out the range of the instrument and state it in the run",
                samples=ranges_of(rows),
                values={"reading": extreme, "count": len(rows), "first_row": int(rows[0])},
            )
        )
    return found


def _on_grid(channel: Channel) -> bool:
    """Whether the readings are whole multiples of their quantum (with an offset), as a converter gives them."""
    steps = channel.steps / channel.quantum
    return bool(np.abs(steps - np.rint(steps)).max() < 0.1)


def _flat_rows(record: Record, channel: Channel, *, top: bool) -> IntArray:
    none = np.zeros(0, dtype=np.intp)
    extreme = channel.high if top else channel.low
    held: BoolArray = channel.readings == extreme
    shortest = 3 if channel.stale < 0.03 else 4
    if channel.span < _FEWEST_QUANTA * channel.quantum or np.count_nonzero(held) < shortest:
        return none
    starts, stops = runs_of_true(held)
    long = stops - starts >= shortest
    noise = channel.noise
    if np.count_nonzero(held) > 0.2 * len(channel.values):
        noise = max(noise, noise_of_readings(channel.values[channel.values != extreme]))
    cut = [
        _is_cut(record, channel, start, stop, extreme, noise)
        for start, stop in zip(starts[long].tolist(), stops[long].tolist(), strict=True)
    ]
    if not any(cut):
        return none
    if starts[0] == 0 and _at_rest(record, int(stops[0])):
        held[: stops[0]] = False
    return np.flatnonzero(held)  # single readings at the level that cuts the others are cut as well


def _is_cut(record: Record, channel: Channel, start: int, stop: int, extreme: float, noise: float) -> bool:
    """Whether a run at the extreme reading begins or ends as no smooth top of rounded readings can."""
    if start == 0 and _at_rest(record, stop):
        return False
    if noise > max(3.0 * channel.quantum, 1e-6 * channel.span) and _noise_would_not_repeat(channel, start, stop, noise):
        return True
    half = 0.5 * (stop - start - 1)
    parabola = ((half + 2.0) / half) ** 2 + 1.0  # a top that stays within a quantum for the run, two rows outside it
    least = parabola * channel.quantum + 4.0 * noise
    last = len(record) - 1
    abrupt = [
        bool(abs(channel.readings[row] - extreme) >= least)
        for row, neighbour in ((start - 2, start), (stop + 1, stop))
        if 0 <= row <= last and not record.near_edge[min(neighbour, last)]
    ]
    return bool(abrupt) and all(abrupt)


def _noise_would_not_repeat(channel: Channel, start: int, stop: int, noise: float) -> bool:
    """Whether noise leaves less than one chance in a hundred that the readings near the extreme hold such a run."""
    around = np.r_[channel.readings[max(start - _AROUND, 0) : start], channel.readings[stop : stop + _AROUND]]
    around = around[np.isfinite(around) & (around != channel.readings[start])]
    noise = min(noise, noise_of_readings(around)) if len(around) >= _AROUND else noise
    again = channel.quantum / (math.sqrt(2.0 * math.pi) * noise) if noise > 0.0 else 1.0
    near = np.count_nonzero(np.abs(channel.values - channel.readings[start]) <= 4.0 * noise)
    return bool(near * min(again + channel.stale, 1.0) ** (stop - start - 1) < _CHANCE)


def _at_rest(record: Record, stop: int) -> bool:
    return not np.any(np.abs(record.run.voltage[:stop]) > NO_VOLTAGE)


def _clipped(record: Record, channel: Channel, rows: IntArray, *, top: bool) -> Finding:
    level = float(channel.readings[rows].max() if top else channel.readings[rows].min())
    return Finding(
        code="clipped",
        severity="warning",
        channel=channel.name,
        message=(
            f"{counted(len(rows), 'reading')} cut at {channel.show(level)}, the first at {record.at(rows[0])}: "
            f"the true values are {'at least' if top else 'at most'} that"
        ),
        repair=_repair(channel),
        samples=ranges_of(rows),
        effect=_bound(channel, top=top),
        values={"level": level, "count": len(rows), "first_row": int(rows[0])},
    )


def _bound(channel: Channel, *, top: bool) -> Effect:
    if channel.name == "voltage":
        return "none"  # it drives the model, which no bound can do
    return "lower_bound" if top else "upper_bound"


def _repair(channel: Channel) -> str:
    what = (
        "the strip may have had more voltage than the record says, and the model is driven with the record"
        if channel.name == "voltage"
        else "they count as bounds, not as values"
    )
    return f"{what}; record again with a larger range"


def _suspicious_limit(peak: float, quantum: float) -> str | None:
    decade = 10.0 ** math.floor(math.log10(peak))
    for digit in _ROUND:
        limit = digit * decade
        if quantum < 0.01 * limit and limit - 1.5 * quantum <= peak <= limit + 0.5 * quantum:
            return "a round full scale, to within one step of the converter"
    counts = peak / quantum
    power = 2.0 ** round(math.log2(counts))
    if 1024 <= power <= 2**24 and -1.5 <= counts - power <= 0.5:
        return f"{power:.0f} steps of {quantum:.3g}, a full scale of the converter"
    return None
