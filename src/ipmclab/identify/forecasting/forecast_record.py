"""A record up to an origin, and its forecast: the part behind ``forecast`` that filters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.identify.fit import Fit
from ipmclab.identify.forecasting.disturbance import Disturbance, filter_readings
from ipmclab.identify.forecasting.doubts import (
    age_finding,
    free_length,
    left_open,
    reach_finding,
    undetermined_finding,
    without_open_ratios,
)
from ipmclab.identify.forecasting.forecast_values import Forecast, ForecastSettings, known_channel
from ipmclab.model.given import need_actuator, need_run
from ipmclab.quality import check, usable
from ipmclab.run import Finding, Run

if TYPE_CHECKING:
    from ipmclab.model import Actuator
    from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

_FEWEST_STEPS: Final = 10
_BEFORE: Final = 3  # rows before an edge that may belong to it
_BLOCKS: Final = 8
_REOPENED: Final = 2.0  # s after the contact came back that do not tell how strong the disturbance is


@dataclass(frozen=True, eq=False)
class Prepared:
    """A record up to an origin, its planned voltage, and what the actuator answers to both.

    Made once where several settings are tried.

    Parameters
    ----------
    channel : str
    has_model : bool
        Whether there is an actuator, and with it the drift.
    origin, edge : float [s]
        Of the last reading, and of the first voltage edge.
    time, readings : float array, shape (n_past,)
        NaN where a reading is not used.
    ahead : float array, shape (n_ahead,) [s]
    response : float array, shape (n_past + n_ahead,) [SI]
        The actuator's, at its own ratios.
    names : tuple of str
        The ratios that are learnt.
    ratios : tuple of float
        Their values in the actuator.
    slopes, anew : float array, shape (n_past + n_ahead, n_names)
        Of the response by each ratio; the same for a voltage that only came back with the contact.
    gain, spread : float array, shape (n_names,)
        Response per volt and unit ratio; stated uncertainty of the ratio, 0 where there is none.
    excursion, volts : float
        The largest up to the origin [SI, V].
    reopened : tuple of float [s]
        When a lost contact came back.
    findings : tuple of Finding
    free_length : float [m]
        How far a displacement can go; infinite where nothing bounds the channel.
    """

    channel: str
    has_model: bool
    origin: float
    edge: float
    time: FloatArray
    readings: FloatArray
    ahead: FloatArray
    response: FloatArray
    names: tuple[str, ...]
    ratios: tuple[float, ...]
    slopes: FloatArray
    anew: FloatArray
    gain: FloatArray
    spread: FloatArray
    reopened: tuple[float, ...]
    findings: tuple[Finding, ...]
    free_length: float
    volts: float

    @cached_property
    def excursion(self) -> float:
        """How far the readings went from where they were before the first edge [SI]."""
        known = np.isfinite(self.readings)
        before, later = (self.readings[known & side] for side in (self.time < self.edge, self.time >= self.edge))
        if not len(later):
            return 0.0
        return float(np.max(np.abs(later - (before[-1] if len(before) else later[0]))))

    def filled(self, settings: ForecastSettings) -> ForecastSettings:
        """The settings with what was left out taken from the record."""
        amplitude, curl = settings.amplitude, settings.curl
        return replace(
            settings,
            amplitude=(0.5 * self.excursion / self.volts if self.volts else 0.0) if amplitude is None else amplitude,
            curl=0.01 * self.excursion if curl is None else curl,
            step=max(settings.step, float(np.median(np.diff(self.time)))),
        )

    def forecast(self, settings: ForecastSettings, *, level: float = 0.8) -> Forecast:
        """Forecast with these settings.

        Raises
        ------
        InputError
        """
        if not (_is_number(level) and 0.0 < level < 1.0):
            raise InputError(
                f"the level is {level!r}, it must lie between 0 and 1",
                code="bad-level",
                where="level",
                repair="give 0.8 for a band that holds four readings of five",
            )
        settings = self.filled(settings)
        past = len(self.time)
        place = _steps(self.time, self.origin, settings.step, self.edge)
        every = np.arange(int(place.min()), 1)
        times = self.origin + settings.step * (every - 0.5)
        settling = (self.time > self.edge - settings.step) & (self.time < self.edge + settings.settle)
        known = np.where(settling, np.nan, self.readings)
        readings = _means(known - self.response[:past], place, every)
        columns, mean, deviation = self._columns(settings)
        # A step without rows has no regressors either; its reading is missing, so that any finite number does.
        regressors = np.zeros((len(every), len(mean)))
        for one, column in enumerate(columns.T):
            regressors[:, one] = np.nan_to_num(_means(column[:past], place, every))
        judged = times >= self.edge + settings.span
        for back in self.reopened:
            judged &= (times + settings.span < back) | (times > back + _REOPENED)
        count = max(1, round(settings.span / settings.step))
        if np.count_nonzero(judged[:-count] & np.isfinite(readings[count:])) < _FEWEST_STEPS:
            soonest = self.edge + 2.0 * settings.span + _FEWEST_STEPS * settings.step
            raise InputError(
                f"the origin {self.origin:.6g} s is too soon after the voltage came on at {self.edge:.6g} s, or too "
                "few readings lie between them: nothing tells yet how strong the disturbance is",
                code="origin-too-soon",
                where="origin",
                repair=f"give an origin from {soonest:.4g} s on, or a shorter settings.span",
            )
        disturbance = Disturbance(settings.memory)
        state = filter_readings(
            disturbance, readings, regressors, (mean, deviation), settings.step, settings.span, judged
        )
        expected, variance = state.predict(disturbance, self.ahead - self.origin, columns[past:])
        expected = expected + self.response[past:]
        sigma = np.sqrt(variance)
        beyond = reach_finding(self.ahead, expected, self.free_length)
        half = _quantile(0.5 + 0.5 * level) * sigma
        # Of a noise-free record a coefficient may be known to rounding, and its variance below 0 by as much.
        errors = np.sqrt(np.maximum(np.diag(state.covariance)[2:], 0.0))
        return Forecast(
            channel=self.channel,
            origin=self.origin,
            time=self.ahead,
            mean=expected,
            lower=expected - half,
            upper=expected + half,
            standard_deviation=sigma,
            level=level,
            settings=settings,
            # A ratio is what the slopes are by; its own value is where the response was taken.
            coefficients=self._learnt(state.mean[2:], errors),
            findings=self.findings if beyond is None else (*self.findings, beyond),
        )

    def _learnt(self, values: FloatArray, errors: FloatArray) -> dict[str, tuple[float, float]]:
        """What was learnt of the ratios and of the drift, without what starts anew."""
        if not self.has_model:
            return {}
        own = [(float(value), float(error)) for value, error in zip(values, errors, strict=True)]
        count = len(self.names)
        found = {
            name: (value + start, error)
            for name, start, (value, error) in zip(self.names, self.ratios, own[:count], strict=True)
        }
        return {**found, "curl": own[-1]}

    def _columns(self, settings: ForecastSettings) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Regressors at every row, with prior means and standard deviations of their coefficients."""
        if not self.has_model:
            return np.zeros((len(self.response), 0)), np.zeros(0), np.zeros(0)
        assert settings.amplitude is not None
        assert settings.curl is not None
        rows = np.concatenate([self.time, self.ahead])
        ratio = np.where(self.spread > 0.0, self.spread, settings.amplitude / self.gain)
        columns = np.column_stack([self.slopes, self.anew, rows - self.edge])
        restart = np.tile(settings.contact * settings.amplitude / self.gain, len(self.reopened))
        slope, error = self.drift
        deviation = np.concatenate([ratio, restart, [math.hypot(error, settings.curl)]])
        mean = np.zeros(len(deviation))
        mean[-1] = slope
        return columns, mean, deviation

    @cached_property
    def drift(self) -> tuple[float, float]:
        """Slope of the readings before the first edge and its standard error [SI/s]; 0 and 0 where nothing tells."""
        rows = np.flatnonzero((self.time < self.edge) & np.isfinite(self.readings))[:-_BEFORE]
        if len(rows) < 5 * _BLOCKS:
            return 0.0, 0.0
        # Slopes of blocks scatter by all that the strip does of itself, which a straight line's residuals hide.
        slopes = [
            np.polyfit(self.time[block] - self.time[block[0]], self.readings[block], 1)[0]
            for block in np.array_split(rows, _BLOCKS)
        ]
        whole = np.polyfit(self.time[rows] - self.time[rows[0]], self.readings[rows], 1)[0]
        return float(whole), float(np.std(slopes)) / math.sqrt(_BLOCKS)


