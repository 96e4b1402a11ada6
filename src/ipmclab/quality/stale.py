"""Readings that are old: repeated from the row before, or stuck."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.quality.noise import runs_of_true
from ipmclab.quality.record import Channel, Record, counted, ranges_of
from ipmclab.run import Finding

_STALE: Final = 0.05  # part of the rows that are repeats beyond rounding (convention)
_STUCK_ROWS: Final = 16  # equal readings in sequence that noise does not give (convention)


def stale_readings(record: Record) -> list[Finding]:
    """``stale-values`` and ``stuck``.

    Values are stale when more rows repeat the reading before than rounded noise explains, by
    more than 5 % of the rows. A reading is stuck when at least sixteen rows in sequence are
    equal while, elsewhere, noise makes rows differ.
    """
    found = []
    for channel in record.channels.values():
        if channel.stale > _STALE:
            found.append(_stale(channel))
        found += _stuck(record, channel)
    return found


def _stale(channel: Channel) -> Finding:
    rows = channel.rows[1:][channel.steps == 0.0]
    return Finding(
        code="stale-values",
        severity="warning",
        channel=channel.name,
        message=(
            f"{len(rows)} of {len(channel.values)} readings repeat the one before; rounding explains "
            f"{max(0, len(rows) - round(channel.stale * len(channel.steps)))} of them. The rest, "
            f"{100 * channel.stale:.3g} % of the rows, were read before the channel had a new value"
        ),
        repair="their time is wrong by up to a row; read the channel no faster than it delivers",
        samples=ranges_of(rows),
        values={"fraction": channel.stale, "repeats": len(rows)},
    )


def _stuck(record: Record, channel: Channel) -> list[Finding]:
    inside = (channel.values[1:] != channel.low) & (channel.values[1:] != channel.high)  # the ends are for clipping
    equal = (channel.steps == 0.0) & inside
    repeats = int(np.count_nonzero(equal))
    if repeats < _STUCK_ROWS - 1 or channel.noise < 2.0 * channel.quantum or channel.noise < 1e-6 * channel.span:
        return []
    starts, stops = runs_of_true(equal)
    long = stops - starts >= _STUCK_ROWS - 1
    if not long.any() or (repeats - (stops - starts)[long].sum()) > 0.5 * len(equal):
        return []
    rows = np.concatenate(
        [channel.rows[start + 1 : stop + 1] for start, stop in zip(starts[long], stops[long], strict=True)]
    )
    return [
        Finding(
            code="stuck",
            severity="warning",
            channel=channel.name,
            message=(
                f"the {channel.name} is stuck at one value, {counted(int(long.sum()), 'time')}, {len(rows)} rows "
                f"in all, the first from {record.at(rows[0])}; elsewhere its noise is {channel.show(channel.noise)}"
            ),
            repair="these rows are left out; look at the instrument and its connection",
            samples=ranges_of(rows),
            effect="mask",
            values={"count": len(rows), "times": int(long.sum()), "first_row": int(rows[0])},
        )
    ]
