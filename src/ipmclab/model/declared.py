"""What the stages say of their parameters: by name, without an actuator that has them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Final

from ipmclab.model.kinds import edition, kind_of, kinds
from ipmclab.model.parameters import Declaration
from ipmclab.model.stages import circuit, coupling
from ipmclab.model.stages.kind import StageKind
from ipmclab.model.structure import Structure

ELECTRICAL: Final = circuit.KIND.group
"""The group of the circuit."""

MOTION: Final = coupling.KIND.group
"""The group of what makes motion of the voltage behind the electrodes."""


def declaration_of(name: str) -> Declaration | None:
    """What a parameter's stage says of it; None for what is no stage's.

    Examples
    --------
    >>> declaration_of("circuit.branches.3.resistivity[0]").symbol, declaration_of("observation.delay")
    ('ρ_4', None)
    """
    return _declaration_of(name.partition("[")[0], edition())


def outputs_of(name: str) -> tuple[str, ...]:
    """Readings of which any shows a parameter.

    Examples
    --------
    >>> outputs_of("beam.modulus"), outputs_of("beam.density")
    (('displacement', 'force'), ('displacement',))
    """
    declared = declaration_of(name)
    return (declared.outputs if declared is not None else ()) or stage_outputs(name)


def stage_outputs(name: str) -> tuple[str, ...]:
    """Readings of which any shows the stage that a parameter belongs to."""
    kind = kind_of(name)
    return () if kind is None else kind.outputs


def group_of(name: str) -> str:
    """The group that frees a parameter; empty for one that is freed by its own name alone.

    Examples
    --------
    >>> group_of("circuit.branches.0.resistivity"), group_of("circuit.sheet_resistance")
    ('electrical', '')
    """
    kind, declared = kind_of(name), declaration_of(name)
    if kind is None or (declared is not None and not declared.in_group):
        return ""
    return kind.group


def in_group(group: str, names: Iterable[str]) -> list[str]:
    """Those of some parameters that a group frees.

    Examples
    --------
    >>> in_group("electrical", ["circuit.sheet_resistance", "circuit.dc_resistivity", "coupling.gain"])
    ['circuit.dc_resistivity']
    """
    return [name for name in names if group_of(name) == group]


def electrical(name: str) -> bool:
    """Whether a parameter changes the current, and with it all that is read."""
    kind = kind_of(name)
    return kind is not None and kind.electrical


def is_of_circuit(name: str) -> bool:
    """Whether a parameter is one of the electrodes, their contacts and the branches behind them."""
    kind = kind_of(name)
    return kind is not None and kind.group == ELECTRICAL


def is_of_leak(name: str) -> bool:
    """Whether a parameter belongs to a leak, its slow part included.

    Examples
    --------
    >>> is_of_leak("leak.slow.growth"), is_of_leak("circuit.dc_resistivity")
    (True, False)
    """
    return name.startswith("leak.")


def has_several_minima(name: str) -> bool:
    """Whether a fit of a parameter has several, of which noise can make the wrong one the first."""
    kind = kind_of(name)
    return kind is not None and kind.several_minima


def is_curved(name: str) -> bool:
    """Whether the likelihood is not that of a linear problem even where the parameter is moved on a linear scale."""
    kind = kind_of(name)
    return kind is not None and kind.curved


def is_proportional(name: str) -> bool:
    """Whether outputs of a run from rest are linear in a parameter and all others of its kind, whatever the rest is."""
    return largest_proportional(name) is not None


def largest_proportional(name: str) -> float | None:
    """How large a parameter is at most that outputs of a run from rest are linear in; None for any other.

    Examples
    --------
    >>> largest_proportional("relaxation.force.0.ratio"), largest_proportional("relaxation.force.0.time_constant")
    (1000.0, None)
    """
    kind = kind_of(name)
    return None if kind is None else kind.proportional.get(kind.ending(name))


def is_held(name: str) -> bool:
    """Whether a first look at a stage leaves a parameter at its usual value."""
    kind, declared = kind_of(name), declaration_of(name)
    counted = declared is not None and declared.transform == "count"
    return counted or (kind is not None and kind.ending(name) in kind.held)


def has_shape(name: str) -> bool:
    """Whether the stage of a parameter has others than its size, which mean nothing where there is none of it.

    Examples
    --------
    >>> has_shape("relaxation.force.0.ratio"), has_shape("clamp.direct_share")
    (True, False)
    """
    kind = kind_of(name)
    return kind is not None and any(kind.ending(other) not in kind.off for other in _declared(kind))


def measurements() -> Iterator[tuple[str, str]]:
    """Parameters that an experiment without the model gives, the quickest first, and how."""
    declared = (one for kind in kinds() for one in _declared(kind).values() if one.measured is not None)
    for one in sorted(declared, key=lambda one: one.measured.place if one.measured is not None else 0):
        assert one.measured is not None
        yield one.name, one.measured.how


@lru_cache(maxsize=4096)
def _declaration_of(name: str, _edition: int) -> Declaration | None:
    kind = kind_of(name)
    if kind is None:
        return None
    number = kind.one(name).removeprefix(kind.prefix).rstrip(".")
    return _declared(kind, int(number) + 1 if number.isdecimal() else 1).get(name)


def _declared(kind: StageKind, count: int = 1) -> dict[str, Declaration]:
    """The parameters of a stage, of which there are so many."""
    names = [f"{kind.prefix}{place}." for place in range(count)] if kind.counted else [kind.prefix]
    names += [other.prefix for other in kinds() if kind.follows and other.one_of == kind.follows][:1]
    found = Structure.of(names).declarations
    return {name: declaration for name, declaration in found.items() if kind_of(name) is kind}
