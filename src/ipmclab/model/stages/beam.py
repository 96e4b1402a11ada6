"""Beam: the clamped strip that bends, or presses when it is blocked."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from typing import Final, NamedTuple

import numpy as np

from ipmclab.kinds import tell_kinds
from ipmclab.model.blocks import Block, block
from ipmclab.model.parameters import Declaration, Measurement, Values
from ipmclab.model.stages.kind import LITTLE, Excitation, Numbers, StageKind, Trial, number_of
from ipmclab.units import ANGULAR_RATE, DENSITY, MODULUS, NUMBER, STIFFNESS

YOUNGS_MODULUS: Final = "beam.modulus"
GAMMA: Final = 1.875
"""First solution of the clamped beam's characteristic equation, as rounded in Friend, section 4.2."""


def natural_frequency(values: Values) -> complex:
    """Undamped angular frequency of the first bending mode [rad/s], with the static modulus (Friend, eq. 4.7)."""
    stiffness = values["beam.modulus"] * values["geometry.thickness"] ** 2 / (12.0 * values["beam.density"])
    return GAMMA**2 * stiffness**0.5 / values["geometry.free_length"] ** 2


def tip_stiffness(values: Values) -> complex:
    """The strip's own stiffness at the sensing point [N/m], that of a cantilever: w h^3 Y/(4 L_s^3) = F_blocked/d_free.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> round(tip_stiffness(load_actuator("friend-2").parameter_values), 3)
    2.878
    """
    section = values["geometry.width"] * values["geometry.thickness"] ** 3
    return section * values["beam.modulus"] / (4.0 * values["geometry.sensing_length"] ** 3)


WEIGHTLESS: Final = {"beam.density": 1.0}
"""A beam so light that it does not ring at any rate at which strips are read."""

_RINGS: Final = 0.5
"""Part of the static displacement from which on what a pair of poles adds at its frequency is a resonance."""


class Resonance(NamedTuple):
    """The first bending mode as it rings: natural frequency [Hz] and damping ratio."""

    frequency: float
    damping_ratio: float


@tell_kinds
def resonance(values: Mapping[str, float]) -> Resonance:
    """The first bending mode, with what a viscoelastic modulus adds to its stiffness and to its damping.

    A lightly damped mode of the modulus makes two resonances of one: the first is the lowest pair of poles that adds
    half of the static displacement or more at its own frequency.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> found = resonance(load_actuator("friend-2").parameter_values)
    >>> round(found.frequency, 2), round(found.damping_ratio, 3)
    (38.29, 0.05)
    """
    modes = _modes(values)
    loaded = "load.stiffness" in values
    if not modes and not loaded:
        return Resonance(float(abs(natural_frequency(values))) / (2.0 * math.pi), float(values["beam.damping_ratio"]))
    size = 2 + 2 * modes
    whole = Beam(modes, loaded).block(values)
    poles, right = np.linalg.eig(whole.a[:size, :size])
    left = np.linalg.pinv(right)
    # What a pair adds to the displacement at its own frequency, and what all poles make of a constant drive.
    residues = right[0] * (left @ whole.b[:size, 0])  # under a load the force's drive moves it alike
    static = abs(np.sum(residues / poles))
    rings = (poles.imag > 0.0) & (np.abs(residues) >= _RINGS * static * np.abs(poles.real))
    if np.any(rings):
        pole = complex(min(poles[rings], key=abs))
        return Resonance(abs(pole) / (2.0 * math.pi), -pole.real / abs(pole))
    # Nothing rings: the poles that displacement and velocity have most part in are the beam's.
    share = np.sum(np.abs(right[:2].T * left[:, :2]), axis=1)
    one, other = poles[np.argsort(share)[-2:]]
    rate = math.sqrt(abs(one * other))
    return Resonance(rate / (2.0 * math.pi), float(-(one + other).real / (2.0 * rate)))


def _modes(values: Values) -> int:
    return next(mode for mode in count() if f"viscoelastic.{mode}.amplitude" not in values)


