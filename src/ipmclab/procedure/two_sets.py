"""The two sets of numbers that the thesis has for its sample 2: Tables 4.1 and 4.2, and the script of appendix A.1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.model import Actuator, load_actuator, simulate
from ipmclab.prediction.headline import BACK_RELAXATION_FROM, DURATION, RATE, SIGNALS, amplitude

SCRIPT: Final = "friend-2-appendix"
TABLES: Final = "friend-2"
MODULUS_OF_THE_COMMENT: Final = 9.9e7
"""Young's modulus in a comment of the script [Pa]: "9.9e7 (724.36e6)"."""

COUPLING: Final = ("coupling.gain", "coupling.zero", "coupling.p1", "coupling.p2")


@dataclass(frozen=True)
class SetOfNumbers:
    """What one set gives at 1 V.

    Parameters
    ----------
    dc_coupling : float [m/V]
        d(0) = K_d Z_d/P_2d.
    modulus : float [Pa]
    displacement, force : float [m, N]
        Largest within 5 s of the step.
    drift : float
        By which part of it the displacement continues rising from 5 s to 40 s.
    sine : float [m]
        Amplitude of the displacement at 0.1 Hz.
    square_force : float [N]
        Amplitude of the force under the square of 0.1 Hz.
    """

    dc_coupling: float
    modulus: float
    displacement: float
    force: float
    drift: float
    sine: float
    square_force: float


def with_coupling_of_the_script() -> Actuator:
    """Sample 2 with the circuit of Table 4.1 and the coupling of appendix A.1.

    Examples
    --------
    >>> with_coupling_of_the_script()["coupling.p2"]
    101.89
    """
    script = load_actuator(SCRIPT)
    return load_actuator(TABLES).replace(**{name: script[name] for name in COUPLING})


def read_set(actuator: Actuator) -> SetOfNumbers:
    """What an actuator gives under the step, the sine and the square of the thesis.

    Examples
    --------
    >>> f"{1e3 * read_set(load_actuator(TABLES)).displacement:.2f} mm"
    '0.50 mm'
    """
    runs = {name: simulate(actuator, signal, duration=DURATION, rate=RATE) for name, signal in SIGNALS.items()}
    step = runs["step"]
    early = step.time <= BACK_RELAXATION_FROM
    tip = float(np.max(step.channels["displacement"][early]))
    return SetOfNumbers(
        dc_coupling=actuator["coupling.gain"] * actuator["coupling.zero"] / actuator["coupling.p2"],
        modulus=actuator["beam.modulus"],
        displacement=tip,
        force=float(np.max(step.channels["force"][early])),
        drift=float(step.channels["displacement"][-1]) / tip - 1.0,
        sine=amplitude(runs["sine"].time, runs["sine"].channels["displacement"]),
        square_force=amplitude(runs["square"].time, runs["square"].channels["force"]),
    )


def two_sets() -> tuple[SetOfNumbers, SetOfNumbers, SetOfNumbers]:
    """The tables; their circuit with the coupling of the script; the same with the modulus of the script's comment.

    Examples
    --------
    >>> tables, script, soft = two_sets()
    >>> f"{script.dc_coupling / tables.dc_coupling:.1f} times; {1e3 * script.displacement:.2f} mm"
    '8.6 times; 4.17 mm'
    >>> f"{1e3 * soft.force:.2f} mN with {soft.modulus / 1e6:.0f} MPa"
    '0.82 mN with 99 MPa'
    """
    script = with_coupling_of_the_script()
    soft = script.replace(**{"beam.modulus": MODULUS_OF_THE_COMMENT})
    return read_set(load_actuator(TABLES)), read_set(script), read_set(soft)
