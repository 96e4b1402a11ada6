"""Current that rises at constant voltage."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ipmclab.quality.record import Record
from ipmclab.run import Finding

_BLOCKS: Final = 40  # means of a stretch that are compared (convention)
_SHORTEST: Final = 200  # rows: five in each mean (convention)


def rising_current(record: Record) -> list[Finding]:
    """``current-rises``: after a step from rest the current grows again.

    The current that a network of resistors and capacitors draws after a step from rest can
    only fall. The mean of a block of rows (a fortieth of the stretch) must exceed the lowest
    mean before it by eight standard errors, by 2 % of the peak and by a tenth of that lowest mean.
    """
    channel = record.channels.get("current")
    if channel is None or not record.steps_from_rest or not record.constant_after[0]:
        return []
    edge, end = int(record.edges[0]), int(record.ends[0])
    if end - edge < _SHORTEST or record.run.metadata.starts_from_rest is False:
        return []
    sign = math.copysign(1.0, float(record.heights[0]))
    current = sign * channel.readings[edge:end]
    if channel.missing is not None and channel.missing[edge:end].any():
        return []
    peak = int(current.argmax()) if float(current.argmax()) < 0.2 * len(current) else 0
    current = current[peak:]
    rows = len(current) // _BLOCKS
    blocks = current[: rows * _BLOCKS].reshape(_BLOCKS, rows)
    means = blocks.mean(axis=1)
    lowest = np.minimum.accumulate(means)
    rise = means - lowest
    top = int(rise.argmax())
    if rise[top] <= 0.02 * float(current.max()) or rise[top] < 6.0 * channel.noise / math.sqrt(rows):
        return []
    low = int(means[: top + 1].argmin())
    scatter = np.abs(np.diff(means, 2))
    wander = float(np.partition(scatter, len(scatter) // 2)[len(scatter) // 2]) / 0.6745 / math.sqrt(6.0)
    own = math.sqrt((float(blocks[low].var()) + float(blocks[top].var())) / rows)
    error = max(own, math.sqrt(2.0) * wander, channel.noise * math.sqrt(2.0 / rows))
    if rise[top] < 8.0 * error or rise[top] < 0.1 * abs(float(means[low])):
        return []
    # The mean of a block is the current in its middle.
    first, second = (edge + peak + block * rows + rows // 2 for block in (low, top))
    return [
        Finding(
            code="current-rises",
            severity="warning",
            channel="current",
            message=(
                f"at constant voltage the current rises from {channel.show(sign * float(means[low]))} at "
                f"{record.at(first)} to {channel.show(sign * float(means[top]))} at {record.at(second)}"
            ),
            repair=(
                "resistors and capacitors with constant values cannot do that: look for electrolysis, drying, heating "
                "or a changing contact. Identify from the part before (rows of the import map), or try a leak that "
                "grows: identify ACTUATOR+leak.exponential+leak.slow with --free electrical,leak"
            ),
            samples=((first, second + 1),),
            values={
                "low": sign * float(means[low]),
                "high": sign * float(means[top]),
                "low_row": first,
                "high_row": second,
                "standard_error": error,
            },
        )
    ]