def prepare(
    model: Actuator | Fit | None, run: Run, *, origin: float, horizon: float = 10.0, channel: str = "displacement"
) -> Prepared:
    """A record up to an origin, for one forecast or for several with other settings. See ``forecast``.

    Raises
    ------
    InputError
    """
    values = _checked(run, origin, horizon, channel)
    actuator = model.actuator if isinstance(model, Fit) else model
    kept: list[Finding] = []
    if actuator is not None:
        need_actuator(actuator)
        names_open = left_open(model, channel)
        actuator, open_ratios = without_open_ratios(actuator, channel, names_open)
        kept += [one for one in [undetermined_finding(names_open, open_ratios)] if one is not None]
    past = int(np.searchsorted(run.time, origin + 1e-9 * max(abs(origin), 1.0), side="right"))
    seen = _until(run, past)
    findings = check(seen)
    voltage = run.voltage.copy()
    reopened: list[float] = []
    followed: list[Finding] = []
    for finding in findings:
        if finding.code == "contact-missing":
            kept.append(finding)
            followed.append(finding)  # it drifts there as it did before
            for start, stop in finding.samples:
                voltage[start:stop] = 0.0
        elif finding.code == "sampling-period-unknown":
            kept.append(finding)  # every second of the forecast hangs on it
        elif finding.code == "contact-lost":
            kept.append(finding)
            reopened += [float(run.time[stop]) for _, stop in finding.samples if stop < past]
        elif finding.code == "rate-jump" and finding.channel == channel:
            kept.append(finding)
            followed.append(finding)  # the filter goes on through it: the level moves, the model stays
    # What another finding says of the same rows still holds: a spike stays out.
    used = usable(seen, [finding for finding in findings if finding not in followed])[channel]
    old = age_finding(run.time[:past], used & np.isfinite(values[:past]), horizon, channel)
    kept += [] if old is None else [old]
    on = np.flatnonzero(np.abs(voltage[:past]) > 0.02 * np.abs(voltage[:past]).max(initial=0.0))
    edge = float(run.time[on[0]]) if len(on) else float(run.time[0])
    time, volts = _planned(run, voltage, past, horizon)
    names, response, slopes, anew, gain, spread = _responses(actuator, run, channel, time, volts, reopened)
    if not np.isfinite(response).all():
        raise InputError(
            f"the actuator's {channel} is no number at {time[~np.isfinite(response)][0]:.6g} s",
            code="bad-output",
            where="forecast",
            repair="the strip left its laser there, or the numbers are beyond floating point: correct the actuator",
        )
    return Prepared(
        channel=channel,
        has_model=actuator is not None,
        origin=float(run.time[past - 1]),
        edge=edge,
        time=time[:past],
        readings=np.where(used, values[:past], np.nan),
        ahead=time[past:],
        response=response,
        names=names,
        ratios=tuple(actuator[name] for name in names) if actuator is not None else (),
        slopes=slopes,
        anew=anew,
        gain=gain,
        spread=spread,
        reopened=tuple(reopened),
        findings=tuple(kept),
        free_length=free_length(actuator, channel),
        volts=float(np.abs(voltage[:past]).max(initial=0.0)),
    )


