"""The ring of a flicked strip against the resonance of the model."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ipmclab.consistency.fact import Fact
from ipmclab.consistency.facts import label_of
from ipmclab.consistency.known import KnownStrip, Values
from ipmclab.consistency.push import push_of
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
from ipmclab.model.stages.beam import resonance
from ipmclab.quality.noise import noise_level
from ipmclab.quality.record import NO_VOLTAGE
from ipmclab.run import Finding, FloatArray, Run

CODE = "resonance-against-stiffness"
NAMES = ("beam.modulus", "beam.density", "geometry.thickness", "geometry.free_length")

_ROWS_OF_A_PERIOD = 8.0  # fewer rows miss the peak by 8 % or more: 1 - cos(pi/8) (derived)
_PERIODS = 3.0  # fewer do not distinguish a decay from a drift (convention)
_STANDS_OUT = 10.0  # times the noise (convention)
_LEAST_DECAY = 1e-3
"""Of the angular frequency: what moves on and on is moved (convention)."""

_CLAMP = 0.01
"""Relative: a clamp gives way a little, and the air moves with the strip (convention)."""


def flicks(runs: Sequence[Run]) -> tuple[Fact, ...]:
    """The natural frequencies at which strips ring in runs at 0 V.

    A decaying oscillation is fitted to the displacement from its largest deviation on. There is a fact only where it
    has eight rows to a period or more (so that it is no image of a faster one), three periods or more, and ten times
    the noise.

    Parameters
    ----------
    runs : sequence of Run
    """
    found = []
    for place, run in enumerate(runs):
        if run.displacement is None or np.abs(run.voltage).max() > NO_VOLTAGE or not run.is_uniform:
            continue
        if push_of(run) is not None:
            continue  # moved to and fro by hand, it does not ring
        ring = ring_of(run.displacement, run.rate)
        if ring is not None:
            sample = run.metadata.sample.id if run.metadata.sample else None
            uncertainty = math.hypot(ring[1], _CLAMP * ring[0])
            found.append(
                Fact(
                    sample,
                    "flick",
                    "resonance",
                    ring[0],
                    uncertainty,
                    where=label_of(run, place),
                    place=place,
                    temperature=run.metadata.temperature,
                    relative_humidity=run.metadata.relative_humidity,
                )
            )
    return tuple(found)


def ring_of(displacement: FloatArray, rate: float) -> tuple[float, float] | None:
    """Natural frequency [Hz] of a decaying oscillation and its standard error; None where there is none.

    Parameters
    ----------
    displacement : float array, shape (n_time,) [m]
    rate : float [Hz]
    """
    from scipy.optimize import least_squares

    readings = displacement[np.isfinite(displacement)]
    if len(readings) < 64 or len(readings) < len(displacement):
        return None
    noise = noise_level(readings)
    rest = float(np.median(readings[-len(readings) // 4 :]))
    start = int(np.argmax(np.abs(readings - rest)))
    values = readings[start:] - rest
    if len(values) < 64 or abs(values[0]) < _STANDS_OUT * noise or values[0] == 0.0:
        return None
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(2 * len(values))[len(values) :], 8 * len(values)))
    low = int(8 * _PERIODS)
    frequency = (low + int(np.argmax(power[low:]))) * rate / (8 * len(values))
    if frequency > rate / _ROWS_OF_A_PERIOD:
        return None
    # Some twenty periods hold all that a strip in water or air has to say.
    values = values[: max(64, int(20.0 * rate / frequency))]
    time = np.arange(len(values)) / rate
    size = abs(float(values[0]))

    def linear(point: FloatArray) -> tuple[FloatArray, FloatArray]:
        fading = np.exp(-point[0] * time)
        angle = point[1] * time
        columns = np.column_stack((fading * np.cos(angle), fading * np.sin(angle), np.ones_like(time), time))
        factors = np.linalg.lstsq(columns, values, rcond=None)[0]
        return columns @ factors - values, factors

    angular = 2.0 * math.pi * frequency
    fitted = least_squares(
        lambda point: linear(point)[0] / size,
        [0.05 * angular, angular],
        bounds=([0.0, 0.5 * angular], [2.0 * angular, 2.0 * angular]),
        x_scale=[0.05 * angular, angular],
    )
    left, factors = linear(fitted.x)
    decay, turning = float(fitted.x[0]), float(fitted.x[1])
    height = math.hypot(float(factors[0]), float(factors[1]))
    rows = rate / (turning / (2.0 * math.pi))
    deviation = float(np.std(left))
    if not (rows >= _ROWS_OF_A_PERIOD and len(values) >= _PERIODS * rows and deviation < 0.2 * height):
        return None
    if height < _STANDS_OUT * noise or not _LEAST_DECAY < decay / turning < 1.0 / _PERIODS:
        return None
    curvature = fitted.jac.T @ fitted.jac
    error = math.sqrt(float(np.linalg.inv(curvature)[1, 1])) * deviation / size
    natural = math.hypot(turning, decay) / (2.0 * math.pi)
    return natural, error / (2.0 * math.pi)


def resonance_against_stiffness(known: KnownStrip, facts: Sequence[Fact]) -> list[Finding]:
    """``resonance-against-stiffness``: the strip rings at another frequency than its modulus and density say."""

    def frequency(values: Values) -> float:
        return resonance(values).frequency

    measured = [fact for fact in facts if fact.metric == "resonance"]
    if not measured:
        return []
    expected = Amount(frequency(known.values), known.standard_uncertainty(frequency, NAMES), "Hz")
    found = []
    for fact in measured:
        rings = Amount(fact.value, fact.uncertainty, "Hz")
        sigmas = sigmas_between(rings, expected)
        if sigmas > SURE:
            modulus = known.values["beam.modulus"] * (rings.value / expected.value) ** 2
            found.append(
                conflict(
                    CODE,
                    f"{fact.where or 'the flick'}: the strip rings at {rings}, the model at {expected}: "
                    f"{how_sure(sigmas)}; with its mass and length it needs a modulus of {modulus * 1e-6:.3g} MPa in "
                    f"place of {known.values['beam.modulus'] * 1e-6:.4g} MPa" + known.taken(NAMES),
                    "measure the free length with a ruler and flick the strip once more: the frequency goes with one "
                    "over its square",
                    found=rings,
                    expected=expected,
                    sigmas=sigmas,
                    channel="displacement",
                    more={"implied_modulus": modulus},
                )
            )
    return found