@dataclass(frozen=True)
class Beam:
    """Displacement and blocked force at L_s (Friend, eqs 4.7 to 4.11).

    With eq. 4.8, eq. 4.7 collapses to 3 d L_s^2/h^2 V_appl times 1/(1 + 2 zeta s/w + s^2/w^2), for all s.
    The thesis gives no damping; 0.05 is ours. The blocked force has no beam factor (eq. 4.9).

    A viscoelastic modulus Y(s) = Y_c y(s) (eq. 4.10, Golla-Hughes-McTavish, any number of modes) multiplies the force.
    In the displacement Y is in the beam factor only, because what drives the strip and what holds it back both grow
    with Y: free curvature does not know the modulus. The factor becomes 1/(1 + 2 zeta s/(w y) + s^2/(w^2 y)), with w of
    Y_c and a damper parallel to the beam that does not stiffen with it. With z'' + 2 zeta_i w_i z' + w_i^2 z = w_i^2
    e, the stress of a strain e is y e = (1 + sum alpha_i) e - sum alpha_i z_i: linear, and two states for each mode in
    the beam, where e is what is left to the free curvature, and two in the force.

    A force f at the sensing point bends the strip by its own stiffness k_b = F_blocked/d_free (``tip_stiffness``): the
    factor that moves a free strip by d_free moves it by d_free + f/k_b. Where the strip is blocked, f presses too.

    A **load** is a spring of stiffness k at the sensing point. The strip then moves and presses at once, on the line
    between free and blocked: F = k d, at rest d = d_free k_b/(k_b + k). Where displacement and force have drives of
    their own (slow modes of one alone), both ends of that line stay what they are: the drive is that of the force by
    the part k/(k_b + k) to which the load holds the strip back, and that of the displacement by the rest.

    Parameters
    ----------
    viscoelastic : int
        Modes of the modulus.
    loaded : bool
        Whether a spring holds the strip at the sensing point.
    """

    viscoelastic: int = 0
    loaded: bool = False

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""
        modes = (
            declaration
            for i in range(self.viscoelastic)
            for declaration in (
                Declaration(f"viscoelastic.{i}.amplitude", NUMBER, f"α_{i + 1}", 0.0, 1e3, "linear", typical=0.3),
                Declaration(f"viscoelastic.{i}.damping_ratio", NUMBER, f"ζ_{i + 1}", 1e-3, 1e4, typical=2.0),
                Declaration(f"viscoelastic.{i}.frequency", ANGULAR_RATE, f"ω_{i + 1}", 1e-6, 1e9, typical=10.0),
            )
        )
        return (
            # From bare Nafion by its data sheet (360 g/m^2, 0.183 mm) to half as much platinum again as sample 2 has.
            Declaration(
                *("beam.density", DENSITY, "ρ_m", WEIGHTLESS["beam.density"], 1e5),
                typical=3e3,
                likely=(1.9e3, 5e3),
                outputs=("displacement",),
                measured=Measurement("measure the density (mass and volume)", 8),
            ),
            # From Pugal's model in water to sample 2 (Friend, Table 4.2); Nafion itself has 46 to 197 MPa (Tang 2006).
            Declaration(
                *(YOUNGS_MODULUS, MODULUS, "Y", 1e3, 1e13),
                typical=5e8,
                likely=(4.1e7, 1.45e9),
                measured=Measurement("measure Young's modulus (push the tip with a known force)", 7),
            ),
            Declaration("beam.damping_ratio", NUMBER, "ζ", 1e-6, 100.0, default=0.05, outputs=("displacement",)),
            *modes,
            *((Declaration("load.stiffness", STIFFNESS, "k", 0.0, 1e9, "linear", typical=1.0),) if self.loaded else ()),
        )

    def block(self, values: Values) -> Block:
        """Drives [m] and ``external_force`` [N] to ``displacement`` [m] and ``force`` [N].

        Its states are displacement and velocity; then, of each mode of the modulus, the lagged strain and its scaled
        rate, first those in the beam [m], then those in the force [m, as the drive].
        """
        thickness, sensing = values["geometry.thickness"], values["geometry.sensing_length"]
        frequency = natural_frequency(values)
        stiffness = frequency**2
        displacement = 3.0 * sensing**2 / thickness**2
        force = 3.0 * thickness * values["geometry.width"] * values["beam.modulus"] / (4.0 * sensing)
        indices = range(self.viscoelastic)
        n = 2 + 4 * self.viscoelastic
        instant = 1.0 + sum(values[f"viscoelastic.{i}.amplitude"] for i in indices)
        a: list[list[complex]] = [[0.0] * n for _ in range(n)]
        b: list[list[complex]] = [[0.0, 0.0, 0.0] for _ in range(n)]
        a[0][1], a[1][0], a[1][1] = 1.0, -stiffness * instant, -2.0 * values["beam.damping_ratio"] * frequency
        b[1][0] = stiffness * instant * displacement
        b[1][2] = stiffness / tip_stiffness(values)
        pressed: list[complex] = [0.0] * n
        states = ["beam.displacement", "beam.velocity"]
        for place in range(2 * self.viscoelastic):
            i, in_force = place % self.viscoelastic, place >= self.viscoelastic
            name, z = f"viscoelastic.{i}", 2 + 2 * place
            rate, amplitude = values[f"{name}.frequency"], values[f"{name}.amplitude"]
            a[z][z + 1], a[z + 1][z], a[z + 1][z + 1] = rate, -rate, -2.0 * values[f"{name}.damping_ratio"] * rate
            if in_force:
                b[z + 1][1] = rate
                pressed[z] = -force * amplitude
            else:
                a[z + 1][0], b[z + 1][0] = -rate, rate * displacement
                a[1][z] = -stiffness * amplitude
            where = "force" if in_force else "beam"
            states += [f"{name}.{where}_strain", f"{name}.{where}_strain_rate"]
        presses: list[complex] = [0.0, force * instant, 1.0]
        if self.loaded:
            load = values["load.stiffness"]
            held_back = load / (tip_stiffness(values) + load)
            for row in range(1, 2 + 2 * self.viscoelastic):
                b[row][0], b[row][1] = (1.0 - held_back) * b[row][0], held_back * b[row][0]
            a[1][0] -= stiffness * load / tip_stiffness(values)
            pressed, presses = [load, *([0.0] * (n - 1))], [0.0, 0.0, 0.0]
        return block(
            states=states,
            inputs=["displacement_drive", "force_drive", "external_force"],
            outputs=["displacement", "force"],
            a=a,
            b=b,
            c=[[1.0, *([0.0] * (n - 1))], pressed],
            d=[[0.0, 0.0, 0.0], presses],
        )


