"""The environment: water content and temperature of a membrane, and how parameters follow them."""

from __future__ import annotations

from ipmclab.model.environment.conditions import Environment, EnvironmentLaw, WaterState
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import equilibrium, reference
from ipmclab.model.environment.moved import Moved, in_state, values_in

__all__ = [
    "Environment",
    "EnvironmentHistory",
    "EnvironmentLaw",
    "Moved",
    "WaterState",
    "equilibrium",
    "in_state",
    "reference",
    "values_in",
]
