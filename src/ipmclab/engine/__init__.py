"""A map over independent tasks: in this process, in processes of this machine, or on a cluster."""

from __future__ import annotations

from ipmclab.engine.engine import Engine, Here, in_order
from ipmclab.engine.opened import opened
from ipmclab.engine.pace import Pace

__all__ = ["Engine", "Here", "Pace", "in_order", "opened"]
