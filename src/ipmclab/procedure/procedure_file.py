"""Procedure files: TOML, one table a step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from ipmclab.errors import InputError, missing_key
from ipmclab.kinds import tell_kinds
from ipmclab.measurement.push import USUAL_SCALES, Push
from ipmclab.measurement.uncertain import Uncertain, exact
from ipmclab.measurement.written import REPAIR, Written
from ipmclab.model import geometry
from ipmclab.procedure.four_probe import FourProbes
from ipmclab.procedure.hand import read_hand
from ipmclab.procedure.procedure import Procedure, Runs
from ipmclab.procedure.strip import GEOMETRY
from ipmclab.procedure.tables import DcTable, ModulusTable, ProcedureTable, SheetTable
from ipmclab.quality.check import check
from ipmclab.quality.usable import unmasked
from ipmclab.run import Run
from ipmclab.sample import Sample
from ipmclab.toml_file import parse_table, read_text
from ipmclab.units import (
    DENSITY,
    DISPLACEMENT,
    FORCE,
    LENGTH,
    MASS,
    MODULUS,
    RESISTANCE,
    SHEET_RESISTANCE,
    Quantity,
    parse_quantity,
)

_GIVEN: Final = "value that was given"
_MOST_BRANCHES: Final = 5  # no record distinguishes more (convention; the thesis has 2)

T = TypeVar("T")


@tell_kinds
def read_procedure(path: str | Path) -> Procedure:
    """Read a procedure and the runs that it names, which are in the same folder unless their path says otherwise.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    procedure : Procedure

    Raises
    ------
    InputError
        No such file, no TOML, an unknown key, a wrong unit, a number that cannot be, a run that cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> from ipmclab.procedure.template import TEMPLATE
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "mine.toml"
    ...     _ = path.write_text(TEMPLATE, encoding="utf-8")
    ...     read_procedure(path).geometry["geometry.width"].value
    0.005
    """
    path = Path(path)
    missing = InputError(
        "there is no such file",
        code="no-procedure",
        where=str(path),
        repair="write one to fill in: ipmclab procedure --template --out mine.toml",
    )
    return procedure_from_text(
        read_text(path, kind="a procedure", missing=missing), where=str(path), folder=path.parent
    )


def procedure_from_text(text: str, *, where: str = "procedure", folder: Path | None = None) -> Procedure:
    """Read a procedure from the text of its file.

    Parameters
    ----------
    text : str
    where : str
        What the messages name: the file.
    folder : Path, optional
        Where the paths of its runs start.

    Raises
    ------
    InputError
    """
    from ipmclab.procedure.tables import ProcedureTable
    from ipmclab.store.strict import validated

    repair = "compare with the template: ipmclab procedure --template"
    document = parse_table(text, where=where, repair=repair)
    table = validated(ProcedureTable, document, where=where)
    reader = _Reader(where, folder or Path())
    return replace(_procedure(table, reader), files=reader.files)


class _Reader:
    """Reads what is at a key of one file."""

    def __init__(self, where: str, folder: Path) -> None:
        self.where = where
        self._folder = folder
        self._runs: dict[Path, Run] = {}

    @property
    def files(self) -> tuple[Path, ...]:
        return tuple(self._runs)

    def at(self, key: str) -> str:
        return f"{self.where}: {key}"

    def hand(self, raw: Any, quantity: Quantity, key: str, *, name: str, source: str, assume: bool = True) -> Uncertain:
        positive = name != "geometry.clamped_length"
        return read_hand(raw, quantity, name=name, source=source, where=self.at(key), positive=positive, assume=assume)

    def runs(self, paths: list[str], key: str) -> Runs:
        if not paths:
            raise InputError(
                "no runs are named", code="no-runs", where=self.at(key), repair="name them, or leave the table out"
            )
        return tuple((self._label(path, paths), self.run(path, f"{key}[{place}]")) for place, path in enumerate(paths))

    @staticmethod
    def _label(path: str, paths: list[str]) -> str:
        """The name of a file; its whole path where another one is called so: the noise of each is its own."""
        alike = [one for one in paths if Path(one).name == Path(path).name]
        return Path(path).name if len(alike) == 1 else Path(path).as_posix()

    def run(self, name: str, key: str) -> Run:
        from ipmclab.store.run_file import read_run

        path = self._folder / name
        if path not in self._runs:
            if not path.is_file():
                raise InputError(
                    f"there is no file {name!r}" + (f" in {self._folder}" if str(self._folder) != "." else ""),
                    code="no-run",
                    where=self.at(key),
                    repair="write its path from the folder of this file; what is not recorded yet is left out",
                )
            self._runs[path] = read_run(path)
        return self._runs[path]


def _procedure(table: ProcedureTable, reader: _Reader) -> Procedure:
    lengths = {
        f"geometry.{key}": reader.hand(
            getattr(table.geometry, key),
            LENGTH,
            f"geometry.{key}",
            name=f"geometry.{key}",
            source=key.replace("_", " "),
        )
        for key in GEOMETRY
    }
    _check_lengths(lengths, reader)
    sheet, dc, density, modulus = table.sheet_resistance, table.dc_resistance, table.density, table.modulus
    contact = table.circuit.contact_resistance if table.circuit else None
    return Procedure(
        name=table.name,
        geometry=lengths,
        sample=None if table.sample is None else Sample.from_table(table.sample, where=reader.at("sample")),
        contact_resistance=exact(0.0)
        if contact is None
        else _contact(contact, reader.at("circuit.contact_resistance")),
        sheet_resistance=None if sheet is None else _sheet(sheet, reader),
        dc_resistance=None if dc is None else _dc(dc, reader),
        branches=() if table.branches is None else reader.runs(table.branches.runs, "branches.runs"),
        branch_count=2 if table.branches is None else _count(table.branches.count, reader),
        mass=None
        if density is None or density.mass is None
        else reader.hand(density.mass, MASS, "density.mass", name="mass", source="mass"),
        density=None
        if density is None
        else _either(
            density.value,
            density.mass,
            "density",
            reader,
            lambda: reader.hand(
                density.value, DENSITY, "density.value", name="beam.density", source=f"{_GIVEN} for the density"
            ),
            lambda: None,
            "mass",
        ),
        modulus=None if modulus is None else _modulus(modulus, reader),
        push_position=None
        if modulus is None or modulus.position is None
        else _position(modulus.position, lengths["geometry.free_length"], reader),
        coupling=() if table.coupling is None else reader.runs(table.coupling.runs, "coupling.runs"),
    )


def _check_lengths(lengths: Mapping[str, Uncertain], reader: _Reader) -> None:
    """Refuse dimensions that no strip has, and name the reading that makes them so."""
    try:
        for declaration in geometry.DECLARATIONS:
            declaration.check(lengths[declaration.name].value, where=reader.at(declaration.name))
        geometry.check({name: one.value for name, one in lengths.items()}, where=f"{reader.where}: ")
    except InputError as error:
        for length in lengths.values():
            for source, written in length.written.items():
                if (slip := written.slip()) is not None:
                    text = f"{error.message}; of the readings of the {source} {slip[1]}"
                    raise InputError(text, code=error.code, where=slip[0], repair=REPAIR) from error
        raise


def _either(
    value: Any, other: Any, key: str, reader: _Reader, of_value: Callable[[], T], of_other: Callable[[], T], named: str
) -> T:
    if (value is None) == (other is None):
        raise InputError(
            f"it needs either {named} or a value from elsewhere" + (", not both" if value is not None else ""),
            code="missing-key",
            where=reader.at(key),
            repair=f"write one of `{named}` and `value`",
        )
    return of_value() if value is not None else of_other()


def _contact(raw: Any, where: str) -> Uncertain:
    found = read_hand(
        raw, RESISTANCE, name="circuit.contact_resistance", source="contact resistance", where=where, positive=False
    )
    if found.value < 0.0 or (found.value == 0.0 and found.parts):
        raise InputError(
            f"a contact resistance of {found.said('ohm')} cannot be",
            code="out-of-range",
            where=where,
            repair="give the middle of what it may be, and how far it may lie from there",
        )
    return found


def _dc(table: DcTable, reader: _Reader) -> Runs | Uncertain:
    def of_value() -> Runs | Uncertain:
        source = f"{_GIVEN} for R_dc"
        return reader.hand(table.value, RESISTANCE, "dc_resistance.value", name="dc", source=source)

    def of_runs() -> Runs | Uncertain:
        return reader.runs(table.runs or [], "dc_resistance.runs")

    return _either(table.value, table.runs, "dc_resistance", reader, of_value, of_runs, "runs")


def _count(count: int, reader: _Reader) -> int:
    if not 1 <= count <= _MOST_BRANCHES:
        raise InputError(
            f"{count} branches",
            code="out-of-range",
            where=reader.at("branches.count"),
            repair=f"give 1 to {_MOST_BRANCHES}; the thesis has 2",
        )
    return count


def _sheet(table: SheetTable, reader: _Reader) -> FourProbes | Uncertain:
    def of_value() -> FourProbes | Uncertain:
        return reader.hand(
            table.value,
            SHEET_RESISTANCE,
            "sheet_resistance.value",
            name="circuit.sheet_resistance",
            source=f"{_GIVEN} for the sheet resistance",
        )

    def of_readings() -> FourProbes | Uncertain:
        if table.spacing is None:
            raise missing_key(
                reader.at("sheet_resistance.spacing"), 'add spacing = "10 mm", from one inner contact to the other'
            )
        zero = None
        if table.zero is not None:
            zero = read_hand(
                table.zero,
                RESISTANCE,
                name="zero",
                source="zero of the meter",
                where=reader.at("sheet_resistance.zero"),
                positive=False,
                assume=False,
            )
        offset = parse_quantity(table.offset, RESISTANCE, where=reader.at("sheet_resistance.offset"))
        if offset < 0:
            raise InputError(
                f"{table.offset!r} is below 0",
                code="out-of-range",
                where=reader.at("sheet_resistance.offset"),
                repair="give by how much the meter may read wrong, to either side",
            )
        return FourProbes(
            table.contacts,
            reader.hand(
                table.resistance,
                RESISTANCE,
                "sheet_resistance.resistance",
                name="resistance",
                source="meter",
                # The offset of the meter is counted separately: nothing is assumed in addition to the scatter.
                assume=False,
            ),
            reader.hand(table.spacing, LENGTH, "sheet_resistance.spacing", name="spacing", source="spacing"),
            offset,
            zero,
            None
            if table.outer_spacing is None
            else reader.hand(
                table.outer_spacing, LENGTH, "sheet_resistance.outer_spacing", name="spacing", source="outer spacing"
            ),
        )

    return _either(table.value, table.resistance, "sheet_resistance", reader, of_value, of_readings, "resistance")


def _position(raw: Any, free: Uncertain, reader: _Reader) -> Uncertain:
    found = reader.hand(raw, LENGTH, "modulus.position", name="position", source="position")
    if found.value > free.value:
        raise InputError(
            f"the push, at {1e3 * found.value:g} mm, is beyond the free length {1e3 * free.value:g} mm",
            code="out-of-range",
            where=reader.at("modulus.position"),
            repair="measure it from the edge of the clamp to where the load cell pushes",
        )
    return found


def _modulus(table: ModulusTable, reader: _Reader) -> Push | Uncertain:
    given = [one is not None for one in (table.value, table.run, table.displacement or table.force)]
    if sum(given) != 1:
        raise InputError(
            "it needs one of a push, a run, or a value from elsewhere",
            code="missing-key",
            where=reader.at("modulus"),
            repair='write displacement = ["0 mm", ...] and force = ["0 mN", ...], run = "push.nc", or value = "1 GPa"',
        )
    if table.value is not None:
        return reader.hand(
            table.value, MODULUS, "modulus.value", name="beam.modulus", source=f"{_GIVEN} for the modulus"
        )
    assumed = table.calibration is None
    scales = USUAL_SCALES if table.calibration is None else table.calibration
    if not 0.0 <= scales < 1.0:
        raise InputError(
            f"{scales:g} is not a part from 0 to 1",
            code="out-of-range",
            where=reader.at("modulus.calibration"),
            repair="give 0.01 for 1 %",
        )
    if table.run is not None:
        run = reader.run(table.run, "modulus.run")
        if run.displacement is None or run.force is None:
            raise InputError(
                "a push needs displacement and force in one run",
                code="missing-channel",
                where=reader.at("modulus.run"),
                repair="import them together, or write both as lists",
            )
        good = unmasked(run, check(run))
        both = good["displacement"] & good["force"]
        return Push(run.displacement[both], run.force[both], scales, assumed=assumed)
    columns: list[Written] = []
    for key, texts, quantity in (("displacement", table.displacement, DISPLACEMENT), ("force", table.force, FORCE)):
        if texts is None:
            raise missing_key(reader.at(f"modulus.{key}"), f'add {key} = ["0 {quantity.display_unit}", ...]')
        where = reader.at(f"modulus.{key}")
        values = [parse_quantity(text, quantity, where=f"{where}[{place}]") for place, text in enumerate(texts)]
        columns.append(Written(where, tuple(texts), tuple(values)))
    displacement, force = columns
    if len(displacement.values) != len(force.values):
        raise InputError(
            f"{len(displacement.values)} displacements and {len(force.values)} forces",
            code="unequal-lengths",
            where=reader.at("modulus"),
            repair="give one force for each displacement, in the order in which they were read",
        )
    return Push(np.array(displacement.values), np.array(force.values), scales, (displacement, force), assumed)