def _viscoelastic_trials(values: Numbers, excitation: Excitation) -> Iterator[Trial]:
    last = number_of(values, "viscoelastic.")
    name = f"viscoelastic.{last}"
    for lag in excitation.lags:
        mode = {
            f"{name}.amplitude": LITTLE,
            f"{name}.damping_ratio": 2.0,
            f"{name}.frequency": 4.0 / lag,  # well damped: the slow one of its poles is about w/(2 zeta)
        }
        yield Trial("viscoelastic" if not last else f"viscoelastic={last + 1}", mode, ("force",), lag=lag)


KIND = StageKind("beam", "beam.", outputs=("displacement", "force"))
VISCOELASTIC = StageKind(
    "viscoelastic",
    "viscoelastic.",
    group="viscoelastic",
    example=True,
    counted=True,
    compared_as="viscoelastic",
    outputs=("displacement", "force"),
    several_minima=True,
    curved=True,
    off=("amplitude",),
    held=("damping_ratio",),
    shows="a stiffness that is not the same fast and slow",
    to_determine="record force with steps and with slow and fast signals, or with less noise",
    to_show="record force with steps, or with less noise",
    trials=_viscoelastic_trials,
    speed=lambda values, name: values[f"{name}.damping_ratio"] / values[f"{name}.frequency"],
)
LOAD = StageKind("load", "load.", outputs=("displacement", "force"), held=("stiffness",))
