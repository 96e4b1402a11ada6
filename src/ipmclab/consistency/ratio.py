"""A slow sine against a step: what the modes of the model keep of the one in the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ipmclab.consistency.fact import Fact, with_zero_first, zero_that_agrees
from ipmclab.consistency.facts import READ_BY, READ_UNTIL
from ipmclab.consistency.known import KnownStrip
from ipmclab.consistency.predicted import predicted
from ipmclab.measurement.amount import SURE, Amount, beyond, conflict, how_sure
from ipmclab.run import Finding

CODE = "sine-against-step"
MODEL: float = 0.05
"""Relative standard uncertainty of the model's ratio in addition to that of its stated parameters: when a peak was read
(convention)."""


def sine_against_step(known: KnownStrip, facts: Sequence[Fact]) -> list[Finding]:
    """``sine-against-step``: the amplitude under a sine over the peak of a step of the same voltage is not the model's.

    The ratio is free of every gain, so it is decided by the modes alone; one slow mode would make it
    1/sqrt(1 + (2 pi f tau)^2). Where nothing says when a step was read, all that the model gives from ``READ_BY`` to
    ``READ_UNTIL`` agrees.
    """
    found = []
    for sine in facts:
        if sine.waveform != "sine" or sine.frequency is None or not sine.metric.startswith("max_") or sine.at_least:
            continue
        for step in facts:
            same = sine.amplitude is not None and step.amplitude is not None
            if step.waveform != "step" or step.metric != sine.metric or not same or not step.in_conditions_of(sine):
                continue
            if step.at_least or abs((sine.amplitude or 0.0) / (step.amplitude or 1.0) - 1.0) > 0.02:
                continue
            finding = _compare(known, sine, step)
            if finding is not None:
                found.append(finding)
    return found


def _compare(known: KnownStrip, sine: Fact, step: Fact) -> Finding | None:
    value = sine.value / step.value
    relative = math.hypot(sine.uncertainty / sine.value, step.uncertainty / step.value)
    measured = Amount(value, relative * value, "")
    # Where nobody says when the largest value of the step was read, the model may have it early or late.
    times = (step.time,) if step.time is not None else (READ_BY, READ_UNTIL)
    early, late = (_expected(known, sine, replace(step, time=time)) for time in (times[0], times[-1]))
    low, high = sorted((early, late), key=lambda one: one.value)
    sigmas = beyond(measured, low, high)
    if sigmas <= SURE:
        return None
    expected = low if measured.value < low.value else high
    channel = sine.metric.removeprefix("max_")
    unit = "mm" if channel == "displacement" else "mN"
    frequency = sine.frequency or 0.0
    lag = math.sqrt(1.0 / value**2 - 1.0) / (2.0 * math.pi * frequency) if value < 1.0 else None
    needs = f"; one slow mode would need a time constant of {lag:.2g} s" if lag else ""
    zero = zero_that_agrees(step, sine.value / expected.value)
    return conflict(
        CODE,
        f"the {channel} under the {sine.signal} is {measured} of that under the {step.signal} "
        f"({1e3 * sine.value:.3g} {unit} in {sine.where} over {1e3 * step.value:.3g} {unit} in {step.where}), the "
        f"modes of the model ({_modes(known)}) keep {expected}: {how_sure(sigmas)}{needs}{zero}",
        with_zero_first(
            f"record step and sine in one mounting, the step again last: if the ratio stays, the {channel} has a slow "
            f"mode (add relaxation.{channel}); if the second step is smaller, the first began in a fresh state",
            zero,
        ),
        found=measured,
        expected=expected,
        sigmas=sigmas,
        channel=channel,
        more={"lag": lag},
    )


def _expected(known: KnownStrip, sine: Fact, step: Fact) -> Amount:
    model = predicted(known.actuator, sine) / predicted(known.actuator, step)
    return Amount(model, math.hypot(MODEL, _of_parameters(known, sine, step, model)) * model, "")


def _of_parameters(known: KnownStrip, sine: Fact, step: Fact, model: float) -> float:
    """Relative uncertainty of the ratio from parameters with an uncertainty of their own."""
    total = 0.0
    for name in known.values:
        if known.is_assumed(name) or not name.startswith(("circuit.", "coupling.", "relaxation.")):
            continue
        step_size = known.uncertainty(name)
        if math.isinf(step_size):
            return math.inf
        value = known.values[name]
        if step_size <= 0.0 or value == 0.0:
            continue
        moved = known.actuator.replace(**{name: value + math.copysign(min(step_size, 0.5 * abs(value)), value)})
        total += (predicted(moved, sine) / predicted(moved, step) / model - 1.0) ** 2
    return math.sqrt(total)


def _modes(known: KnownStrip) -> str:
    """Time constants [s] longer than a twentieth of a second."""
    poles = np.linalg.eigvals(np.asarray(known.actuator.system.a, dtype=np.complex128))
    slow = sorted({float(f"{-1.0 / pole.real:.2g}") for pole in poles if pole.real < 0.0 and -1.0 / pole.real > 0.05})
    return ", ".join(f"{one:g} s" for one in slow)
