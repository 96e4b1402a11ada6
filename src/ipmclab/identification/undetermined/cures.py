"""What would cure a combination of parameters that readings leave open: another measurement, or another output."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.uncertainty.covariance import MOVED
from ipmclab.model import Actuator
from ipmclab.model.declared import MOTION, declaration_of, in_group, measurements
from ipmclab.model.kinds import kind_of
from ipmclab.run import FloatArray

_OVER: Final = 0.1  # of a record, within which a mode is over: more time shows nothing more of it


@dataclass(frozen=True)
class Cure:
    """One measurement that would determine a combination.

    Parameters
    ----------
    name : str
        ``measure`` and a parameter, ``record`` and an output, or ``raise voltage``.
    sentence : str
    """

    name: str
    sentence: str


def cures_of(names: Sequence[str], row: FloatArray, outputs: Sequence[str]) -> tuple[Cure, ...]:
    """Measurements of which each alone would determine a combination.

    Parameters
    ----------
    names : sequence of str
    row : float array, shape (n_names,)
        Relative change of each parameter along the combination.
    outputs : sequence of str
        Outputs that would show it, everything else being as free as it is.
    """
    moved = {name.split("[")[0] for name, part in zip(names, row, strict=True) if abs(part) > MOVED}
    found = [Cure(f"measure {name}", sentence) for name, sentence in measurements() if name in moved]
    leans = not (in_group(MOTION, names) or all(name.startswith("observation.") for name in moved))
    known = " with a known coupling" if leans else ""
    for output in outputs:
        said = f"add a {output} run" if output == outputs[0] else f"a {output} run"
        found.append(Cure(f"record {output}", said + (known if output == outputs[-1] else "")))
    of = {None if (kind := kind_of(name)) is None else kind.cure for name in moved}
    if not found and len(of) == 1 and (cure := of.pop()) and any(cure):
        found.append(Cure(*cure))
    return tuple(found)


def measured(name: str) -> str:
    """How a parameter is measured on its own, in words; empty where nobody does."""
    declared = declaration_of(name)
    return declared.measured.how if declared is not None and declared.measured is not None else ""


def said_of(cures: Sequence[Cure], moved: Sequence[str]) -> str:
    """The cures of a combination in words; ``moved`` are its parameters, the most important first."""
    if not cures:
        listed = ", ".join(moved)
        return f"fix {listed if len(moved) == 1 else f'one of {listed}'} at a known value"
    *most, last = [cure.sentence for cure in cures]
    return f"{', '.join(most)} or {last}" if most else last


def fast_modes(actuator: Actuator, records: Sequence[PreparedRun]) -> frozenset[str]:
    """The parameters of modes that are over long before the longest record is."""
    longest = max((float(one.run.time[-1] - one.run.time[0]) for one in records), default=0.0)
    values = actuator.parameter_values
    return frozenset(
        name
        for name in values
        if (kind := kind_of(name)) is not None
        and kind.speed is not None
        and kind.speed(values, kind.one(name).removesuffix(".")) < _OVER * longest
    )
