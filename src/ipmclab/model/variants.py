"""Variants: the same strip with further stages, named in a line (``friend-2+leak.cubic+relaxation.displacement=2``)."""

from __future__ import annotations

import re
from typing import Final

from ipmclab.errors import InputError, suggest
from ipmclab.model.actuator import Actuator
from ipmclab.model.structure import Structure

_COUNTED: Final = {
    "branches": "circuit.branches.",
    "relaxation.displacement": "relaxation.displacement.",
    "relaxation.displacement_pair": "relaxation.displacement_pair.",
    "relaxation.force": "relaxation.force.",
    "relaxation.force_pair": "relaxation.force_pair.",
    "viscoelastic": "viscoelastic.",
}
_NUMBERED: Final = ("line.modes", "line.segments")
_PLAIN: Final = (*("leak.cubic", "leak.exponential", "leak.butler_volmer", "leak.slow", "clamp", "laser"),)
STAGES: Final = (*_COUNTED, *_NUMBERED, *_PLAIN)
"""What may follow a plus."""


def with_stages(actuator: Actuator, *stages: str) -> Actuator:
    """The actuator with further stages, at usual values of their parameters.

    Parameters
    ----------
    actuator : Actuator
    *stages : str
        ``leak.cubic``, ``leak.exponential``, ``leak.butler_volmer``, ``leak.slow``, ``clamp``, ``laser``; with a count
        ``branches=3``, ``relaxation.displacement=2``, ``relaxation.force``,
        ``relaxation.displacement_pair``, ``relaxation.force_pair``, ``viscoelastic``, ``line.modes=12``,
        ``line.segments=10``. A stage that is there keeps its values; a count that is smaller takes some away.

    Raises
    ------
    InputError
        An unknown stage, or a count that is no whole number from 1 up.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> richer = with_stages(load_actuator("friend-2"), "leak.exponential", "relaxation.displacement")
    >>> richer["leak.exponential.threshold"]
    1.23
    >>> richer.name
    'friend-2+leak.exponential+relaxation.displacement'
    """
    names = set(actuator.parameter_values)
    values = dict(actuator.parameter_values)
    for text in stages:
        stage, count = _parse(text)
        if stage in _COUNTED:
            names = _counted(names, _COUNTED[stage], count or 1)
        elif stage in _NUMBERED:
            names = {name for name in names if not name.startswith("line.")} | {stage}
            if count is not None:
                values[stage] = float(count)
        elif stage == "leak.slow":
            names.add("leak.slow.growth")
        elif stage.startswith("leak."):
            slow = {name for name in names if name.startswith("leak.slow.")}
            names = {name for name in names if not name.startswith("leak.") or name.startswith(f"{stage}.")} | slow
            names.add(f"{stage}.current_density" if stage != "leak.cubic" else "leak.cubic.cubic")
        else:
            names.add(f"{stage}.")
    declarations = Structure.of(names).declarations
    chosen = {}
    for name, declaration in declarations.items():
        usual = declaration.typical if declaration.typical is not None else declaration.default
        chosen[name] = values.get(name, usual)
    return Actuator(
        name="+".join([actuator.name, *(text.strip() for text in stages)]),
        parameter_values={name: value for name, value in chosen.items() if value is not None},
        standard_uncertainties={n: u for n, u in actuator.standard_uncertainties.items() if n in chosen},
        sample=actuator.sample,
    )


def _counted(names: set[str], prefix: str, count: int) -> set[str]:
    kept = {n for n in names if not n.startswith(prefix) or int(n.removeprefix(prefix).split(".")[0]) < count}
    return kept | {f"{prefix}{i}." for i in range(count)}


def _parse(text: str) -> tuple[str, int | None]:
    match = re.fullmatch(r"\s*([\w.]+)\s*(?:=\s*(\d{1,3})\s*)?", text)
    stage = match.group(1) if match else text.strip()
    if match is None or stage not in STAGES:
        raise InputError(
            f"no stage is called {text.strip()!r}", code="unknown-stage", where="stages", repair=suggest(stage, STAGES)
        )
    if match.group(2) is None:
        return stage, None
    if stage in _PLAIN or int(match.group(2)) < 1:
        raise InputError(
            f"{text.strip()!r} cannot have this count",
            code="bad-count",
            where="stages",
            repair=f"give {stage!r} alone" if stage in _PLAIN else f"give {stage}=1 or more",
        )
    return stage, int(match.group(2))
