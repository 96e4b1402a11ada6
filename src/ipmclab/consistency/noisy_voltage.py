"""Noise of the voltage that was recorded: an error in the input, which moves the fast parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.model import Actuator, simulate
from ipmclab.named_matrix import matrix_of
from ipmclab.quality.kept import kept
from ipmclab.quality.noise import noise_of_readings
from ipmclab.quality.record import GUARD_ROWS, Record
from ipmclab.run import Finding, FloatArray, Hold, Run
from ipmclab.signals import Samples
from ipmclab.ties import names_by_size

CODE = "noisy-voltage"

_REPORTED_FROM: Final = 0.5
"""Standard errors by which a parameter is moved, from which on it is reported (convention)."""

_FEWEST: Final = 50  # rows of constant voltage, by which its scatter is known (convention)
_ROWS: Final = 400  # of the answer to one row of voltage: its square is in the first few (a limit)
_SURE: Final = 4.0  # standard errors: one share in 16,000 by chance (convention)
_NOT_ELECTRIC: Final = ("coupling.", "beam.", "relaxation.", "viscoelastic.", "laser.")
_STEP: Final = 1e-4  # of a parameter, over which a derivative is taken (convention)


def noisy_voltage(fit: Fit, runs: Sequence[Run]) -> list[Finding]:
    """``noisy-voltage``: the recorded voltage scatters where the current does not, and that moves a parameter.

    A fit takes the recorded voltage for the one that was applied. Of scatter n that was not, the model answers g * n,
    which least squares makes small compared with what is to be explained: over N rows it gains N s^2 grad(|g|^2)/2, so
    that the parameters move by -C N s^2 grad(|g|^2)/(2 sigma^2). Scatter that did reach the strip is in the current
    too: what part did not is read from the residuals, which then hold -g * n.

    Parameters
    ----------
    fit : Fit
    runs : sequence of Run
        From which it was made.
    """
    known = fit.actuator.parameter_values.keys() & fit.covariance.keys()
    names = [name for name, one in fit.parameters.items() if one.determined and name in known]
    kinds: dict[tuple[float, Hold, float], float] = {}
    scatters: list[float] = []
    for run, observation, left in zip(runs, fit.observations, fit.residuals, strict=False):
        scatter = _scatter(run)
        noise = observation.noise.get("current", 0.0)
        if scatter is None or not noise > 0.0 or "current" in observation.noise_model or not run.is_uniform:
            continue
        size, rows = scatter
        kind = (run.rate, _hold(run), observation.series_resistance)
        answer = _pulse(fit.actuator, kind)
        share = _not_applied(rows, left["current"], answer)
        if share > 0.0:
            weight = observation.samples["current"] * share * (size / noise) ** 2
            kinds[kind] = kinds.get(kind, 0.0) + weight
            scatters.append(size)
    if not kinds or not names:
        return []
    slope = np.zeros(len(names))
    for kind, weight in kinds.items():
        slope += weight * _half_gradient(fit.actuator, names, kind)
    moved = dict(zip(names, (-matrix_of(fit.covariance, names) @ slope).tolist(), strict=True))
    return _reported_of(fit, moved, max(scatters))


def _scatter(run: Run) -> tuple[float, FloatArray] | None:
    """Standard deviation of the voltage where it is held [V], and its deviations there (0 elsewhere)."""
    return kept(run, "scatter", lambda: _scatter_of(run))


def _scatter_of(run: Run) -> tuple[float, FloatArray] | None:
    record = Record.of(run)
    bounds = [0, *record.edges.tolist(), len(run)]
    deviations = np.zeros(len(run))
    sizes: list[tuple[int, float]] = []
    for first, stop in pairwise(bounds):
        held = slice(first + GUARD_ROWS, stop - GUARD_ROWS)
        voltage = run.voltage[held]
        if len(voltage) < _FEWEST:
            continue
        noise = noise_of_readings(voltage)
        # Held: its means over tenths of the stretch differ by no more than their noise makes them.
        means = voltage[: len(voltage) // 10 * 10].reshape(10, -1).mean(axis=1)
        if noise > 0.0 and float(np.std(means)) < 3.0 * noise / math.sqrt(len(voltage) // 10):
            deviations[held] = voltage - float(np.mean(voltage))
            sizes.append((len(voltage), noise))
    if not sizes:
        return _before_a_wave(run, record)
    return math.sqrt(sum(n * one**2 for n, one in sizes) / sum(n for n, _ in sizes)), deviations


def _before_a_wave(run: Run, record: Record) -> tuple[float, FloatArray] | None:
    """The same from the rest before a wave that begins without an edge."""
    moved = np.flatnonzero(np.abs(run.voltage) > 0.05 * float(np.abs(run.voltage).max()))
    stop = int(moved[0]) // 2 if len(moved) and not len(record.edges) else 0
    if stop < _FEWEST:
        return None
    deviations = np.zeros(len(run))
    deviations[:stop] = run.voltage[:stop] - float(np.mean(run.voltage[:stop]))
    noise = noise_of_readings(run.voltage[:stop])
    return (noise, deviations) if noise > 0.0 else None


def _hold(run: Run) -> Hold:
    return "zero" if run.hold == "unknown" else run.hold


def _pulse(actuator: Actuator, kind: tuple[float, Hold, float]) -> FloatArray:
    """The current [A/V] after one row of voltage."""
    rate, hold, shunt = kind
    if shunt:
        name = "circuit.contact_resistance"
        actuator = actuator.replace(**{name: actuator[name] + shunt})
    time = np.arange(_ROWS) / rate
    small = 1e-3  # a leak is straight so near to nothing
    voltage = np.where(np.arange(_ROWS) == 1, small, 0.0)
    run = simulate(actuator, Samples(time, voltage), duration=_ROWS / rate, rate=rate, hold=hold)
    return np.asarray(run.channels["current"])[1:] / small


def _half_gradient(actuator: Actuator, names: Sequence[str], kind: tuple[float, Hold, float]) -> FloatArray:
    """Half the derivatives of the squared answer to one row of voltage with respect to parameters."""
    slopes = np.zeros(len(names))
    for place, name in enumerate(names):
        if name.startswith(_NOT_ELECTRIC):
            continue
        step = _STEP * (abs(actuator[name]) or 1.0)
        try:
            ends = [_pulse(actuator.replace(**{name: actuator[name] + sign * step}), kind) for sign in (1.0, -1.0)]
        except InputError:
            continue  # it is at the end of its range
        slopes[place] = (float(ends[0] @ ends[0]) - float(ends[1] @ ends[1])) / (4.0 * step)
    return slopes


def _not_applied(deviations: FloatArray, left: FloatArray, answer: FloatArray) -> float:
    """What part of the variance of a scatter the current does not answer, as far as its residuals are sure of it."""
    answered = np.convolve(deviations, answer)[: len(deviations)]
    used = (deviations != 0.0) & np.isfinite(left)
    power = float(answered[used] @ answered[used])
    if np.count_nonzero(used) < _FEWEST or power == 0.0:
        return 0.0
    share = -float(answered[used] @ left[used]) / power
    error = float(np.std(left[used])) / math.sqrt(power)
    return min(share, 1.0) if share > _SURE * error else 0.0


def _reported_of(fit: Fit, moved: Mapping[str, float], scatter: float) -> list[Finding]:
    parts = {name: away / fit.parameters[name].standard_error for name, away in moved.items()}
    worst = names_by_size({name: part for name, part in parts.items() if abs(part) >= _REPORTED_FROM})
    if not worst:
        return []
    text = ", ".join(
        f"{name} by {100.0 * moved[name] / fit.actuator[name]:+.2g} % ({parts[name]:+.1f} standard errors)"
        for name in worst
    )
    return [
        Finding(
            CODE,
            "warning",
            f"the recorded voltage scatters by {1e3 * scatter:.2g} mV where it is held, and the current does not "
            f"answer: this is noise of the voltage's own measurement, which the fit takes for voltage that was "
            f"applied; it moves {text}",
            "give the voltage that was commanded (the signal) in place of the measured one, or average it where it is "
            "held; the fit then has no longer its scatter",
            values={"scatter": scatter, **parts},
        )
    ]
