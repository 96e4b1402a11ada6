"""The slope of a push against the stiffness of the model, and pushes in runs at 0 V."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.consistency.fact import Fact
from ipmclab.consistency.facts import label_of
from ipmclab.consistency.known import KnownStrip
from ipmclab.consistency.stiffness import NAMES, stiffness
from ipmclab.errors import InputError
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
from ipmclab.measurement.push import CALIBRATION, USUAL_SCALES, Push, in_contact
from ipmclab.measurement.push import stiffness as slope_of_push
from ipmclab.measurement.uncertain import Uncertain
from ipmclab.quality.check import check_record
from ipmclab.quality.kept import kept
from ipmclab.quality.record import Record
from ipmclab.quality.usable import unmasked
from ipmclab.run import Finding, FloatArray, Run

CODE = "push-against-stiffness"

_READINGS: Final = 120
"""Means that a record is brought down to: noise goes, and drift is not taken for so many independent readings
(convention)."""

_LEAST_TRAVEL: Final = 50e-6  # m, a fifth of the thickness of a usual strip (convention)
_MOST_WAYS: Final = 20  # a push in and out repeated ten times: more is no push (convention)
_SLOWEST_RING: Final = 0.5
"""A way in or out takes longer [s] than half a period of the slowest ring (convention)."""

_BETWEEN: Final = 3  # readings in each quarter of the travel: two positions show no line (convention)
_STRAIGHT: Final = 0.95  # of the variance of the force that one line has to explain (convention)
_KNOWN: Final = 0.25  # relative uncertainty from which a slope is none (convention)


def pushes(runs: Sequence[Run]) -> tuple[Fact, ...]:
    """The stiffnesses that runs at 0 V show, in which the load cell pushes the strip in and out.

    There is a fact only where force and displacement go along one line, in and out, slowly, over 50 um or more.

    Parameters
    ----------
    runs : sequence of Run
    """
    found = []
    for place, run in enumerate(runs):
        pushed = push_of(run)
        if pushed is not None:
            slope, doubts = pushed
            sample = run.metadata.sample.id if run.metadata.sample else None
            where = label_of(run, place)
            found.append(
                Fact(
                    sample,
                    "push",
                    "stiffness",
                    slope.value,
                    slope.uncertainty,
                    where=where,
                    place=place,
                    doubts=doubts,
                    temperature=run.metadata.temperature,
                    relative_humidity=run.metadata.relative_humidity,
                )
            )
    return tuple(found)


def push_of(run: Run) -> tuple[Uncertain, str] | None:
    """Slope of a push [N/m] and what is wrong with it in words; None where the run is no push.

    Parameters
    ----------
    run : Run
    """
    return kept(run, "push", partial(_push_of, run))


def _push_of(run: Run) -> tuple[Uncertain, str] | None:
    record = Record.of(run)
    if record.excited or not {"displacement", "force"} <= record.channels.keys():
        return None
    good = unmasked(run, check_record(record))
    x, f = (np.where(good[name], record.channels[name].readings, np.nan) for name in ("displacement", "force"))
    time, x, f = _means(run.time, x, f)
    if len(x) < 8 or float(np.ptp(x)) < _LEAST_TRAVEL:
        return None
    # Counted from where it began and in the direction in which it went; either channel may have the other sign.
    x = x - x[0]
    x = x if float(np.max(x)) >= -float(np.min(x)) else -x
    f = f - f[0]
    f = f if float(x @ (f - np.mean(f))) >= 0.0 else -f
    push = Push(x, f, USUAL_SCALES)
    try:
        slope, findings = slope_of_push(push)
    except InputError:
        return None
    x, f, ways, touching, _ = in_contact(push)
    if not _in_and_out(time[touching], x[touching], ways[touching]) or _explained(x[touching], f[touching]) < _STRAIGHT:
        return None
    if slope.without({CALIBRATION}).uncertainty > _KNOWN * slope.value:
        return None
    return slope, "; ".join(finding.message for finding in findings if finding.severity == "warning")


def _means(time: FloatArray, x: FloatArray, f: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of neighbours, of the rows that have both readings."""
    both = np.isfinite(x) & np.isfinite(f)
    size = max(1, math.ceil(np.count_nonzero(both) / _READINGS))
    starts = np.arange(0, np.count_nonzero(both) - size + 1, size)
    columns = (np.add.reduceat(one[both][: len(starts) * size], starts) / size for one in (time, x, f))
    return tuple(columns) if len(starts) else (time[:0], x[:0], f[:0])  # type: ignore[return-value]


def _in_and_out(time: FloatArray, x: FloatArray, ways: npt.NDArray[np.intp]) -> bool:
    """Whether the strip was pushed both ways, over half the travel or more, and not so fast that it rings."""
    numbers = np.unique(ways)
    if len(numbers) > _MOST_WAYS:
        return False
    directions = set()
    for number in numbers:
        rows = np.flatnonzero(ways == number)
        if len(rows) < 4 or float(np.ptp(x[rows])) < 0.5 * float(np.ptp(x)):
            continue
        if float(time[rows[-1]] - time[rows[0]]) < _SLOWEST_RING:
            return False
        directions.add(int(number) % 2)
    quarters = np.histogram(x, 4)[0]
    return len(directions) == 2 and bool(np.all(quarters >= _BETWEEN))


def _explained(x: FloatArray, f: FloatArray) -> float:
    """What part of the variance of the force one straight line explains."""
    return float(np.corrcoef(x, f)[0, 1] ** 2) if float(np.ptp(f)) > 0.0 else 0.0


def push_against_stiffness(known: KnownStrip, facts: Sequence[Fact]) -> list[Finding]:
    """``push-against-stiffness``: the slope of a force-displacement push at L_s is not Y w h^3/(4 L_s^3)."""
    measured = [fact for fact in facts if fact.metric == "stiffness"]
    if not measured:
        return []
    found = []
    expected = Amount(stiffness(known.values), known.standard_uncertainty(stiffness, NAMES), "N/m")
    for fact in measured:
        pushed = Amount(fact.value, fact.uncertainty, "N/m")
        sigmas = sigmas_between(pushed, expected)
        if sigmas > SURE:
            modulus = known.values["beam.modulus"] * pushed.value / expected.value
            found.append(
                conflict(
                    CODE,
                    f"{fact.where or 'the push'}: the strip pushes back with {pushed}, the model with {expected} "
                    f"(Y w h^3/(4 L_s^3)): {how_sure(sigmas)}; the push needs a modulus of {modulus * 1e-6:.3g} MPa in "
                    f"place of {known.values['beam.modulus'] * 1e-6:.4g} MPa{doubted(fact)}" + known.taken(NAMES),
                    "push again at the sensing point, loading and unloading, over twice the thickness: a small push "
                    "feels the metal skins, and the two branches show friction",
                    found=pushed,
                    expected=expected,
                    sigmas=sigmas,
                    more={"implied_modulus": modulus},
                )
            )
    return found


def doubted(push: Fact) -> str:
    """A clause with what is wrong with a push, empty where nothing is."""
    return f"; of this push: {push.doubts}" if push.doubts else ""
