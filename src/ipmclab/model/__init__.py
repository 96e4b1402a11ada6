"""The model: stages as data, joined into one system that is simulated exactly."""

from __future__ import annotations

from ipmclab.model.actuator import Actuator
from ipmclab.model.actuator_file import (
    actuator_from_text,
    actuator_to_text,
    library_names,
    load_actuator,
    write_actuator,
)
from ipmclab.model.curvature import curvature
from ipmclab.model.line_error import ErrorBound, line_error_bound
from ipmclab.model.many import Responses, simulate_many
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.parameters import Parameter
from ipmclab.model.ports import OUTPUTS
from ipmclab.model.sensitivity import Sensitivities, sensitivities
from ipmclab.model.simulate import simulate
from ipmclab.model.stepping import Simulator
from ipmclab.model.variants import with_stages

__all__ = [
    "OUTPUTS",
    "Actuator",
    "ErrorBound",
    "Parameter",
    "Responses",
    "Sensitivities",
    "Simulator",
    "actuator_from_text",
    "actuator_to_text",
    "curvature",
    "library_names",
    "line_error_bound",
    "load_actuator",
    "sensitivities",
    "simulate",
    "simulate_many",
    "simulate_outputs",
    "with_stages",
    "write_actuator",
]
