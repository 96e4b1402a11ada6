"""Readings that are not there: a laser that lost its target, missing values, rows masked at recording."""

from __future__ import annotations

import numpy as np

from ipmclab.quality.record import Channel, IntArray, Record, counted, ranges_of
from ipmclab.run import QUALITY_FLAGS, Finding


def lost_readings(record: Record) -> list[Finding]:
    """``laser-lost`` for the displacement, ``reading-missing`` for the others.

    Rows count that are NaN, that the importer marked as sentinel or missing, that hold one
    far value exactly and repeatedly, and far values next to such rows. Of the voltage rows are
    reported in which the recorder had to put another number.
    """
    found = [_no_reading_at_all(record, name) for name in record.empty]
    found += [_lost(record, channel) for channel in record.channels.values() if channel.missing is not None]
    flags = record.run.quality.get("voltage")
    if (
        flags is not None
        and (rows := np.flatnonzero(flags & (QUALITY_FLAGS["missing"] | QUALITY_FLAGS["sentinel"]))).size
    ):
        found.append(_filled(record, rows))
    return found


def flagged_rows(record: Record) -> list[Finding]:
    """``masked-by-operator`` and ``contact-flagged``: rows that were known when the run was recorded."""
    found = []
    for name, flags in record.run.quality.items():
        if not flags.any() or len(flags) != len(record):
            continue
        for flag, code, reason in (
            ("masked_by_operator", "masked-by-operator", "the operator masked"),
            ("contact_lost", "contact-flagged", "the bench reported no contact in"),
        ):
            rows = np.flatnonzero(flags & QUALITY_FLAGS[flag])
            if len(rows):
                found.append(
                    Finding(
                        code=code,
                        severity="info",
                        channel=name,
                        message=f"{reason} {counted(len(rows), 'row')} of the {name}, first {record.at(rows[0])}",
                        repair="these rows are left out",
                        samples=ranges_of(rows),
                        effect="mask",
                        values={"first_row": int(rows[0]), "count": len(rows)},
                    )
                )
    return found


def _lost(record: Record, channel: Channel) -> Finding:
    assert channel.missing is not None
    rows = np.flatnonzero(channel.missing)
    samples = ranges_of(rows)
    first = int(rows[0])
    laser = channel.name == "displacement"
    parts = [f"{channel.sentinels} hold the sentinel or nothing"]
    if channel.beyond:
        far = ", ".join(channel.show(value) for value in channel.beyond[:3])
        more = ", ..." if len(channel.beyond) > 3 else ""
        parts.append(f"{len(channel.beyond)} more are far out of any plausible range ({far}{more})")
    what = "the laser lost its target" if laser else f"the {channel.name} has no reading"
    return Finding(
        code="laser-lost" if laser else "reading-missing",
        severity="warning",
        channel=channel.name,
        message=(
            f"{what} in {len(rows)} of {len(record)} rows, in {counted(len(samples), 'block')}, "
            f"the first at {record.at(first)}: " + "; ".join(parts)
        ),
        repair=(
            "these rows are left out; keep the deflection inside the range of the laser, or move it nearer to the clamp"
            if laser
            else "these rows are left out; look at the wiring and the range of the channel"
        ),
        samples=samples,
        effect="mask",
        values={
            "first_row": first,
            "first_time": float(record.run.time[first]),
            "count": len(rows),
            "sentinel_count": channel.sentinels,
            "out_of_range_count": len(channel.beyond),
            "blocks": len(samples),
        },
    )


def _filled(record: Record, rows: IntArray) -> Finding:
    """The voltage drives the model, so that a number has to stand where none was read."""
    return Finding(
        code="reading-missing",
        severity="warning",
        channel="voltage",
        message=(
            f"the voltage was not read in {counted(len(rows), 'row')}, the first {record.at(rows[0])}: "
            "the commanded voltage takes its place, or the last reading"
        ),
        repair="look at the wiring and the range of the channel; see whether the current there is that of this voltage",
        samples=ranges_of(rows),
        values={"first_row": int(rows[0]), "count": len(rows)},
    )


def _no_reading_at_all(record: Record, name: str) -> Finding:
    return Finding(
        code="laser-lost" if name == "displacement" else "reading-missing",
        severity="error",
        channel=name,
        message=f"the {name} has no reading in any of the {len(record)} rows",
        repair="do not use this channel",
        samples=((0, len(record)),),
        effect="mask",
        values={"first_row": 0, "count": len(record)},
    )
