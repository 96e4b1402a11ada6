"""What a strip will do next: several simple forecasts, each weighed by how it missed earlier in the same record."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.forecasting.doubts import not_shown_finding, reach_finding, table_without
from ipmclab.forecasting.first_edge import missed_of_plan
from ipmclab.forecasting.forecast_values import Forecast, known_channel
from ipmclab.forecasting.forecasters import HORIZONS, LEARNT, Forecaster, Line, SlowAnswer, judge, past_origins, shown
from ipmclab.forecasting.past import SETTLE, Past, read_past
from ipmclab.forecasting.stacking import LEADS, half_width, weigh
from ipmclab.kinds import tell_kinds
from ipmclab.model import Actuator
from ipmclab.model.stages.relaxation import mode_name
from ipmclab.run import Run

__all__ = ["Forecast", "forecast", "with_slow_modes"]

FEWEST_ORIGINS: Final = 10
"""Past forecasts from which their misses are known (convention)."""


@tell_kinds
def with_slow_modes(
    actuator: Actuator, *, channel: str = "displacement", shortest: float = 0.4, longest: float = 60.0, modes: int = 9
) -> Actuator:
    """The actuator with relaxation modes distributed evenly over the logarithm of their time constants, all ratios 0.

    For fits of long records, which cannot determine a few time constants: a spread of modes, each likely small, need
    not choose. A forecast has a spread of its own and needs none.

    Parameters
    ----------
    actuator : Actuator
    channel : "displacement" or "force"
    shortest, longest : float [s]
    modes : int

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> slow = with_slow_modes(load_actuator("friend-2"), modes=3, shortest=1.0, longest=100.0)
    >>> [round(slow[f"relaxation.displacement.{i}.time_constant"], 9) for i in range(3)]
    [1.0, 10.0, 100.0]
    """
    known_channel(channel)
    prefix = mode_name(channel)
    values = {name: value for name, value in actuator.parameter_values.items() if not name.startswith(prefix)}
    for place, time_constant in enumerate(np.geomspace(shortest, longest, modes)):
        values[f"{prefix}{place}.ratio"] = 0.0
        values[f"{prefix}{place}.time_constant"] = float(time_constant)
    return Actuator(
        name=f"{actuator.name}+relaxation.{channel}={modes}",
        parameter_values=values,
        standard_uncertainties={n: u for n, u in actuator.standard_uncertainties.items() if n in values},
        sample=actuator.sample,
        # What the fit left open of the rest is reported with the forecast.
        fit_table=table_without(actuator.fit_table, [n for n in actuator.parameter_values if n.startswith(prefix)]),
    )


@tell_kinds
def forecast(
    model: Actuator | Fit | None,
    run: Run,
    *,
    origin: float,
    horizon: float = 10.0,
    channel: str = "displacement",
    level: float = 0.8,
) -> Forecast:
    """Forecast a channel of a run beyond an origin, from what was read up to it.

    Nothing that was read after the origin is used; the voltage after it is the plan, and where the run ends before
    the horizon it stays as it was. Several simple forecasts are weighed by how they missed earlier in the same record
    (``forecasting.stacking`` has the mathematics): the last value stays, the last 5 s continue as a straight line, the
    slow answer to the voltage continues as it was learnt, and the actuator's response with it. What the plan changes is
    what these say of it where the voltage moved as far before, else what the actuator answers, or, without one, the
    slow answer.

    Parameters
    ----------
    model : Actuator, Fit or None
        None forecasts without an actuator.
    run : Run
    origin : float [s]
    horizon : float [s]
    channel : "displacement" or "force"
    level : float
        Probability that the band holds the reading.

    Returns
    -------
    forecast : Forecast

    Raises
    ------
    InputError
        A channel that the run does not have, an origin outside it, too soon after the voltage came on or long after
        the last usable reading, a horizon or level that is none.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> actuator = load_actuator("friend-2+relaxation.displacement")
    >>> run = simulate(actuator, "step 1 V", duration=40, rate=25)
    >>> ahead = forecast(actuator, run, origin=20.0)
    >>> len(ahead.time), bool(abs(ahead.mean[-1] - run.displacement[750]) < 1e-5)
    (250, True)
    """
    if not 0.0 < level < 1.0:
        raise InputError(
            f"the level is {level!r}, it must lie between 0 and 1",
            code="bad-level",
            where="level",
            repair="give 0.8 for a band that holds four readings of five",
        )
    past = read_past(model, run, origin=origin, horizon=horizon, channel=channel)
    origins = past_origins(past, horizon)
    if len(origins) < FEWEST_ORIGINS or not len(past.ahead):
        raise _too_soon(past, horizon)
    slow = SlowAnswer(past, origins)
    forecasters: dict[str, Forecaster] = {"line": Line(past, origins), "slow answer": slow}
    plans = [np.zeros(len(past.ahead)), slow.planned()]
    in_full, answering = plans[1], slow
    if past.response is not None:
        forecasters["actuator"] = answered = SlowAnswer(past, origins, past.response)
        plans.append(answered.planned() + past.response_to_plan)
        in_full, answering = past.response_to_plan, answered
    pairs = judge(past, origins, list(forecasters.values()), horizon)
    if len(pairs.lead) < FEWEST_ORIGINS:
        raise _too_soon(past, horizon)
    weights = weigh(pairs)
    # Where the voltage moved in the past, the weights are those of what each said of that; where it always stayed no
    # miss shows what a move does.
    known = shown(past, origins, horizon)
    plan = known * (np.column_stack(plans) @ weights) + (1.0 - known) * in_full
    moves = np.column_stack([one.ahead() for one in forecasters.values()]) @ weights
    mean = past.readings[past.now] + moves + plan
    half = half_width(pairs, weights, past.leads, level, scatter=past.scatter)
    missed = missed_of_plan(past, answering.of_first_edge()) if known < 1.0 else np.zeros(len(half))
    half = half + (0.0 if missed is None else (1.0 - known) * missed)
    said = [not_shown_finding(channel) if missed is None else None]
    said.append(reach_finding(past.ahead, mean, past.free_length))
    return Forecast(
        channel=channel,
        origin=past.origin,
        time=past.ahead,
        mean=mean,
        lower=mean - half,
        upper=mean + half,
        level=level,
        weights={"hold": 1.0 - float(weights.sum()), **dict(zip(forecasters, map(float, weights), strict=True))},
        horizons_observed=pairs.observed,
        findings=(*past.findings, *(one for one in said if one is not None)),
    )


def _too_soon(past: Past, horizon: float) -> InputError:
    if not len(past.ahead) or HORIZONS * horizon < FEWEST_ORIGINS * past.step:
        return InputError(
            f"the horizon {horizon:g} s is too short: a forecast is made from means over {past.step:g} s",
            code="bad-horizon",
            where="horizon",
            repair=f"give {past.step:g} s or more",
        )
    soonest = past.edge + SETTLE + LEARNT + FEWEST_ORIGINS * past.step + horizon / LEADS
    return InputError(
        f"the origin {past.origin:.6g} s is too soon after the voltage came on at {past.edge:.6g} s, or too few "
        "readings lie between them: it is not known yet how large the error of a forecast would be",
        code="origin-too-soon",
        where="origin",
        repair=f"give an origin from {soonest:.4g} s on, or a shorter horizon",
    )
