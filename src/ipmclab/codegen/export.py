"""Which tool an actuator is written for."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from ipmclab.codegen import matlab
from ipmclab.destination import target_of
from ipmclab.errors import InputError, suggest
from ipmclab.kinds import tell_kinds
from ipmclab.model import Actuator

Covariance = Mapping[str, Mapping[str, float]]
Named = Callable[[str, Actuator], bool]
Writer = Callable[[Actuator, Path, Covariance], tuple[Path, ...]]

TARGETS: Final[dict[str, tuple[str, Named, Writer]]] = {"matlab": (".m", matlab.is_name, matlab.write)}
"""The tools, each with the ending of its file, what may be its name, and what writes it.

A new one is a file beside ``matlab.py``."""


@tell_kinds
def export_actuator(
    actuator: Actuator,
    path: str | os.PathLike[str],
    *,
    to: str = "matlab",
    covariance: Covariance | None = None,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write an actuator as a program of another tool.

    Parameters
    ----------
    actuator : Actuator
        A leak is in it with its slope at 0 V, as for small voltages; a laser is not: the displacement is the strip's.
    path : str or path
        For MATLAB and GNU Octave a ``.m`` file; a ``.mat`` file of the same name comes beside it.
    to : "matlab"
    covariance : mapping of name to mapping of name to float [SI], optional
        Of the parameters, as ``fit.covariance`` has it.
    overwrite : bool

    Returns
    -------
    written : tuple of Path

    Raises
    ------
    InputError
        An unknown tool, another ending, a file that exists or a folder that does not.

    Examples
    --------
    >>> import tempfile
    >>> from ipmclab import load_actuator
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in export_actuator(load_actuator("friend-2"), f"{folder}/strip.m")]
    ['strip.m', 'strip.mat']
    """
    if to not in TARGETS:
        raise InputError(f"unknown tool {to!r}", code="unknown-target", where="to", repair=suggest(to, TARGETS))
    ending, may_be_called, write = TARGETS[to]
    target = Path(path)
    if target.suffix != ending or not may_be_called(target.stem, actuator):
        raise InputError(
            f"the file is {target.name!r}; for {to} its name is a letter, then letters, digits and underscores, and no "
            f"word that {to} or the script uses; it ends in {ending}",
            code="bad-suffix",
            where=str(target),
            repair=f"write for example strip{ending}",
        )
    for one in (target, target.with_suffix(".mat")):
        target_of(one, overwrite=overwrite)
    return write(actuator, target, covariance or {})
