"""A procedure: what was measured by hand on one strip, and which runs belong to which step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ipmclab.measurement.push import Push
from ipmclab.measurement.uncertain import Uncertain, exact
from ipmclab.procedure.four_probe import FourProbes
from ipmclab.run import Run
from ipmclab.sample import Sample

Runs = tuple[tuple[str, Run], ...]
"""Runs with what they are called."""


@dataclass(frozen=True, eq=False)
class Procedure:
    """What there is so far; what is left out was not done yet.

    Parameters
    ----------
    name : str
        Of the strip.
    geometry : mapping of dotted name to Uncertain [m]
    sample : Sample, optional
    contact_resistance : Uncertain [ohm]
    sheet_resistance : FourProbes or Uncertain [ohm/sq], optional
        Readings of four probes, or a value from elsewhere; so with the others.
    dc_resistance : Runs or Uncertain [ohm], optional
    branches : Runs, optional
    branch_count : int
    mass : Uncertain [kg], optional
        Of the whole wet strip.
    density : Uncertain [kg/m^3], optional
        In place of the mass.
    modulus : Push or Uncertain [Pa], optional
    push_position : Uncertain [m], optional
        The sensing length where it is left out.
    coupling : Runs, optional
    files : tuple of Path
        Where the runs were read, that of a push too.
    """

    name: str
    geometry: Mapping[str, Uncertain]
    sample: Sample | None = None
    contact_resistance: Uncertain = field(default_factory=lambda: exact(0.0))
    sheet_resistance: FourProbes | Uncertain | None = None
    dc_resistance: Runs | Uncertain | None = None
    branches: Runs = ()
    branch_count: int = 2
    mass: Uncertain | None = None
    density: Uncertain | None = None
    modulus: Push | Uncertain | None = None
    push_position: Uncertain | None = None
    coupling: Runs = ()
    files: tuple[Path, ...] = ()

    @property
    def runs(self) -> Runs:
        """Every run once, in the order of the steps."""
        steady = () if isinstance(self.dc_resistance, Uncertain) or self.dc_resistance is None else self.dc_resistance
        found: dict[str, tuple[str, Run]] = {}
        for label, run in (*steady, *self.branches, *self.coupling):
            found.setdefault(run.content_sha256, (label, run))
        return tuple(found.values())
