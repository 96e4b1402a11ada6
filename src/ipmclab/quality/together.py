"""Runs of one sample compared with each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from ipmclab.confidence import REJECT
from ipmclab.kinds import tell_kinds
from ipmclab.quality.change import Change, change_of
from ipmclab.quality.metrics import shows_zero
from ipmclab.quality.record import GUARD_ROWS, Channel, Record
from ipmclab.run import Finding, FloatArray, Run

_VOLTAGE_AGREES: Final = 0.01  # part of the largest voltage by which equal voltages may differ (convention)
_FEWEST: Final = 20  # rows that are compared at least (convention)
_STRETCHES: Final = 20  # of a record, in each of which a change is looked for (convention)
_ERRORS: Final = 6.0  # standard errors of the mean of a stretch that a change has at least (convention)
_SHARE: Final = 0.02  # and of the response (convention)
_SAME_ALL_THE_TIME: Final = 0.02  # part of an offset by which it may change and still be one (convention)


@tell_kinds
def check_together(runs: Sequence[Run]) -> tuple[Finding, ...]:
    """Compare the runs of one sample whose voltages agree up to a time.

    Up to that time the responses must agree too, if the strip was in the same state: no model
    is needed. The runs are aligned at their first voltage edge. ``state-changed`` is a warning
    with the ratio of the responses and the root mean square of their difference against the
    noise; ``state-unchanged`` says that a comparison found no difference, ``same-run-twice`` that
    there was nothing to compare. Runs whose voltages differ from the start, or whose sample ids
    differ, are not compared.

    Parameters
    ----------
    runs : sequence of Run

    Returns
    -------
    findings : tuple of Finding
        ``values`` hold the places ``first`` and ``second`` of the runs in the sequence, the
        ``until`` time [s] after the edge, ``ratio`` (second over first), ``difference`` (root
        mean square, SI) and ``noise`` (of that difference).

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab.run import Run
    >>> time = np.arange(500) / 50.0
    >>> rng = np.random.default_rng(20261121)
    >>> def step(gain):
    ...     current = gain * np.exp(-time / 2.0) + rng.normal(0.0, 1e-4, 500)
    ...     return Run.from_arrays(time=time, voltage=np.ones(500), current=current)
    >>> [finding.code for finding in check_together([step(0.06), step(0.06), step(0.03)])]
    ['state-unchanged', 'state-changed', 'state-changed']
    """
    records = [_with_rows_of_gaps(Record.of(run)) for run in runs]
    found: list[Finding] = []
    contents = [record.run.content_sha256 for record in records]
    for (first, one), (second, other) in itertools.combinations(enumerate(records), 2):
        ids = {record.run.metadata.sample.id for record in (one, other) if record.run.metadata.sample}
        if len(ids) > 1:
            continue
        if contents[first] == contents[second]:
            found.append(_twice(_name(one, first), _name(other, second), (first, second)))
        else:
            found += _compare(first, one, second, other)
    return tuple(found)


def _twice(one: str, other: str, places: tuple[int, int]) -> Finding:
    return Finding(
        code="same-run-twice",
        severity="warning",
        message=f"{other} is the same record as {one}, to the last digit",
        repair="give each record once: a fit of both is refused",
        values={"first": places[0], "second": places[1]},
    )


def _compare(first: int, one: Record, second: int, other: Record) -> list[Finding]:
    if not one.excited or not other.excited or abs(one.period / other.period - 1.0) > 1e-3:
        return []
    starts = [one.first_edge, other.first_edge]
    lead = min(starts[0], starts[1])
    begins = [start - lead for start in starts]
    rows = min(len(one) - begins[0], len(other) - begins[1])
    voltages = [record.run.voltage[begin : begin + rows] for record, begin in zip((one, other), begins, strict=True)]
    largest = max(float(np.abs(voltages[0]).max()), float(np.abs(voltages[1]).max()))
    differs = np.flatnonzero(np.abs(voltages[0] - voltages[1]) > _VOLTAGE_AGREES * largest)
    stop = int(differs[0]) if len(differs) else rows
    if stop - lead < _FEWEST or np.abs(voltages[0][:stop]).max() < 0.1 * largest:
        return []
    found = []
    places, names = (first, second), (_name(one, first), _name(other, second))
    seconds = float(one.run.time[begins[0] + stop - 1] - one.run.time[begins[0] + lead])
    for name in one.channels.keys() & other.channels.keys():
        pair = [_from_rest(record, name, begin, lead, stop) for record, begin in zip((one, other), begins, strict=True)]
        both = np.isfinite(pair[0].values) & np.isfinite(pair[1].values)
        noise = math.hypot(one.channels[name].noise, other.channels[name].noise)
        if np.count_nonzero(both) < _FEWEST or _is_noise(pair[0].values[both], noise):
            continue
        read = np.zeros(stop, dtype=bool)
        read[stop - len(both) :] = both
        former, latter = (response.values[both] for response in pair)
        at_rest = [response.rest for response in pair if response.rest]
        change = change_of(former, latter, voltages[0][:stop], read, at_rest=at_rest)
        finding = _difference(one.channels[name], former, latter, noise, seconds, places, names, change)
        unshown = [label for record, label in zip((one, other), names, strict=True) if not shows_zero(record.run, name)]
        found.append(_or_a_zero(finding, latter - former, noise, unshown, one))
    return sorted(found, key=lambda finding: finding.channel or "")


def _with_rows_of_gaps(record: Record) -> Record:
    """The record with a row at each tick of its clock: one that is missing has no reading, and the voltage before it.

    Rows are compared by their places behind the edge. A record of which less than half is there stays as it is.
    """
    run = record.run
    if run.is_uniform:
        return record
    places = np.rint((run.time - run.time[0]) / record.period).astype(np.intp)
    count = int(places[-1]) + 1
    if not len(run) < count <= 2 * len(run) or np.any(np.diff(places) < 1):
        return record
    before = np.searchsorted(places, np.arange(count), side="right") - 1
    is_read = np.isin(np.arange(count), places)

    def spread(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else np.where(is_read, values[before], np.nan)

    return Record.of(
        Run(
            time=np.interp(np.arange(count), places, run.time),
            voltage=run.voltage[before],
            current=spread(run.current),
            displacement=spread(run.displacement),
            force=spread(run.force),
            hold=run.hold,
            metadata=run.metadata,
            file=run.file,
        )
    )


def _name(record: Record, place: int) -> str:
    """A run as messages name it: its place, and what it says of its file and mounting."""
    about = record.run.metadata
    mounting = f"mounting {about.mounting_id}" if about.mounting_id else ""
    text = ", ".join(filter(None, (record.run.name, mounting)))
    return f"run {place} ({text})" if text else f"run {place}"


class _Response(NamedTuple):
    """Readings from behind the edge on, less the mean of so many before it."""

    values: FloatArray
    rest: int


def _from_rest(record: Record, name: str, begin: int, lead: int, stop: int) -> _Response:
    """A response, counted from rest where the record has rows before the edge."""
    readings = record.channels[name].readings[begin : begin + stop]
    before = readings[: max(lead - GUARD_ROWS, 0)]
    count = int(np.isfinite(before).sum())
    count = count if count >= GUARD_ROWS else 0
    rest = float(np.nanmean(before)) if count else 0.0
    return _Response(readings[lead + GUARD_ROWS if lead else 0 :] - rest, count)


def _is_noise(response: FloatArray, noise: float) -> bool:
    """Whether there is nothing but noise to compare."""
    size = math.sqrt(float(response.dot(response)) / len(response))
    return size == 0.0 or size < 2.0 * noise


def _difference(
    channel: Channel,
    one: FloatArray,
    other: FloatArray,
    noise: float,
    seconds: float,
    places: tuple[int, int],
    names: tuple[str, str],
    change: Change,
) -> Finding:
    power = float(one.dot(one))
    difference = other - one
    rms = math.sqrt(float(difference.dot(difference)) / len(difference))
    ratio = float(one.dot(other)) / power
    # Of what follows the voltage in a stretch the size counts: the mean of whole periods is none.
    largest = math.sqrt(float(_stretches(change.course**2).max()))
    least = max(_error(noise, one), _SHARE * math.sqrt(power / len(one)))
    changed = change.p_value < REJECT and largest > least
    numbers = (
        f"{channel.name}: over {seconds:.4g} s of equal voltage {names[1]} reads {ratio:.3g} times {names[0]}; the "
        f"difference is {channel.show(rms)} (root mean square) against a noise of {channel.show(noise)}"
    )
    return Finding(
        code="state-changed" if changed else "state-unchanged",
        severity="warning" if changed else "info",
        channel=channel.name,
        message=numbers,
        repair=(
            "the strip was not in the same state: do not fit both runs with one set of parameters, or free what "
            "changed per run; equalise hydration and clamping before recording again"
            if changed
            else ""
        ),
        values={
            "first": places[0],
            "second": places[1],
            "until": seconds,
            "ratio": ratio,
            "difference": rms,
            "noise": noise,
        },
    )


def _error(noise: float, values: FloatArray) -> float:
    """Six standard errors of the mean of a stretch, if no reading says anything of its neighbour."""
    return _ERRORS * noise / math.sqrt(max(1, len(values) // _STRETCHES))


def _stretches(values: FloatArray) -> FloatArray:
    """Means over some twenty stretches."""
    rows = max(1, len(values) // _STRETCHES)
    return np.asarray(values[: len(values) // rows * rows].reshape(-1, rows).mean(axis=1))


def _or_a_zero(finding: Finding, difference: FloatArray, noise: float, unshown: list[str], record: Record) -> Finding:
    """A difference that is the same all the time is that of a zero where a record shows none: it is reported too."""
    if finding.code != "state-changed" or not unshown:
        return finding
    means = _stretches(difference)
    zero = float(np.mean(means))
    if float(np.abs(means - zero).max()) > max(_error(noise, difference), _SAME_ALL_THE_TIME * abs(zero)):
        return finding
    channel = record.channels[str(finding.channel)]
    rest = "rests" if len(unshown) == 1 else "rest"
    return replace(
        finding,
        message=f"{finding.message}; it is the same all the time: {' and '.join(unshown)} {rest} too short before the "
        f"voltage to show the zero of the {finding.channel}, and one of {channel.show(abs(zero))} explains it as well",
        repair=f"record 5 s at 0 V before the first edge, which shows the zero; if the difference stays, "
        f"{finding.repair}",
        values={**finding.values, "zero": zero},
    )
