"""The kinds of stages there are: those of this package, and those that are registered from elsewhere.

A stage of your own is one Python file that ends with ``register(...)``. Give it to ``load_stages``, or name it in the
environment variable ``IPMCLAB_STAGES`` (several files apart by the system's path separator): then the command line and
the page know it too.
"""

from __future__ import annotations

import os
import runpy
from functools import cache, lru_cache
from itertools import count
from pathlib import Path
from typing import Final

from ipmclab.errors import InputError
from ipmclab.model import geometry
from ipmclab.model.environment import hydration, laws
from ipmclab.model.stages import beam, circuit, coupling, laser, leak, line, relaxation
from ipmclab.model.stages.kind import StageKind

VARIABLE: Final = "IPMCLAB_STAGES"
"""Environment variable that names files of further stages."""

_OWN: Final = (
    geometry.KIND,
    circuit.KIND,
    *leak.KINDS,
    *line.KINDS,
    circuit.BRANCHES,
    coupling.KIND,
    *relaxation.KINDS,
    beam.KIND,
    beam.VISCOELASTIC,
    circuit.CLAMP,
    laser.KIND,
    beam.LOAD,
    *hydration.KINDS,
    *laws.KINDS,
)
_ALWAYS: Final = (geometry.KIND, circuit.KIND, coupling.KIND, beam.KIND)

_further: Final[dict[str, StageKind]] = {}
_editions: Final = count()
_edition = next(_editions)


def kinds() -> tuple[StageKind, ...]:
    """Every kind; those that were registered come last."""
    _load_named()
    return (*_OWN, *_further.values())


def further_kinds() -> tuple[StageKind, ...]:
    """Those that were registered."""
    _load_named()
    return tuple(_further.values())


def optional_kinds() -> tuple[StageKind, ...]:
    """Those that an actuator may lack, or have several of: what may follow a plus."""
    return tuple(kind for kind in kinds() if kind not in _ALWAYS)


def register(kind: StageKind) -> None:
    """Make a stage known, for as long as the program runs.

    Parameters
    ----------
    kind : StageKind
        With ``build``. One that is registered under the same name takes the place of the earlier one.

    Raises
    ------
    InputError
        It cannot be built, or its name or prefix belongs to another stage.
    """
    if kind.build is None:
        raise _refused(kind, "it says nothing of how it is built", "give the kind build=, which makes the stage")
    for other in (*_OWN, *_further.values()):
        if other.name != kind.name and (other.prefix.startswith(kind.prefix) or kind.prefix.startswith(other.prefix)):
            raise _refused(
                kind,
                f"its parameters begin with {kind.prefix!r}, those of {other.name!r} with {other.prefix!r}",
                "give it another prefix",
            )
    if any(other.name == kind.name for other in _OWN):
        raise _refused(kind, "a stage of that name comes with ipmclab", "give it another name")
    wrong = [one.name for one in kind.build(1).declarations if not one.name.startswith(kind.prefix)]
    if wrong:
        raise _refused(kind, f"its parameter {wrong[0]!r} does not begin with {kind.prefix!r}", "begin all names so")
    _further[kind.name] = kind
    _changed()


def load_stages(path: str | Path) -> None:
    """Run a Python file that registers stages.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    InputError
        There is no such file, or a stage in it is refused.
    """
    _run(path, where="stages")


def unregister(name: str) -> None:
    """Forget a stage that was registered."""
    _further.pop(name, None)
    _changed()


def edition() -> int:
    """Another number after each change of what is registered: what was worked out before holds no longer."""
    _load_named()
    return _edition


def _changed() -> None:
    global _edition  # noqa: PLW0603  # the registry is the program's one
    _edition = next(_editions)


def kind_of(name: str) -> StageKind | None:
    """The kind of stage that a parameter belongs to; None for what is no stage's, such as an offset of a sensor.

    Parameters
    ----------
    name : str
        Dotted name of a parameter, with or without its place.

    Examples
    --------
    >>> kind_of("circuit.branches.0.resistivity").name, kind_of("observation.delay")
    ('branches', None)
    """
    return _kind_of(name, edition())


def kind_named(stage: str) -> StageKind:
    """The kind of a stage as it is named after a plus, with or without a count.

    Examples
    --------
    >>> kind_named("relaxation.force=2").prefix
    'relaxation.force.'
    """
    name = stage.partition("=")[0].strip()
    return next(kind for kind in optional_kinds() if kind.name == name)


def groups() -> tuple[str, ...]:
    """The words that free the parameters of a stage, or of several; first those that every actuator has."""
    return _groups(edition())


@lru_cache(maxsize=4)
def _groups(_edition: int) -> tuple[str, ...]:
    ordered = sorted(kinds(), key=lambda kind: kind not in _ALWAYS)
    return tuple(dict.fromkeys(kind.group for kind in ordered if kind.group))


def stage_groups() -> tuple[str, ...]:
    """Those of them that an actuator need not have."""
    always = {kind.group for kind in _ALWAYS}
    return tuple(group for group in groups() if group not in always)


def _refused(kind: StageKind, why: str, repair: str) -> InputError:
    return InputError(f"the stage cannot be registered: {why}", code="bad-stage", where=kind.name, repair=repair)


@lru_cache(maxsize=4096)
def _kind_of(name: str, _edition: int) -> StageKind | None:
    found = [kind for kind in kinds() if name.startswith(kind.prefix)]
    return max(found, key=lambda kind: len(kind.prefix), default=None)


@cache
def _load_named() -> None:
    """The files that the environment names, once."""
    for path in filter(None, os.environ.get(VARIABLE, "").split(os.pathsep)):
        _run(path, where=VARIABLE)


def _run(path: str | Path, *, where: str) -> None:
    if not Path(path).is_file():
        raise InputError(
            f"there is no file {str(path)!r}", code="no-file", where=where, repair="name a Python file with a stage"
        )
    runpy.run_path(str(path))
