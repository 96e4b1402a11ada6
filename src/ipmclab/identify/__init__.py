"""From runs to a fitted actuator, and what it predicts."""

from __future__ import annotations

from ipmclab.identify.choosing.choice import Candidate, Choice
from ipmclab.identify.choosing.choose import choose
from ipmclab.identify.fit import Direction, Fit, FittedParameter
from ipmclab.identify.fit_file import read_fit, write_fit
from ipmclab.identify.forecasting.forecast import Forecast, forecast, with_slow_modes
from ipmclab.identify.forecasting.forecast_values import ForecastSettings
from ipmclab.identify.identify import identify
from ipmclab.identify.many_runs.bands import Bands, prediction_bands
from ipmclab.identify.many_runs.left_out import LeftOut, leave_one_run_out
from ipmclab.identify.many_runs.mountings import Mounting, Mountings
from ipmclab.identify.observation import Observation
from ipmclab.identify.posterior.posterior import Posterior, sample_posterior, write_posterior
from ipmclab.identify.procedure.follow import Characterisation, follow_procedure
from ipmclab.identify.procedure.procedure_file import read_procedure
from ipmclab.identify.uncertainty.bootstrap import Bootstrap, bootstrap
from ipmclab.identify.uncertainty.profiles import Profile, profile
from ipmclab.identify.undetermined.identifiable import Identifiability, identifiability
from ipmclab.identify.undetermined.practical import CollinearSet, Combination, Practical
from ipmclab.identify.validate import RunValidation, Validation, validate

__all__ = [
    "Bands",
    "Bootstrap",
    "Candidate",
    "Characterisation",
    "Choice",
    "CollinearSet",
    "Combination",
    "Direction",
    "Fit",
    "FittedParameter",
    "Forecast",
    "ForecastSettings",
    "Identifiability",
    "LeftOut",
    "Mounting",
    "Mountings",
    "Observation",
    "Posterior",
    "Practical",
    "Profile",
    "RunValidation",
    "Validation",
    "bootstrap",
    "choose",
    "follow_procedure",
    "forecast",
    "identifiability",
    "identify",
    "leave_one_run_out",
    "prediction_bands",
    "profile",
    "read_fit",
    "read_procedure",
    "sample_posterior",
    "validate",
    "with_slow_modes",
    "write_fit",
    "write_posterior",
]
