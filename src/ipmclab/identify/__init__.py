"""From runs to a fitted actuator, and what it predicts."""

from __future__ import annotations

from ipmclab.identify.fit import Direction, Fit, FittedParameter
from ipmclab.identify.fit_file import read_fit, write_fit
from ipmclab.identify.identify import identify
from ipmclab.identify.observation import Observation
from ipmclab.identify.validate import RunValidation, Validation, validate

__all__ = [
    "Direction",
    "Fit",
    "FittedParameter",
    "Observation",
    "RunValidation",
    "Validation",
    "identify",
    "read_fit",
    "validate",
    "write_fit",
]
