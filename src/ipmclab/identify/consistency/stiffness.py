"""Force over displacement against the stiffness of the model, which a push test gave it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ipmclab.identify.consistency.amounts import SURE, Amount, apart, conflict, how_sure
from ipmclab.identify.consistency.facts import Fact
from ipmclab.identify.consistency.known import Known, Values
from ipmclab.identify.consistency.predicted import predicted
from ipmclab.model import Actuator
from ipmclab.model.stages.beam import resonance
from ipmclab.run import Finding

CODE = "motion-against-stiffness"
NAMES = ("beam.modulus", "geometry.width", "geometry.thickness", "geometry.sensing_length")
LASER = 1.25e-6
"""What a laser such as the thesis's resolves [m]."""


def stiffness(values: Values) -> float:
    """Y w h^3/(4 L_s^3) [N/m]: the force at L_s over the displacement there (Friend, eq. 4.11)."""
    return (
        values["beam.modulus"]
        * values["geometry.width"]
        * values["geometry.thickness"] ** 3
        / (4.0 * values["geometry.sensing_length"] ** 3)
    )


def motion_against_stiffness(known: Known, facts: Sequence[Fact]) -> list[Finding]:
    """``motion-against-stiffness``: blocked force over free displacement under one voltage is not the model's.

    In the base model that ratio is the stiffness at the sensing point for every signal; with slow modes it is read from
    the model as it was measured. A step is told before a sine or a square.
    """
    forces = [fact for fact in facts if fact.metric == "max_force"]
    motions = [fact for fact in facts if fact.metric == "max_displacement"]
    pairs = [(force, motion) for force in forces for motion in motions if force.like(motion)]
    # A run that has both is no partner for another.
    own = {one.where for one, other in pairs if one.where == other.where}
    pairs = [pair for pair in pairs if pair[0].where == pair[1].where or not {pair[0].where, pair[1].where} & own]
    found = []
    for force, motion in pairs:
        ratio = force.value / motion.value
        relative = math.hypot(force.uncertainty / force.value, motion.uncertainty / motion.value)
        measured = Amount(ratio, relative * ratio, "N/m")
        model = predicted(known.actuator, force) / predicted(known.actuator, motion)
        spread = known.spread(stiffness, NAMES) / stiffness(known.values)
        expected = Amount(model, spread * model, "N/m")
        sigmas = apart(measured, expected)
        if sigmas > SURE and not (force.at_least or motion.at_least):
            found.append((("step", "sine", "square").index(force.waveform), sigmas, measured, expected, force, motion))
    if not found:
        return []
    found.sort(key=lambda one: (one[0], -one[1]))
    _, sigmas, measured, expected, force, motion = found[0]
    modulus = known.values["beam.modulus"] * measured.value / expected.value
    gain = known.values["coupling.gain"] * motion.value / predicted(known.actuator, motion)
    softer = known.actuator.replace(**{"beam.modulus": modulus, "coupling.gain": gain})
    now, then = (resonance(one.parameter_values).frequency for one in (known.actuator, softer))
    rings = sorted((ring_of_step(known.actuator), ring_of_step(softer)))
    rest = [
        f"{one[4].waveform} {known.values['beam.modulus'] * one[2].value / one[3].value * 1e-6:.3g} MPa"
        for one in found[1:]
    ]
    also = f"; likewise {', '.join(rest)}" if rest else ""
    useless = (
        f" (a 1 V step will not do: it rings by {rings[0] * 1e6:.2g} to {rings[1] * 1e6:.2g} um, where a laser "
        f"resolves {LASER * 1e6:.3g} um)"
        if rings[1] < LASER
        else ""
    )
    return [
        conflict(
            CODE,
            f"force over displacement is {measured} ({_milli(force.value)} mN in {force.where} over "
            f"{_milli(motion.value)} mm in {motion.where}), the stiffness of the model says {expected}: "
            f"{how_sure(sigmas)}; the measured ratio needs a modulus of {modulus * 1e-6:.3g} MPa in place of "
            f"{known.values['beam.modulus'] * 1e-6:.4g} MPa{also}" + known.taken(NAMES),
            f"flick the strip at 0 V with the laser at 1 kS/s: it rings at {now:.3g} Hz if the modulus is right and at "
            f"{then:.3g} Hz if the motion is{useless}",
            found=measured,
            expected=expected,
            sigmas=sigmas,
            more={"implied_modulus": modulus, "resonance": now, "implied_resonance": then},
        )
    ]


def ring_of_step(actuator: Actuator) -> float:
    """Amplitude [m] with which the beam rings after a 1 V step, from the residue of its poles."""
    system = actuator.system
    place = system.outputs.index("displacement")
    poles, right = np.linalg.eig(np.asarray(system.a, dtype=np.complex128))
    left = np.linalg.solve(right, np.asarray(system.b, dtype=np.complex128))[:, 0]
    at = int(np.argmin(np.abs(np.abs(poles) / (2.0 * math.pi) - resonance(actuator.parameter_values).frequency)))
    row = np.asarray(system.c, dtype=np.complex128)[place]
    return float(2.0 * abs(row @ right[:, at] * left[at] / poles[at]))


def _milli(value: float) -> str:
    return f"{1e3 * value:.3g}"
