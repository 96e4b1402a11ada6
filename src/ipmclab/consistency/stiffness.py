"""Force over displacement against the stiffness of the model, which a push test gave it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ipmclab.consistency.fact import Fact, with_zero_first, zero_that_agrees
from ipmclab.consistency.known import KnownStrip, Values
from ipmclab.consistency.predicted import predicted
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
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


@dataclass(frozen=True)
class Motion:
    """Blocked force and free displacement under one voltage.

    Parameters
    ----------
    force, motion : Fact
    measured : Amount [N/m]
        Their ratio.
    model : float [N/m]
        The same ratio of the model.
    slow : float
        Relative standard uncertainty of ``model`` over the stiffness of the model, from its slow modes.
    """

    force: Fact
    motion: Fact
    measured: Amount
    model: float
    slow: float

    @property
    def said(self) -> str:
        """What it was made of: ``"1.3 mN in figure 5.18 over 3.7 mm in figure 5.15"``."""
        force, motion = self.force, self.motion
        return f"{_milli(force.value)} mN in {force.where} over {_milli(motion.value)} mm in {motion.where}"

    def zeros_that_agree(self, ratio: float) -> str:
        """Clauses with the zeros that would bring force over displacement to a ratio [N/m], where none is shown."""
        return zero_that_agrees(self.force, ratio * self.motion.value) + zero_that_agrees(
            self.motion, self.force.value / ratio
        )

    @property
    def order(self) -> int:
        """A step is reported before a sine or a square."""
        return ("step", "sine", "square").index(self.force.waveform)


def motions_of(known: KnownStrip, facts: Sequence[Fact]) -> list[Motion]:
    """Every force with a displacement under the same voltage; without those of which only a bound was read."""
    forces = [fact for fact in facts if fact.metric == "max_force"]
    motions = [fact for fact in facts if fact.metric == "max_displacement"]
    pairs = [(force, motion) for force in forces for motion in motions if force.like(motion)]
    # A run that has both is no partner for another.
    own = {one.where for one, other in pairs if one.where == other.where}
    found = []
    for force, motion in pairs:
        together = force.where == motion.where or not {force.where, motion.where} & own
        if not together or force.at_least or motion.at_least:
            continue
        value = force.value / motion.value
        relative = math.hypot(force.uncertainty / force.value, motion.uncertainty / motion.value)
        model = _ratio(known.actuator, force, motion)
        slow = [name for name in known.values if name.startswith(("relaxation.", "viscoelastic."))]

        def ratio(
            values: Values, force: Fact = force, motion: Fact = motion, slow: Sequence[str] = tuple(slow)
        ) -> float:
            return _ratio(known.actuator.replace(**{name: values[name] for name in slow}), force, motion)

        found.append(
            Motion(
                force,
                motion,
                Amount(value, relative * value, "N/m"),
                model,
                known.standard_uncertainty(ratio, slow) / model,
            )
        )
    return found


def _ratio(actuator: Actuator, force: Fact, motion: Fact) -> float:
    return predicted(actuator, force) / predicted(actuator, motion)


def motion_against_stiffness(known: KnownStrip, motions: Sequence[Motion]) -> list[Finding]:
    """``motion-against-stiffness``: blocked force over free displacement under one voltage is not the model's.

    In the base model that ratio is the stiffness at the sensing point for every signal; with slow modes it is read from
    the model as it was measured. A step is reported before a sine or a square.
    """
    found = []
    spread = known.standard_uncertainty(stiffness, NAMES) / stiffness(known.values)
    for one in motions:
        expected = Amount(one.model, math.hypot(spread, one.slow) * one.model, "N/m")
        sigmas = sigmas_between(one.measured, expected)
        if sigmas > SURE:
            found.append((one.order, sigmas, one.measured, expected, one))
    if not found:
        return []
    found.sort(key=lambda one: (one[0], -one[1]))
    _, sigmas, measured, expected, worst = found[0]
    motion = worst.motion
    modulus = known.values["beam.modulus"] * measured.value / expected.value
    gain = known.values["coupling.gain"] * motion.value / predicted(known.actuator, motion)
    softer = known.actuator.replace(**{"beam.modulus": modulus, "coupling.gain": gain})
    now, then = (resonance(one.parameter_values).frequency for one in (known.actuator, softer))
    zeros = worst.zeros_that_agree(expected.value)
    rings = sorted((ring_of_step(known.actuator), ring_of_step(softer)))
    rest = [
        f"{one[4].force.waveform} {known.values['beam.modulus'] * one[2].value / one[3].value * 1e-6:.3g} MPa"
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
            f"force over displacement is {measured} ({worst.said}), the stiffness of the model says "
            f"{expected}: {how_sure(sigmas)}; the measured ratio needs a modulus of {modulus * 1e-6:.3g} MPa in place "
            f"of {known.values['beam.modulus'] * 1e-6:.4g} MPa{also}{zeros}" + known.taken(NAMES),
            with_zero_first(
                f"flick the strip at 0 V with the laser at 1 kS/s: it rings at {now:.3g} Hz if the modulus is right "
                f"and at {then:.3g} Hz if the motion is{useless}",
                zeros,
            ),
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
