"""Structure: which stages an actuator has, read off the names of its parameters.

A stage that an actuator's file does not name is not there. Everything else, from simulation to the fit,
asks the structure for declarations, blocks and laws, and never for a stage.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from types import MappingProxyType

from ipmclab.errors import InputError
from ipmclab.model import geometry
from ipmclab.model.blocks import Block, Law, standing_in
from ipmclab.model.environment import hydration
from ipmclab.model.environment.laws import branches_with_law, law_declarations, laws_in
from ipmclab.model.kinds import edition, further_kinds
from ipmclab.model.parameters import Declaration, Values
from ipmclab.model.stages.beam import Beam
from ipmclab.model.stages.circuit import Circuit
from ipmclab.model.stages.coupling import Coupling
from ipmclab.model.stages.kind import Stage, StageKind, number_of
from ipmclab.model.stages.laser import Laser
from ipmclab.model.stages.leak import FORMS, Leak
from ipmclab.model.stages.line import Line
from ipmclab.model.stages.relaxation import Relaxation


@dataclass(frozen=True)
class Structure:
    """Which stages there are, and how many branches and modes each has.

    Parameters
    ----------
    branches : int
        RC branches, at least 1.
    leak : str
        Form of the nonlinear leak, one of ``leak.FORMS``; empty where there is none.
    slow_leak : bool
        Whether the leak current has a slow part.
    clamp : bool
        Whether the clamped section is fed directly.
    line : "modes", "segments" or ""
        How the electrode is distributed; empty where it is lumped.
    displacement_modes, force_modes : int
        Slow modes of each drive.
    viscoelastic : int
        Modes of the modulus.
    laser : bool
        Whether the displacement is what a laser at a fixed place reads, with large bending.
    displacement_pairs, force_pairs : int
        Slow modes of each drive that come in pairs, whose poles may meet or be complex.
    load : bool
        Whether a spring holds the strip at the sensing point.
    further : tuple of pair of StageKind and int
        Stages that were registered, and how many of each.
    hydration : bool
        Whether it is known how the strip takes up water.
    coating : bool
        Whether a coating holds the water back.
    environment : tuple of str
        The laws by which parameters follow the environment, as their names begin.
    """

    branches: int
    leak: str = ""
    slow_leak: bool = False
    clamp: bool = False
    line: str = ""
    displacement_modes: int = 0
    force_modes: int = 0
    viscoelastic: int = 0
    laser: bool = False
    displacement_pairs: int = 0
    force_pairs: int = 0
    load: bool = False
    further: tuple[tuple[StageKind, int], ...] = ()
    hydration: bool = False
    coating: bool = False
    environment: tuple[str, ...] = ()

    @classmethod
    def of(cls, names: Iterable[str]) -> Structure:
        """The structure that these parameter names speak of.

        Raises
        ------
        InputError
            Names of two forms of one stage, or of a slow leak without the leak that it follows.

        Examples
        --------
        >>> Structure.of(["circuit.branches.0.resistivity", "leak.cubic.cubic"])
        Structure(branches=1, leak='cubic', ...)
        """
        return _of(tuple(names), edition())

    @property
    def declarations(self) -> Mapping[str, Declaration]:
        """Every parameter by name, in the order of a file."""
        return _declarations(self)

    @property
    def electrical(self) -> Circuit | Line:
        """The stage from the voltage to the current and to what is behind the electrodes."""
        if self.line:
            return Line(self.branches, kind=self.line, leak=bool(self.leak), clamp=self.clamp)
        return Circuit(self.branches, leak=bool(self.leak), clamp=self.clamp)

    @property
    def stages(self) -> tuple[Circuit | Line | Leak | Laser | Stage, ...]:
        """The stages in the order of the cascade."""
        return _stages(self)

    def blocks(self, values: Values) -> tuple[Block, ...]:
        """The linear blocks of all stages for a parameter vector, in the order of the cascade."""
        law_ports = self.law_ports(values)
        found: list[Block] = []
        for stage in self.stages:
            if isinstance(stage, Leak):
                found += stage.blocks(values, law_ports)
            elif not isinstance(stage, Laser):
                found.append(stage.block(values))
        return standing_in(found)

    def drive_blocks(self, values: Values, drive: str) -> tuple[Block, ...]:
        """The blocks that make a drive of the node voltage, in the order of the cascade.

        Parameters
        ----------
        values : mapping of dotted name to number [SI]
        drive : "displacement" or "force"
        """
        wanted, found = {f"{drive}_drive"}, []
        for block in reversed(self.blocks(values)):
            rows = [row for row, port in enumerate(block.outputs) if port in wanted]
            if rows:
                found.append(block.giving(rows))
                wanted |= set(found[-1].inputs) - {"node_voltage"}
        return tuple(reversed(found))

    @property
    def is_lumped(self) -> bool:
        """Whether the current is that of the linear lumped circuit, of which poles and residues are all there is."""
        return not (self.leak or self.clamp or self.line or any(kind.electrical for kind, _ in self.further))

    @property
    def is_linear(self) -> bool:
        """Whether outputs are linear in the voltage and in the state at the start."""
        return not (self.leak or self.laser)

    @property
    def takes_arrays(self) -> bool:
        """Whether its stages compute with arrays, one value for each of many parameter sets, as with numbers."""
        return not (self.clamp or self.line or self.further)

    def law_ports(self, values: Values) -> tuple[tuple[str, str, complex], ...]:
        """Where a leak sits: port of the voltage, port of the current, and the area [m^2] that leaks there."""
        return self.electrical.law_ports(values) if self.leak else ()

    def laws(self, values: Values) -> tuple[Law, ...]:
        """The static laws at ports, empty for a linear actuator."""
        if not self.leak:
            return ()
        return Leak(self.leak, slow=self.slow_leak).laws(values, self.law_ports(values))


@lru_cache(maxsize=256)
def _of(names: tuple[str, ...], _edition: int) -> Structure:
    """Kept, because an actuator asks at every change of a value."""
    given = set(names)
    forms = refuse_two_forms("leak", [form for form in FORMS if _under(given, f"leak.{form}.")])
    line = refuse_two_forms("line", [kind for kind in ("modes", "segments") if f"line.{kind}" in given])
    leaks = {name for name in given if name.startswith("leak.")}
    if leaks and not forms and all(name.startswith("leak.slow.") for name in leaks):
        raise InputError(
            "a slow leak follows a static one, and there is none",
            code="no-form",
            where="leak.slow",
            repair=f"add one of {', '.join(f'leak.{form}' for form in FORMS)}",
        )
    if _under(given, "load.") and _under(given, "laser."):
        raise InputError(
            "a laser's reading is that of a strip that bends as an arc, and a load bends it otherwise",
            code="load-and-laser",
            where="load.stiffness",
            repair="keep one of load and laser",
        )
    laws = laws_in(given)
    return Structure(
        branches=max(1, number_of(given, "circuit.branches."), branches_with_law(given)),
        leak=forms or (FORMS[0] if leaks else ""),
        slow_leak=_under(given, "leak.slow."),
        clamp=_under(given, "clamp."),
        line=line or ("segments" if _under(given, "line.") else ""),
        displacement_modes=number_of(given, "relaxation.displacement."),
        force_modes=number_of(given, "relaxation.force."),
        viscoelastic=number_of(given, "viscoelastic."),
        laser=_under(given, "laser."),
        displacement_pairs=number_of(given, "relaxation.displacement_pair."),
        force_pairs=number_of(given, "relaxation.force_pair."),
        load=_under(given, "load."),
        hydration=_under(given, "hydration.") or bool(laws),
        coating=_under(given, "hydration.coating."),
        environment=laws,
        further=tuple(
            (kind, number_of(given, kind.prefix) if kind.counted else 1)
            for kind in further_kinds()
            if _under(given, kind.prefix)
        ),
    )


@cache
def _stages(structure: Structure) -> tuple[Circuit | Line | Leak | Laser | Stage, ...]:
    found: list[Circuit | Line | Leak | Laser | Stage] = [structure.electrical]
    if structure.leak:
        found.append(Leak(structure.leak, slow=structure.slow_leak))
    slow = [
        Relaxation("displacement", structure.displacement_modes, structure.displacement_pairs),
        Relaxation("force", structure.force_modes, structure.force_pairs),
    ]
    relaxing = [one for one in slow if one.modes or one.pairs]
    found.append(Coupling(displacement_fast=slow[0] in relaxing, force_fast=slow[1] in relaxing))
    found += relaxing
    found += [kind.build(count) for kind, count in structure.further if kind.build is not None]
    found.append(Beam(structure.viscoelastic, structure.load))
    if structure.laser:
        found.append(Laser())
    return tuple(found)


@cache
def _declarations(structure: Structure) -> Mapping[str, Declaration]:
    every = [*geometry.DECLARATIONS, *(d for stage in structure.stages for d in stage.declarations)]
    every += [*(hydration.DECLARATIONS if structure.hydration else ())]
    every += [*(hydration.COATING if structure.coating else ())]
    every += law_declarations(structure.environment, structure.branches)
    return MappingProxyType({declaration.name: declaration for declaration in every})


def _under(names: set[str], prefix: str) -> bool:
    return any(name.startswith(prefix) for name in names)


def refuse_two_forms(stage: str, found: Sequence[str], *, where: str = "") -> str:
    """The one form of a stage that is named, empty where none is.

    Raises
    ------
    InputError
        There are more.

    Examples
    --------
    >>> refuse_two_forms("leak", ["cubic"])
    'cubic'
    """
    if len(found) > 1:
        raise InputError(
            f"there are {' and '.join(f'{stage}.{one}' for one in found)}, a strip has one of them",
            code="two-forms",
            where=where or stage,
            repair=f"keep one of {', '.join(f'{stage}.{one}' for one in found)}",
        )
    return found[0] if found else ""
