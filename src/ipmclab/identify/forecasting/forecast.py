"""What a strip will do next: its model where it knows, the drift it had, and honest bands for the rest."""

from __future__ import annotations

import numpy as np

from ipmclab.identify.fit import Fit
from ipmclab.identify.forecasting.doubts import table_without
from ipmclab.identify.forecasting.forecast_record import prepare
from ipmclab.identify.forecasting.forecast_values import Forecast, ForecastSettings, known_channel
from ipmclab.model import Actuator
from ipmclab.model.given import need_actuator
from ipmclab.run import Run

__all__ = ["Forecast", "ForecastSettings", "forecast", "prepare", "with_slow_modes"]


def with_slow_modes(
    actuator: Actuator, *, channel: str = "displacement", shortest: float = 0.4, longest: float = 60.0, modes: int = 9
) -> Actuator:
    """The actuator with relaxation modes spread evenly over the logarithm of their time constants, all ratios 0.

    A record up to an origin cannot tell a few time constants; a spread of modes, each likely small, need not choose.

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
    need_actuator(actuator)
    prefix = f"relaxation.{channel}."
    values = {name: value for name, value in actuator.parameter_values.items() if not name.startswith(prefix)}
    for place, time_constant in enumerate(np.geomspace(shortest, longest, modes)):
        values[f"{prefix}{place}.ratio"] = 0.0
        values[f"{prefix}{place}.time_constant"] = float(time_constant)
    return Actuator(
        name=f"{actuator.name}+relaxation.{channel}={modes}",
        parameter_values=values,
        standard_uncertainties={n: u for n, u in actuator.standard_uncertainties.items() if n in values},
        sample=actuator.sample,
        # What the fit left open of the rest is told with the forecast.
        fit_table=table_without(actuator.fit_table, [n for n in actuator.parameter_values if n.startswith(prefix)]),
    )


def forecast(
    model: Actuator | Fit | None,
    run: Run,
    *,
    origin: float,
    horizon: float = 10.0,
    channel: str = "displacement",
    level: float = 0.8,
    settings: ForecastSettings | None = None,
) -> Forecast:
    """Forecast a channel of a run beyond an origin, from what was read up to it.

    Nothing that was read after the origin is used; the voltage after it is the plan, and where the run ends before
    the horizon it stays as it was. The reading is the actuator's response, in which the ratios of its slow modes are
    unknown (normal, around their values, with their stated uncertainty or else ``settings.amplitude``), plus a drift
    that continues the one before the first edge, plus a ``Disturbance``; all are filtered exactly.

    Parameters
    ----------
    model : Actuator, Fit or None
        None forecasts without an actuator: a damped local trend.
    run : Run
    origin : float [s]
    horizon : float [s]
    channel : "displacement" or "force"
    level : float
        Probability that the band holds the reading.
    settings : ForecastSettings, optional

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
    >>> len(ahead.time), bool(abs(ahead.mean[-1] - run.displacement[750]) < 1e-6)
    (250, True)
    """
    record = prepare(model, run, origin=origin, horizon=horizon, channel=channel)
    return record.forecast(settings or ForecastSettings(), level=level)
