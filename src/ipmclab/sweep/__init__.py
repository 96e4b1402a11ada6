"""Sweeps: simulations over a table or a sampling design, reduced to metrics on the way to the disk."""

from __future__ import annotations

from ipmclab.sweep.run_sweep import Swept, run_sweep
from ipmclab.sweep.sweep import Sweep
from ipmclab.sweep.sweep_file import read_sweep

__all__ = ["Sweep", "Swept", "read_sweep", "run_sweep"]
