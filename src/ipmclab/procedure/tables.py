"""The tables of a procedure file as they are there."""

from __future__ import annotations

from typing import Any, Literal

from ipmclab.store.strict import Strict


class GeometryTable(Strict):
    """``[geometry]``."""

    free_length: Any
    clamped_length: Any
    width: Any
    thickness: Any
    sensing_length: Any


class CircuitTable(Strict):
    """``[circuit]``."""

    contact_resistance: Any = None


class SheetTable(Strict):
    """``[sheet_resistance]``."""

    contacts: Literal["line", "points"] = "line"
    spacing: Any = None
    outer_spacing: Any = None
    resistance: Any = None
    offset: str = "0.05 ohm"
    zero: Any = None
    value: Any = None


class DcTable(Strict):
    """``[dc_resistance]``."""

    runs: list[str] | None = None
    value: Any = None


class BranchesTable(Strict):
    """``[branches]``."""

    runs: list[str]
    count: int = 2


class DensityTable(Strict):
    """``[density]``."""

    mass: Any = None
    value: Any = None


class ModulusTable(Strict):
    """``[modulus]``."""

    displacement: list[str] | None = None
    force: list[str] | None = None
    run: str | None = None
    position: Any = None
    calibration: float | None = None
    value: Any = None


class CouplingTable(Strict):
    """``[coupling]``."""

    runs: list[str]


class ProcedureTable(Strict):
    """The whole file."""

    name: str
    sample: dict[str, Any] | None = None
    geometry: GeometryTable
    circuit: CircuitTable | None = None
    sheet_resistance: SheetTable | None = None
    dc_resistance: DcTable | None = None
    branches: BranchesTable | None = None
    density: DensityTable | None = None
    modulus: ModulusTable | None = None
    coupling: CouplingTable | None = None
