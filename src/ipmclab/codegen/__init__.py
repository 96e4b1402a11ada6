"""An actuator as a program of other tools, written from its assembled system."""

from __future__ import annotations

from ipmclab.codegen.export import TARGETS as TARGETS
from ipmclab.codegen.export import export_actuator as export_actuator

__all__ = ["TARGETS", "export_actuator"]
