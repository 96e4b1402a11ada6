"""Force over displacement against other measurements of the same stiffness: whatever modulus the model has."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ipmclab.consistency.fact import Fact, with_zero_first
from ipmclab.consistency.flick import NAMES as OF_RING
from ipmclab.consistency.known import KnownStrip, Values
from ipmclab.consistency.push import doubted
from ipmclab.consistency.stiffness import Motion, stiffness
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
from ipmclab.model.stages.beam import resonance
from ipmclab.run import Finding

PUSHED = "push-against-motion"
RANG = "resonance-against-motion"
_POINT = ("geometry.sensing_length",)
_MASS = (*(name for name in OF_RING if name != "beam.modulus"), "geometry.width", *_POINT)


def push_against_motion(known: KnownStrip, facts: Sequence[Fact], motions: Sequence[Motion]) -> list[Finding]:
    """``push-against-motion``: the slope of a push is not blocked force over free displacement under one voltage.

    Both are the stiffness at the sensing point, so that the modulus of the model does not count. Where the model has
    slow modes, by which force and displacement differ, its ratio over its stiffness is taken off. They are known at
    one point as far as the sensing length is.
    """
    measured = [fact for fact in facts if fact.metric == "stiffness"]
    if not (measured and motions):
        return []
    at_point = known.standard_uncertainty(stiffness, _POINT) / stiffness(known.values)

    def both(push: Fact, one: Motion) -> tuple[Amount, Amount]:
        error = math.hypot(push.uncertainty, at_point * push.value)
        return _static(known, one), Amount(push.value, error, "N/m")

    worst = _worst(measured, motions, both)
    if worst is None:
        return []
    sigmas, still, pushed, push, one, also = worst
    if_pushed, if_moved = _ring(known, pushed.value), _ring(known, still.value)
    zeros = _zeros_that_agree(known, one, pushed.value)
    return [
        conflict(
            PUSHED,
            f"force over displacement is {still} ({one.said}{_taken_off(known, one)}), {push.where or 'the push'} "
            f"gives {pushed}, {_times(pushed, still)}: {how_sure(sigmas)}, whatever modulus the model has{also}"
            f"{doubted(push)}{zeros}" + known.taken(_POINT),
            with_zero_first(
                f"flick the strip at 0 V with the laser at 1 kS/s: it rings at {if_pushed:.3g} Hz if the push is right "
                f"and at {if_moved:.3g} Hz if the motion is; if the push is right, record force and displacement of "
                "one step in one mounting: the strip may have been in two states",
                zeros,
            ),
            found=still,
            expected=pushed,
            sigmas=sigmas,
            more={"resonance": if_pushed, "implied_resonance": if_moved},
        )
    ]


def resonance_against_motion(known: KnownStrip, facts: Sequence[Fact], motions: Sequence[Motion]) -> list[Finding]:
    """``resonance-against-motion``: the strip does not ring as force over displacement says.

    Density and dimensions give the mass, blocked force over free displacement the stiffness: the modulus of the model
    cancels.
    """

    def of_one(values: Values) -> float:
        return resonance(values).frequency / math.sqrt(stiffness(values))

    measured = [fact for fact in facts if fact.metric == "resonance"]
    if not (measured and motions):
        return []
    mass = known.standard_uncertainty(of_one, _MASS) / of_one(known.values)

    def both(flick: Fact, one: Motion) -> tuple[Amount, Amount]:
        still = _static(known, one)
        frequency = _ring(known, still.value)
        error = math.hypot(0.5 * still.uncertainty / still.value, mass) * frequency
        return Amount(flick.value, flick.uncertainty, "Hz"), Amount(frequency, error, "Hz")

    worst = _worst(measured, motions, both)
    if worst is None:
        return []
    sigmas, rings, expected, flick, one, also = worst
    still = _static(known, one)
    if_rung = still.value * (rings.value / expected.value) ** 2
    zeros = _zeros_that_agree(known, one, if_rung)
    return [
        conflict(
            RANG,
            f"{flick.where or 'the flick'}: the strip rings at {rings}, but with force over displacement of {still} "
            f"({one.said}{_taken_off(known, one)}) and its mass it would ring at {expected}: {how_sure(sigmas)}, "
            f"whatever modulus the model has{also}{zeros}" + known.taken(_MASS),
            with_zero_first(
                f"push the strip at the sensing point with the load cell at 0 V, in and out: the slope is "
                f"{if_rung:.3g} N/m if the flick is right and {still.value:.3g} N/m if the motion is; weigh the strip, "
                "too",
                zeros,
            ),
            found=rings,
            expected=expected,
            sigmas=sigmas,
            channel="displacement",
            more={"stiffness": still.value, "implied_stiffness": if_rung},
        )
    ]


def _worst(
    measured: Sequence[Fact], motions: Sequence[Motion], both: Callable[[Fact, Motion], tuple[Amount, Amount]]
) -> tuple[float, Amount, Amount, Fact, Motion, str] | None:
    """The pair to report of those that contradict each other, a step first, and a clause that names the others."""
    found = []
    for fact in measured:
        for one in motions:
            if not fact.in_conditions_of(one.force):
                continue
            first, second = both(fact, one)
            sigmas = sigmas_between(first, second)
            if sigmas > SURE:
                found.append((sigmas, first, second, fact, one))
    if not found:
        return None
    found.sort(key=lambda each: (each[4].order, -each[0]))
    others = [f"{one.force.waveform} {first.number} against {second.number}" for _, first, second, _, one in found[1:]]
    return *found[0], f"; likewise {', '.join(others)}" if others else ""


def _static(known: KnownStrip, one: Motion) -> Amount:
    """The stiffness [N/m] that a force over a displacement says, without what the model's slow modes add."""
    share = stiffness(known.values) / one.model
    value = share * one.measured.value
    return Amount(value, math.hypot(share * one.measured.uncertainty, one.slow * value), "N/m")


def _zeros_that_agree(known: KnownStrip, one: Motion, still: float) -> str:
    """Clauses with the zeros by which force over displacement would say another stiffness [N/m]."""
    return one.zeros_that_agree(still * one.model / stiffness(known.values))


def _taken_off(known: KnownStrip, one: Motion) -> str:
    share = one.model / stiffness(known.values)
    return f", less the slow modes of the model, {share:.3g} times" if abs(share - 1.0) > 0.01 else ""


def _times(large: Amount, small: Amount) -> str:
    return f"{large.value / small.value:.2g} times it"


def _ring(known: KnownStrip, still: float) -> float:
    """Resonance [Hz] with another stiffness at the sensing point."""
    return resonance(known.values).frequency * math.sqrt(still / stiffness(known.values))
