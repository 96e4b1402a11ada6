"""Variants: the same strip with further stages, named in a line (``friend-2+leak.cubic+relaxation.displacement=2``)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ipmclab.errors import InputError, suggest
from ipmclab.model.actuator import Actuator
from ipmclab.model.kinds import kind_named, optional_kinds
from ipmclab.model.stages.kind import StageKind
from ipmclab.model.structure import Structure, refuse_two_forms

_MOST: Final = 99
"""Branches or modes of one kind; the counts of a line have their own range."""


def stage_names() -> tuple[str, ...]:
    """What may follow a plus."""
    return tuple(kind.name for kind in optional_kinds())


def with_stages(actuator: Actuator, *stages: str) -> Actuator:
    """The actuator with further stages, at usual values of their parameters.

    Parameters
    ----------
    actuator : Actuator
    *stages : str
        ``leak.cubic``, ``leak.exponential``, ``leak.butler_volmer``, ``leak.slow``, ``clamp``, ``laser``, ``load``;
        with a count ``branches=3``, ``relaxation.displacement=2``, ``relaxation.force``,
        ``relaxation.displacement_pair``, ``relaxation.force_pair``, ``viscoelastic``, ``line.modes=12``,
        ``line.segments=10``. A stage that is there keeps its values; a count that is smaller takes some away; another
        form of the leak or of the line takes the place of the one that is there.

    Raises
    ------
    InputError
        An unknown stage, a count that is no whole number in its range, two forms or two counts of one stage, or
        ``leak.slow`` where there is no leak.

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
    asked = _parse_all(stages)
    for stage, count in asked.items():
        kind = kind_named(stage)
        if kind.counted:
            names = _counted(names, kind.prefix, count or 1)
            continue
        others = [one.prefix for one in optional_kinds() if one.one_of and one.one_of == kind.one_of and one != kind]
        names = {name for name in names if not name.startswith(tuple(others))} | {kind.prefix}
        if count is not None:
            values[stage] = float(count)
    declarations = Structure.of(names).declarations
    chosen = {name: values.get(name, declaration.usual) for name, declaration in declarations.items()}
    return Actuator(
        name=_named(actuator.name, asked),
        parameter_values={name: value for name, value in chosen.items() if value is not None},
        standard_uncertainties={n: u for n, u in actuator.standard_uncertainties.items() if n in chosen},
        sample=actuator.sample,
        environment_laws=tuple(law for law in actuator.environment_laws if law.parameter in chosen),
        loaded_as=_named(actuator.loaded_as, asked) if actuator.loaded_as else "",
    )


def line_of(actuator: Actuator, *stages: str) -> str:
    """What ``load_actuator`` is given for an actuator with further stages.

    Parameters
    ----------
    actuator : Actuator
    *stages : str
        As in ``with_stages``.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> line_of(load_actuator("friend-2+clamp+relaxation.force"), "relaxation.force=2")
    'friend-2+clamp+relaxation.force=2'
    """
    return _named(actuator.loaded_as or actuator.name, _parse_all(stages))


def _counted(names: set[str], prefix: str, count: int) -> set[str]:
    kept = {n for n in names if not n.startswith(prefix) or int(n.removeprefix(prefix).split(".")[0]) < count}
    return kept | {f"{prefix}{i}." for i in range(count)}


def _named(base: str, asked: dict[str, int | None]) -> str:
    """The name from which the same actuator can be loaded: without what the stages asked for replace."""
    first, *there = base.split("+")
    kept = [part for part in there if not any(_replaces(stage, part.partition("=")[0].strip()) for stage in asked)]
    added = [stage if count is None else f"{stage}={count}" for stage, count in asked.items()]
    return "+".join([first, *kept, *added])


def _replaces(stage: str, there: str) -> bool:
    if stage == there or there not in stage_names():
        return stage == there
    family = kind_named(stage).one_of
    return bool(family) and family == kind_named(there).one_of


def _parse_all(texts: Sequence[str]) -> dict[str, int | None]:
    asked: dict[str, int | None] = {}
    for text in texts:
        stage, count = _parse(text)
        if asked.get(stage, count) != count:
            raise InputError(
                f"{stage!r} is named twice, with different counts",
                code="two-counts",
                where="stages",
                repair="name it once",
            )
        asked[stage] = count
    forms: dict[str, list[str]] = {}
    for kind in optional_kinds():
        if kind.one_of and kind.name in asked:
            forms.setdefault(kind.one_of, []).append(kind.name.partition(".")[2])
    for family, those in forms.items():
        refuse_two_forms(family, those, where="stages")
    return asked


def _parse(text: str) -> tuple[str, int | None]:
    stage, equals, count = (part.strip() for part in text.partition("="))
    if stage not in stage_names():
        raise _unknown(stage, text.strip())
    if not equals:
        return stage, None
    kind = kind_named(stage)
    if not kind.counted and not _is_number(kind):
        raise InputError(
            f"{text.strip()!r} gives {stage!r} a count, it has none",
            code="bad-count",
            where="stages",
            repair=f"give {stage!r} alone; values are set in a file or by replace()",
        )
    least, most = _range(kind)
    if not (count.isascii() and count.isdigit() and len(count) < 9 and least <= int(count) <= most):
        whole = count.removeprefix("-")
        is_whole = whole.isascii() and whole.isdigit()
        raise InputError(
            f"the value {count} is outside the allowed {least} to {most}" if is_whole else f"{count!r} is no count",
            code="bad-count",
            where=stage,
            repair=f"give a whole number from {least} to {most}, such as {stage}={least}",
        )
    return stage, int(count)


def _is_number(kind: StageKind) -> bool:
    """Whether the stage is itself a whole number: how many pieces its one form has."""
    return kind.name in Structure.of([kind.prefix]).declarations


def _range(kind: StageKind) -> tuple[int, int]:
    if kind.counted:
        return 1, _MOST
    declaration = Structure.of([kind.prefix]).declarations[kind.name]
    return int(declaration.lower), int(declaration.upper)


def _unknown(stage: str, text: str) -> InputError:
    """What to do about a name that is no stage: a parameter of one, a stage without its form, or a slip."""
    known = stage_names()
    owner = max((one for one in known if stage.startswith(f"{one}.")), key=len, default=None)
    if owner is not None:
        return InputError(
            f"{text!r} is not a stage but a parameter of one",
            code="unknown-stage",
            where="stages",
            repair=f"name the stage, {owner}; values are set in a file or by replace()",
        )
    forms = [one for one in known if stage and one.startswith(f"{stage}.")]
    return InputError(
        f"{stage!r} alone does not say which" if forms else f"no stage is called {text!r}",
        code="unknown-stage",
        where="stages",
        repair=f"choose one of {', '.join(forms)}" if forms else suggest(stage, known),
    )