def _checked(run: Run, origin: float, horizon: float, channel: str) -> FloatArray:
    known_channel(channel)
    need_run(run)
    values: FloatArray | None = getattr(run, channel)
    if values is None or not np.isfinite(values).any():
        raise InputError(
            f"the run has no {channel}", code="no-readings", where=channel, repair="give a run that measured it"
        )
    first, last = float(run.time[0]), float(run.time[-1])
    for name, given in (("origin", origin), ("horizon", horizon)):
        if not _is_number(given):
            raise InputError(
                f"the {name} is {given!r}, it must be a number",
                code=f"bad-{name}",
                where=name,
                repair=f"give it in s, such as {name}=30.0",
            )
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


def _is_number(given: Any) -> bool:
    return isinstance(given, Real) and not isinstance(given, bool)


def _until(run: Run, past: int) -> Run:
    """The run as it was at the origin: what came later must not tell what is wrong with it."""

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
        time_environment=None,
    )


def _planned(run: Run, voltage: FloatArray, past: int, horizon: float) -> tuple[FloatArray, FloatArray]:
    """Times and voltages up to the horizon; the last voltage stays where the run ends before it."""
    end = run.time[past - 1] + horizon
    stop = int(np.searchsorted(run.time, end + 1e-9 * max(abs(end), 1.0), side="right"))
    time, volts = run.time[:stop], voltage[:stop]
    period = float(np.median(np.diff(run.time)))
    more = math.floor((end - time[-1]) / period + 1e-9)
    if more > 0:
        time = np.concatenate([time, time[-1] + period * np.arange(1, more + 1)])
        volts = np.concatenate([volts, np.full(more, volts[-1])])
    return time, volts


