"""A record up to an origin, on steps of equal length, with the voltage that is planned and what an actuator answers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.forecasting.doubts import (
    age_finding,
    circuit_alone,
    free_length,
    left_open,
    undetermined_finding,
    without_open_ratios,
)
from ipmclab.forecasting.forecast_values import known_channel
from ipmclab.model import Actuator
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.request import MOST_ROWS
from ipmclab.model.simulate import with_shunt
from ipmclab.quality import check, usable
from ipmclab.quality.noise import noise_level
from ipmclab.run import Finding, Hold, Run

FloatArray = npt.NDArray[np.float64]

STEP: Final = 0.2  # s between the readings that a forecast looks at (convention)
SETTLE: Final = 2.0
"""Seconds after the first edge that are left out: there a row of delay looks like a slow answer (convention)."""


@dataclass(frozen=True, eq=False)
class Past:
    """What was read up to an origin, as means over steps, and what is planned beyond it.

    Parameters
    ----------
    channel : str
    origin, edge : float [s]
        Of the last row that was observed, and of the first voltage edge.
    step : float [s]
    edge_step, first, now : int
        Steps of the edge, of the first reading that is used, after the edge, and of the last.
    rest : float [SI]
        The reading before the edge; NaN where there is none.
    readings, all_readings : float array, shape (now + 1,)
        NaN where none is used; and with those until the first that is used.
    scatter : float [SI]
        Standard deviation of a reading about the mean of its step.
    planned, held : float array, shape (n_steps,) [V]
        Voltage up to the horizon: as planned, and as it stays at the origin.
    ahead : float array, shape (n_ahead,) [s]
    leads : float array, shape (n_ahead,) [s]
        From the middle of the last step with a reading.
    response : float array, shape (n_steps,), or None without an actuator
        The actuator's, for the voltage as it stays.
    response_to_plan : float array, shape (n_ahead,)
        What the plan changes in it at the rows ahead; 0 without an actuator.
    findings : tuple of Finding
    free_length : float [m]
        How far a displacement can go; infinite where nothing bounds the channel.
    """

    channel: str
    origin: float
    edge: float
    step: float
    edge_step: int
    first: int
    now: int
    rest: float
    readings: FloatArray
    all_readings: FloatArray
    scatter: float
    planned: FloatArray
    held: FloatArray
    ahead: FloatArray
    leads: FloatArray
    response: FloatArray | None
    response_to_plan: FloatArray
    findings: tuple[Finding, ...]
    free_length: float

    @cached_property
    def filled(self) -> FloatArray:
        """The readings, each missing one as the last before it."""
        return _filled(self.readings)


def read_past(
    model: Actuator | Fit | None, run: Run, *, origin: float, horizon: float = 10.0, channel: str = "displacement"
) -> Past:
    """What a forecast starts from. See ``forecast``.

    Raises
    ------
    InputError
    """
    values = _checked(run, origin, horizon, channel)
    actuator = model.actuator if isinstance(model, Fit) else model
    kept: list[Finding] = []
    if actuator is not None:
        kept += circuit_alone(actuator)
        names_open = left_open(model, channel)
        actuator, open_ratios = without_open_ratios(actuator, channel, names_open)
        kept += [one for one in [undetermined_finding(names_open, open_ratios)] if one is not None]
    past = int(np.searchsorted(run.time, origin + 1e-9 * max(abs(origin), 1.0), side="right"))
    observed = _until(run, past)
    findings = check(observed)
    voltage = run.voltage.copy()
    followed: list[Finding] = []
    for finding in findings:
        if finding.code == "contact-missing":
            kept.append(finding)
            followed.append(finding)  # it drifts there as it did before
            for start, stop in finding.samples:
                voltage[start:stop] = 0.0
        elif finding.code in ("sampling-period-unknown", "contact-lost"):
            kept.append(finding)
        elif finding.code in ("noise-only", "rate-jump") and finding.channel == channel:
            kept.append(finding)
            if finding.code == "rate-jump":
                followed.append(finding)  # the reading has moved when the forecast begins
    # What another finding says of the same rows still holds: a spike stays out.
    used = usable(observed, [finding for finding in findings if finding not in followed])[channel]
    used = used & np.isfinite(values[:past])
    old = age_finding(run.time[:past], used, horizon, channel)
    kept += [] if old is None else [old]
    on = np.flatnonzero(np.abs(voltage[:past]) > 0.02 * np.abs(voltage[:past]).max(initial=0.0))
    edge = float(run.time[on[0]]) if len(on) else float(run.time[0])
    time, planned = _planned(run, voltage, past, horizon)
    held = np.where(np.arange(len(time)) < past, planned, planned[past - 1])
    sparse = time[:past][used]
    step = max(STEP, float(np.median(np.diff(sparse if len(sparse) > 1 else time))))
    place = np.ceil((time - time[past - 1]) / step - 1e-6).astype(np.intp)
    place -= place[0]
    count = int(place[-1]) + 1
    every = np.where(used, values[:past], np.nan)
    each = np.where(time[:past] >= edge + SETTLE, every, np.nan)
    readings = _means(each, place[:past], count)
    known = np.flatnonzero(np.isfinite(readings))
    alone = min(len(known) / max(int(np.count_nonzero(np.isfinite(each))), 1), 1.0)
    now = int(known[-1]) if len(known) else 0
    answer = _responses(actuator, run, channel, time, held, planned)
    return Past(
        channel=channel,
        origin=float(time[past - 1]),
        edge=edge,
        step=step,
        edge_step=int(place[np.searchsorted(time[:past], edge)]),
        first=int(known[0]) if len(known) else 0,
        now=now,
        rest=_at_rest(every, time[:past], edge, step),
        readings=readings[: now + 1],
        all_readings=_means(every, place[:past], count)[: now + 1],
        scatter=noise_level(each) * math.sqrt(1.0 - alone),
        planned=_filled(_means(planned, place, count)),
        held=_filled(_means(held, place, count)),
        ahead=time[past:],
        leads=time[past:] - (float(np.mean(time[place == now])) if len(known) else 0.0),
        response=None if answer is None else _filled(_means(answer[0], place, count)),
        response_to_plan=np.zeros(len(time) - past) if answer is None else (answer[1] - answer[0])[past:],
        findings=tuple(kept),
        free_length=free_length(actuator, channel),
    )


def _checked(run: Run, origin: float, horizon: float, channel: str) -> FloatArray:
    known_channel(channel)
    values: FloatArray | None = getattr(run, channel)
    if values is None or not np.isfinite(values).any():
        raise InputError(
            f"the run has no {channel}", code="no-readings", where=channel, repair="give a run that measured it"
        )
    first, last = float(run.time[0]), float(run.time[-1])
    if not (first < origin <= last + 1e-9):
        raise InputError(
            f"the origin {origin!r} s lies outside the run, which lasts from {first:.6g} s to {last:.6g} s",
            code="bad-origin",
            where="origin",
            repair="give a time within the run, counted as run.time counts",
        )
    if not (0.0 < horizon < math.inf):
        raise InputError(
            f"the horizon is {horizon!r}, it must be a number above 0",
            code="bad-horizon",
            where="horizon",
            repair="give it in s, such as 10",
        )
    return values


def _until(run: Run, past: int) -> Run:
    """The run as it was at the origin: what came later must not show what is wrong with it."""

    def cut(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[:past]

    return replace(
        run,
        time=run.time[:past],
        voltage=run.voltage[:past],
        current=cut(run.current),
        displacement=cut(run.displacement),
        force=cut(run.force),
        applied_voltage=cut(run.applied_voltage),
        quality={name: flags[:past] for name, flags in run.quality.items()},
        raw={},
        temperature=None,
        relative_humidity=None,
        chamber_temperature=None,
        chamber_relative_humidity=None,
        time_environment=None,
    )


def _planned(run: Run, voltage: FloatArray, past: int, horizon: float) -> tuple[FloatArray, FloatArray]:
    """Times and voltages up to the horizon; the last voltage stays where the run ends before it."""
    end = run.time[past - 1] + horizon
    stop = int(np.searchsorted(run.time, end + 1e-9 * max(abs(end), 1.0), side="right"))
    time, volts = run.time[:stop], voltage[:stop]
    period = float(np.median(np.diff(run.time)))
    more = math.floor((end - time[-1]) / period + 1e-9)
    if more > MOST_ROWS:
        raise InputError(
            f"{horizon:g} s are {more} rows of {period:g} s, allowed are {MOST_ROWS}",
            code="too-many-rows",
            where="horizon",
            repair="give a shorter horizon",
        )
    if more > 0:
        time = np.concatenate([time, time[-1] + period * np.arange(1, more + 1)])
        volts = np.concatenate([volts, np.full(more, volts[-1])])
    return time, volts


def _responses(
    actuator: Actuator | None, run: Run, channel: str, time: FloatArray, held: FloatArray, planned: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """What an actuator answers to the voltage as it stays, and to the plan."""
    if actuator is None:
        return None
    strip = with_shunt(actuator, run)
    hold: Hold = "zero" if run.hold == "unknown" else run.hold
    stays = simulate_outputs(strip, time, held, hold, outputs=[channel])[0]
    plan = (
        stays if np.array_equal(held, planned) else simulate_outputs(strip, time, planned, hold, outputs=[channel])[0]
    )
    for response in (stays, plan):
        if not np.isfinite(response).all():
            raise InputError(
                f"the actuator's {channel} is no number at {time[~np.isfinite(response)][0]:.6g} s",
                code="bad-output",
                where="forecast",
                repair="the strip left its laser there, or the numbers are beyond floating point: correct the actuator",
            )
    return stays, plan


def _means(values: FloatArray, place: npt.NDArray[np.intp], count: int) -> FloatArray:
    """Mean over the rows of each step; NaN where none has a value."""
    known = np.isfinite(values)
    rows = np.bincount(place[known], minlength=count)
    total = np.bincount(place[known], weights=values[known], minlength=count)
    return np.where(rows > 0, total / np.maximum(rows, 1), np.nan)


def _at_rest(values: FloatArray, time: FloatArray, edge: float, step: float) -> float:
    """The last readings before the edge, as long as a step; where the record begins with it, the first one."""
    known = np.flatnonzero(np.isfinite(values) & (time < edge if edge > time[0] else time <= edge))
    if not len(known):
        return math.nan
    return float(np.mean(values[known[time[known] > time[known[-1]] - step]]))


def _filled(values: FloatArray) -> FloatArray:
    known = np.where(np.isfinite(values), np.arange(len(values)), 0)
    return np.asarray(values[np.maximum.accumulate(known)])
