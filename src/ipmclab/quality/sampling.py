"""The clock of the record."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.quality.record import IntArray, Record, counted, ranges_of
from ipmclab.run import Finding

_MOVES: Final = 0.05  # of the largest voltage (convention)


def _moving(record: Record, gaps: IntArray) -> int:
    """Behind how many of these rows is a gap within whose length, before it and after, the voltage changes."""
    time, voltage = record.run.time, record.run.voltage
    before, after = time[gaps], time[gaps + 1]
    begins = np.searchsorted(time, before - (after - before))
    ends = np.maximum(np.searchsorted(time, after + (after - before)), gaps + 2)
    still = _MOVES * float(np.abs(voltage).max())
    return sum(bool(np.ptp(voltage[begin:end]) > still) for begin, end in zip(begins, ends, strict=True))


def sampling(record: Record) -> list[Finding]:
    """``sampling-period-unknown``, ``sampling-irregular`` and ``rows-missing``.

    Rows are missing where the time between two rows exceeds one and a half periods. The
    sampling is irregular when the period varies by more than a millionth (information, for
    example rounded times) or a twentieth (warning).
    """
    found = []
    period = record.period
    if not record.run.metadata.sampling_period_known:
        found.append(
            Finding(
                code="sampling-period-unknown",
                severity="warning",
                message=f"the file did not hold its sampling period; {period:.6g} s was assumed",
                repair=(
                    "every time constant and every frequency scales with it: find the true period, "
                    "or compare only with runs of the same clock"
                ),
                values={"period": period},
            )
        )
    if record.run.is_uniform:
        return found
    steps = record.run.time[1:] - record.run.time[:-1]
    gaps = np.flatnonzero(steps > 1.5 * period)
    if len(gaps):
        lost = int(np.rint(steps[gaps] / period - 1.0).sum())
        moving = _moving(record, gaps)
        of_them = "it" if len(gaps) == 1 else f"{moving} of them"
        found.append(
            Finding(
                code="rows-missing",
                severity="warning",
                message=(
                    f"about {counted(lost, 'row')} missing in {counted(len(gaps), 'gap')} of the time, "
                    f"the first after {record.at(int(gaps[0]))}"
                    f"{f'; the voltage changes about {of_them}, and its course in between is lost' if moving else ''}"
                ),
                repair="the voltage inside the gaps is unknown: use a part without gaps, or record again",
                samples=ranges_of(gaps + 1),
                values={"gaps": len(gaps), "rows": lost, "longest": float(steps.max()), "moving": moving},
            )
        )
    regular = steps[steps <= 1.5 * period]
    jitter = float(np.abs(regular - period).max()) / period
    if jitter > 1e-6:
        found.append(
            Finding(
                code="sampling-irregular",
                severity="warning" if jitter > 0.05 else "info",
                message=(f"the time between rows varies by up to {100 * jitter:.3g} % around {period:.6g} s"),
                repair="the times of the record are used as they are; check that they are true",
                values={"period": period, "largest_deviation": jitter},
            )
        )
    return found