def _responses(
    actuator: Actuator | None, run: Run, channel: str, time: FloatArray, volts: FloatArray, reopened: list[float]
) -> tuple[tuple[str, ...], FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Names of the ratios, response, slopes by them, slopes of what starts anew, response per volt, uncertainty."""
    none = np.zeros((len(time), 0))
    if actuator is None:
        return (), np.zeros(len(time)), none, none, np.zeros(0), np.zeros(0)
    from ipmclab.model.sensitivity import sensitivities, simulate_outputs
    from ipmclab.model.simulate import with_shunt

    strip = with_shunt(actuator, run)
    hold: Hold = "zero" if run.hold == "unknown" else run.hold
    names = tuple(
        name for name in strip.parameter_values if name.startswith(f"relaxation.{channel}.") and name.endswith(".ratio")
    )
    if not names:
        response = simulate_outputs(strip, time, volts, hold, outputs=[channel])[0]
        return (), response, none, none, np.zeros(0), np.zeros(0)
    answer = sensitivities(strip, names, time, volts, hold, outputs=[channel])
    # A step of 1 V at rest for long beyond the slowest mode tells the response per volt.
    slowest = max(strip[name.replace(".ratio", ".time_constant")] for name in names)
    long = np.linspace(0.0, 30.0 * slowest, 200)
    per_volt = sensitivities(strip, names, long, np.ones(200), "zero", outputs=[channel])
    anew = [
        sensitivities(strip, names, time, np.where(time >= back, volts, 0.0), hold, outputs=[channel]).parameters[0]
        for back in reopened
    ]
    return (
        names,
        answer.values[0],
        answer.parameters[0],
        np.column_stack([none, *anew]),
        np.abs(per_volt.parameters[0][-1]),
        np.array([strip.standard_uncertainties.get(name, 0.0) for name in names]),
    )


def _steps(time: FloatArray, origin: float, step: float, edge: float) -> npt.NDArray[np.intp]:
    """The step of each row, 0 for the one that ends at the origin; 1 where it lies before the edge and is left out."""
    place = np.ceil((time - origin) / step - 1e-6).astype(np.intp)
    first = int(np.floor((edge - origin) / step))
    return np.where(place >= first, place, 1)


def _means(values: FloatArray, place: npt.NDArray[np.intp], every: npt.NDArray[np.intp]) -> FloatArray:
    """Mean over the rows of each step; NaN where none has a value."""
    known = np.isfinite(values) & (place <= 0)
    index = place[known] - every[0]
    count = np.bincount(index, minlength=len(every))
    total = np.bincount(index, weights=values[known], minlength=len(every))
    with np.errstate(invalid="ignore"):
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _quantile(probability: float) -> float:
    from statistics import NormalDist

    return NormalDist().inv_cdf(probability)
