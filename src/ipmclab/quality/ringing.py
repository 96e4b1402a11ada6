"""A resonance that the sampling rate cannot show as it is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from ipmclab.quality.record import Record
from ipmclab.run import Finding

if TYPE_CHECKING:
    from ipmclab.model import Actuator

_ROWS: Final = 20  # rows after an edge that are looked at (convention)
_SIGNIFICANT: Final = 8.0  # standard deviations: beyond any noise (convention)


def measured_ringing(record: Record) -> list[Finding]:
    """``resonance-may-alias``: the displacement rings after edges of the voltage.

    The second differences of the rows after the edges (averaged over the edges, each with its
    sign) must exceed eight times their noise and follow a damped oscillation
    ``e[k] = a e[k-1] + b e[k-2]`` with 80 % of their power. From the rows alone, an oscillation
    at f and its images at rate - f, rate + f, ... look the same.
    """
    channel = record.channels.get("displacement")
    if channel is None or not len(record.edges) or channel.missing is not None:
        return []
    room = (record.ends - record.edges >= _ROWS + 2) & record.constant_after
    edges, heights = record.edges[room], record.heights[room]
    if not len(edges):
        return []
    windows = channel.readings[edges[:, None] + np.arange(1, _ROWS + 2)]
    shape = heights @ windows / float(heights @ heights)
    noise = channel.noise / math.sqrt(float(heights @ heights))
    bend = shape[2:] - 2.0 * shape[1:-1] + shape[:-2]
    if float(np.abs(bend).max()) < _SIGNIFICANT * math.sqrt(6.0) * noise:
        return []
    before = np.column_stack((bend[1:-1], bend[:-2]))
    (a, b), *_ = np.linalg.lstsq(before, bend[2:], rcond=None)
    rest = bend[2:] - before @ (a, b)
    if float(rest @ rest) > 0.2 * float(bend[2:] @ bend[2:]) or a * a + 4.0 * b >= 0.0 or not 0.0 < -b < 1.0:
        return []
    angle = math.acos(max(-1.0, min(1.0, 0.5 * a / math.sqrt(-b))))
    if angle < math.pi / 8.0:
        return []  # sixteen rows to a period: visible as it is
    rate = 1.0 / record.period
    apparent = angle / (2.0 * math.pi) * rate
    amplitude = float(np.abs(bend).max()) / (4.0 * math.sin(angle / 2.0) ** 2) * float(np.abs(heights).max())
    return [
        Finding(
            code="resonance-may-alias",
            severity="warning",
            channel="displacement",
            message=(
                f"after edges of the voltage the displacement rings by {channel.show(amplitude)} (noise "
                f"{channel.show(channel.noise)}) at an apparent {apparent:.4g} Hz; at {rate:.4g} samples per second "
                f"the true frequency may as well be {rate - apparent:.4g} Hz or higher"
            ),
            repair=f"record the step once at {4 * math.ceil(rate):d} samples per second or more to decide which it is",
            values={"apparent_frequency": apparent, "image_frequency": rate - apparent, "amplitude": amplitude},
        )
    ]


def predicted_ringing(record: Record, actuator: Actuator) -> list[Finding]:
    """``resonance-aliased``: the actuator's beam resonates above half the rate, and its ring exceeds the noise.

    The ring is the difference between the displacement that the actuator predicts for this run
    and that of the same actuator with the lightest beam.
    """
    from dataclasses import replace

    from ipmclab.model import simulate
    from ipmclab.model.stages.beam import WEIGHTLESS
    from ipmclab.model.stages.beam import resonance as first_mode

    channel = record.channels.get("displacement")
    if channel is None or record.run.hold == "unknown":
        return []
    resonance = first_mode(actuator.parameter_values).frequency
    rate = 1.0 / record.period
    if resonance < 0.5 * rate:
        return []
    light = actuator.replace(**WEIGHTLESS)
    run = replace(record.run, quality={})
    with_beam, without = simulate(actuator, run).displacement, simulate(light, run).displacement
    assert with_beam is not None
    assert without is not None
    ring = float(np.nanmax(np.abs(with_beam - without), initial=0.0))  # a laser may have lost the strip
    if ring < 3.0 * channel.noise:
        return []
    image = abs(resonance - rate * round(resonance / rate))
    return [
        Finding(
            code="resonance-aliased",
            severity="warning",
            channel="displacement",
            message=(
                f"the beam resonates at {resonance:.4g} Hz; at {rate:.4g} samples per second that looks like "
                f"{image:.4g} Hz, with {channel.show(ring)} against a noise of {channel.show(channel.noise)}"
            ),
            repair=f"record at {math.ceil(4.0 * resonance):d} samples per second or more, or filter before sampling",
            values={"resonance": resonance, "apparent_frequency": image, "amplitude": ring},
        )
    ]
