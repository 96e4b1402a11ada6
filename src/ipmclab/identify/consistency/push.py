"""A push test against the stiffness of the model."""

from __future__ import annotations

from collections.abc import Sequence

from ipmclab.identify.consistency.amounts import SURE, Amount, apart, conflict, how_sure
from ipmclab.identify.consistency.facts import Fact
from ipmclab.identify.consistency.known import Known
from ipmclab.identify.consistency.stiffness import NAMES, stiffness
from ipmclab.run import Finding

CODE = "push-against-stiffness"


def push_against_stiffness(known: Known, facts: Sequence[Fact]) -> list[Finding]:
    """``push-against-stiffness``: the slope of a force-displacement push at L_s is not Y w h^3/(4 L_s^3)."""
    found = []
    expected = Amount(stiffness(known.values), known.spread(stiffness, NAMES), "N/m")
    for fact in facts:
        if fact.metric != "stiffness":
            continue
        pushed = Amount(fact.value, fact.uncertainty, "N/m")
        sigmas = apart(pushed, expected)
        if sigmas > SURE:
            modulus = known.values["beam.modulus"] * pushed.value / expected.value
            found.append(
                conflict(
                    CODE,
                    f"{fact.where or 'the push'}: the strip pushes back with {pushed}, the model with {expected} "
                    f"(Y w h^3/(4 L_s^3)): {how_sure(sigmas)}; the push needs a modulus of {modulus * 1e-6:.3g} MPa"
                    + known.taken(NAMES),
                    "push again at the sensing point, loading and unloading, over twice the thickness: a small push "
                    "feels the metal skins, and the two branches show friction",
                    found=pushed,
                    expected=expected,
                    sigmas=sigmas,
                    more={"implied_modulus": modulus},
                )
            )
    return found
