"""Currents of one sample at one voltage, across runs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import combinations

from ipmclab.consistency.fact import Fact, with_zero_first, zero_that_agrees
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
from ipmclab.run import Finding
from ipmclab.units import CURRENT

CODE = "two-states"
_ORDER = ("step", "sine", "square")


def two_states(facts: Sequence[Fact], compared: Collection[tuple[int, int]] = ()) -> list[Finding]:
    """``two-states``: runs of one sample under the same voltage draw different currents.

    Parameters
    ----------
    facts : sequence of Fact
    compared : collection of pairs of places
        Runs that were compared reading by reading already.
    """
    found = []
    for one, other in combinations([fact for fact in facts if fact.metric.endswith("_current")], 2):
        places = (one.place, other.place)
        if one.metric != other.metric or not one.like(other) or one.where == other.where or places in compared:
            continue
        large, small = (one, other) if one.value >= other.value else (other, one)
        if small.at_least:
            continue  # it may be as large as the other
        amounts = [Amount.of(fact.value, fact.uncertainty, CURRENT) for fact in (large, small)]
        sigmas = sigmas_between(*amounts)
        if sigmas > SURE:
            found.append((_ORDER.index(large.waveform), large.metric != "peak_current", sigmas, large, small, amounts))
    if not found:
        return []
    found.sort(key=lambda one: (one[0], one[1], -one[2]))
    *_, sigmas, large, small, (more, less) = found[0]
    rest = [
        f"{one[3].waveform} {one[3].metric.replace('_', ' ')} {one[5][0].number} against {one[5][1].number}"
        for one in found[1:]
    ]
    also = f"; likewise {', '.join(rest)}" if rest else ""
    bound = "at least " if large.at_least else ""
    zero = zero_that_agrees(large, small.value) + zero_that_agrees(small, large.value)
    return [
        conflict(
            CODE,
            f"under the same {large.signal} the {large.metric.replace('_', ' ')} is {bound}{more} in "
            f"{_run_of(large)} and {less} in {_run_of(small)}, {large.value / small.value:.2g} times: "
            f"{how_sure(sigmas)}; the strip, or its clamping, was in two states{also}{zero}",
            with_zero_first(
                "record one step twice in one mounting, displacement and force one after the other at the same "
                "humidity: if the currents agree, hydration or clamping made the difference, and no one parameter set "
                "fits both",
                zero,
            ),
            found=more,
            expected=less,
            sigmas=sigmas,
            channel="current",
            more={"ratio": large.value / small.value, "count": len(found)},
        )
    ]


def _run_of(fact: Fact) -> str:
    return f"{fact.where} (measured with the {fact.measured_with})" if fact.measured_with else fact.where
