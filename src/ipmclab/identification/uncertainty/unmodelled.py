r"""How much a strip may do that the model of a fit lacks: what the readings of the fit themselves allow.

No model of a strip is complete. What it lacks answers the voltage too, and is taken as relaxations of all time
constants :math:`\tau`: the readings are

.. math:: y = \eta(\theta) + G a + \varepsilon, \qquad a_\tau \sim N\bigl(0,\ s^2\,(T/\tau)\,d\ln\tau\bigr),

where :math:`G` is the voltage behind the lags, :math:`\varepsilon` the noise that was found and :math:`T` the length of
the record from where its voltage first moves. The spectrum is that of diffusion (a Warburg impedance). With
:math:`\theta` as it is best for each :math:`a`, the readings say of the size :math:`s` what their restricted likelihood
says (stochastic embedding: Goodwin, Gevers and Ninness 1992). Beforehand it is as likely as not that nothing is
lacking; if something is, :math:`s` is about as large as what the fitted strip itself relaxes by, in the root mean
square over logarithms of time (a half normal distribution).

Averaged over :math:`s`, the readings leave :math:`E[a a']`. The parameters have made up for :math:`a` by :math:`-K a`
with :math:`K = (J' V^{-1} J)^{-1} J' V^{-1} G`, so that a prediction is off by :math:`(G_{new} - J_{new} K)\,a`. Within
the time that the record shows, its readings hold this down; beyond, it grows. Where slow relaxations do not follow the
voltage, it hardly shows.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.fit.unmodelled import APART, Unmodelled, lag_times, lagged, voltage_levels
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.pieces import directions_of
from ipmclab.model import Actuator
from ipmclab.model.order import Order
from ipmclab.model.step_relaxation import step_relaxation
from ipmclab.run import FloatArray

_SIZES: Final = np.geomspace(1e-3, 4.0, 40)  # of s over what it is at most beforehand (convention)
_NEGLIGIBLE: Final = 1e-6  # of the variance of the amplitudes, that a further direction of theirs adds (convention)


def unmodelled(correlated: Correlated, model: Actuator, order: Order) -> dict[str, Unmodelled]:
    """What the model may lack of each output, where its readings allow anything.

    Parameters
    ----------
    correlated : Correlated
        The solution, and the noise found in its residuals.
    model : Actuator
        As it was fitted, in the reference state.
    order : Order
        What the parameters are called.
    """
    outputs = dict.fromkeys(output for _, output in correlated.problem.pieces)
    return {name: one for name in outputs if (one := _of_output(correlated, model, order, name)) is not None}


def _of_output(correlated: Correlated, model: Actuator, order: Order, output: str) -> Unmodelled | None:
    problem, theta = correlated.problem, correlated.solution.theta
    records = [problem.record_at(place) for place, name in problem.pieces if name == output]
    on = [record for record in records if record.resting < len(record.run)]
    seen = max((float(record.run.time[-1] - record.run.time[record.resting]) for record in on), default=0.0)
    largest = max((float(np.abs(record.run.voltage).max()) for record in on), default=0.0)
    step = min(record.step for record in records)
    if not seen > 2.0 * step:
        return None
    constants = lag_times(step, seen)
    spread = np.asarray(np.sqrt(np.log(APART) * seen / constants), dtype=np.float64)
    most = step_relaxation(model, output, largest, step, seen)
    readings = _readings(correlated, output, constants, spread)
    if readings is None or not most > 0.0:
        return None
    triangle, directions, measured = readings
    known = directions.shape[1]
    values, vectors = np.linalg.eigh(_moments(triangle[known:, known:-1], triangle[known:, -1], most, measured - known))
    kept = values > _NEGLIGIBLE * values.sum()
    if not kept.any() or not np.isfinite(values).all():
        return None
    factors = vectors[:, kept] * np.sqrt(values[kept])
    # By how much each direction makes up for each lag.
    made_up = np.linalg.lstsq(triangle[:known, :known], triangle[:known, known:-1], rcond=None)[0]
    entries = -directions @ made_up @ factors
    moved = {
        order(unknown.name): tuple((unknown.chain(unknown.value(float(theta[place]))) * entries[place]).tolist())
        for place, unknown in problem.asked
    }
    amplitudes = tuple(map(tuple, (spread[:, None] * factors).T.tolist()))
    levels = voltage_levels([record.run.voltage[record.resting :] for record in on])
    return Unmodelled(tuple(constants.tolist()), amplitudes, moved, seen, levels)


def _moments(left: FloatArray, missed: FloatArray, most: float, freedom: int) -> FloatArray:
    """What the readings leave of the amplitudes of the lags, ``E[a a']``: of sizes up to about the most."""
    turned, size, along = np.linalg.svd(left, full_matrices=False)
    shown = turned.T @ missed
    rest = max(float(missed @ missed - shown @ shown), 0.0)
    sizes = np.append(0.0, most * _SIZES)
    shares = 1.0 + np.square(np.outer(sizes, size))
    variances = (rest + np.sum(shown**2 / shares, axis=1)) / freedom
    likelihood = -0.5 * (freedom * np.log(np.maximum(variances, 1e-300)) + np.sum(np.log(shares), axis=1))
    # Sizes lie evenly in their logarithm: each stands for as much as it is large.
    beforehand = np.exp(-0.5 * _SIZES**2) * _SIZES
    beforehand = np.append(1.0, beforehand / beforehand.sum())  # as likely as not, nothing
    weight = np.exp(likelihood - likelihood.max()) * beforehand
    weight /= weight.sum()
    total = np.zeros((len(size), len(size)))
    for part, own, variance, share in zip(weight, sizes, variances, shares, strict=True):
        mean = own**2 * size * shown / share
        total += part * (own**2 * variance * np.diag(1.0 / share) + np.outer(mean, mean))
    return np.asarray(along.T @ total @ along)


def _readings(
    correlated: Correlated, output: str, constants: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray, int] | None:
    """All readings as independent rows of variance one, with the lags in those of one output: a triangle of them.

    In it stand the directions of the parameters, the lags, and last what the model missed; with it come these
    directions, shape (n_unknown, n_directions), and how many readings are measured.
    """
    problem, here = correlated.problem, correlated.solution.evaluation
    directions = directions_of(here)
    known, count = directions.shape[1], len(constants)
    rows = np.vstack([directions.T @ here.rows[:-1], np.zeros((count, here.rows.shape[1])), here.rows[-1:]])
    measured = driven = 0
    for key, piece in problem.pieces.items():
        record, reading = problem.record_at(key[0]), problem.readings[key]
        own, inside = rows[:, piece], reading.exact_of_used
        if key[1] == output:
            lags = spread[:, None] * lagged(record.run.time, record.run.voltage, constants)
            own[known:-1] = lags[:, reading.used] / problem.noise[key]
            driven += int(np.sum(inside & (np.flatnonzero(reading.used) >= record.resting)))
        if key in correlated.shapes and not correlated.is_weighted:
            own[:known], own[-1] = directions.T @ correlated.plain.rows[:-1, piece], correlated.plain.rows[-1, piece]
            own[:] = correlated.pieces[key].whitening(correlated.about_zeros[key]).apply(own)
        else:
            own[known:-1] = problem.whitened(key, own[known:-1])
            variance = float(np.mean(own[-1, inside] ** 2)) if inside.any() else 1.0
            if not variance > 0.0:
                return None  # readings that the model meets exactly
            own[:, inside] /= np.sqrt(variance)
        measured += int(inside.sum())
    if driven <= known + 1 or not np.isfinite(rows).all():
        return None
    size = known + count + 1
    return np.asarray(np.linalg.qr(np.vstack([rows.T, np.zeros((size, size))]), mode="r")), directions, measured
