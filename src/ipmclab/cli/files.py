"""Files that verbs read and write, checked before the long work begins."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ipmclab.destination import keep_what_is_read, target_of, write_text
from ipmclab.errors import InputError
from ipmclab.platform import as_typed
from ipmclab.toml_file import glance

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit
    from ipmclab.model import Actuator
    from ipmclab.run import Run


def check_output(
    path: Path, *, force: bool, suffixes: Sequence[str], reads: Iterable[Path | str], option: str = "--out"
) -> None:
    """Refuse an output file that could not be written at the end, or that the command reads.

    Parameters
    ----------
    path : Path
    force : bool
        Whether a file that exists is replaced.
    suffixes : sequence of str
        How its name may end.
    reads : iterable of Path or str
        Every file that the command reads, as far as that is known yet; a name that is no file does not matter.
    option : str
        The one that named it.

    Raises
    ------
    InputError
        Another kind of file, a folder, a folder that is not there or closed, a file that is read (even with
        ``force``), or one that exists without ``force``.
    """
    if path.suffix.lower() not in suffixes and not path.is_dir():
        raise InputError(
            f"the file ends in {path.suffix!r}, it must end in {' or '.join(suffixes)}",
            code="bad-suffix",
            where=f"{option} {path}",
            repair=f"write for example {path.with_suffix(suffixes[0]).name}",
        )
    keep_what_is_read(path, reads, where=f"{option} {path}")
    target_of(path, overwrite=force)


def write_template(
    text: str, file: Path | None, out: Path | None, *, verb: str, then: str, force: bool, as_json: bool
) -> None:
    """Write or print a file to fill in.

    Parameters
    ----------
    text : str
    file : Path, optional
        What the verb would read otherwise; nothing is read here.
    out : Path, optional
        Printed where it is left out.
    verb : str
        Which is also what such a file is called.
    then : str
        The command that reads it when it is filled in.
    force, as_json : bool

    Raises
    ------
    InputError
        A file to read is named, or ``out`` cannot be written.
    """
    from ipmclab.cli.output import print_json

    if file is not None:
        raise InputError(
            f"a template is written with --out, it reads no {verb}",
            code="usage",
            where=str(file),
            repair=f"ipmclab {verb} --template --out {as_typed(file)}",
        )
    if out is not None:
        check_output(out, force=force, suffixes=(".toml",), reads=())
        write_text(text, out, overwrite=force)
    if as_json:
        print_json({"template": text, "out": out})
    elif out is None:
        print(text, end="")
    else:
        print(f"wrote {out}; fill it in, then: {then}")


def actuator_files(*names: str | None) -> list[str]:
    """Where actuators come from that are named with or without further stages; of the library, no file.

    Examples
    --------
    >>> actuator_files("mine.toml+leak.cubic", None)
    ['mine.toml']
    """
    from ipmclab.model.actuator_file import stages_after

    return [stages_after(name)[0] for name in names if name is not None]


def means_actuator(word: str) -> bool:
    """Whether a word names an actuator: in the library, a variant of one, or a TOML file with a geometry."""
    base = word if Path(word).exists() else word.partition("+")[0].strip()
    path = Path(base)
    if path.suffix.lower() == ".toml":
        table = glance(path)
        return table is None or "geometry" in table  # its reader says what is wrong with it
    # A name without an ending that is no file is meant for the library, rightly or not.
    return not path.suffix and not path.exists() and path.name == base


def named_by_file(name: str) -> Actuator:
    """An actuator that goes by the file it was given in: several fits of one strip have the same name in their files.

    Raises
    ------
    InputError
        What ``load_actuator`` refuses.

    Examples
    --------
    >>> named_by_file("friend-2").name
    'friend-2'
    """
    from ipmclab import load_actuator

    return replace(load_actuator(name), name=Path(name).name)


def fit_or_actuator(name: str) -> Fit | Actuator:
    """The fit of a file that has one, else the actuator.

    Raises
    ------
    InputError
        What ``load_actuator`` and ``read_fit`` refuse.
    """
    from ipmclab import load_actuator, read_fit

    is_fit = name.lower().endswith(".toml") and "fit" in (glance(Path(name)) or {})
    return read_fit(name) if is_fit else load_actuator(name)


def read_runs(paths: Sequence[Path]) -> list[Run]:
    """Read runs, each known by its file.

    Raises
    ------
    InputError
        A file that is no run; for a foreign record the repair is the command that imports it.
    """
    from ipmclab.store.run_file import read_run

    runs = []
    for path, label in zip(paths, labels(paths), strict=True):
        if path.suffix.lower() != ".nc" and path.is_file():
            run = path.with_name(f"{path.name.partition('.')[0] or 'run'}.nc")
            if path.suffix.lower() == ".toml":
                raise _toml_for_a_run(path)
            raise InputError(
                f"this is not a run: a run ends in .nc, this file in {path.suffix!r}",
                code="not-a-run",
                where=str(path),
                repair=f"import it first: ipmclab import {as_typed(path)} --out {as_typed(run)}",
            )
        runs.append(replace(read_run(path), file=label))
    return runs


def labels(paths: Sequence[Path]) -> list[str]:
    """A name for each run in tables and figures: that of its file, with its folder where two files are called alike.

    Examples
    --------
    >>> labels([Path("a/step.nc"), Path("sine.nc")])
    ['step.nc', 'sine.nc']
    """
    names = [path.name for path in paths]
    return [path.as_posix() if names.count(path.name) > 1 else path.name for path in paths]


def _toml_for_a_run(path: Path) -> InputError:
    """What to say of a TOML file that is where a run is expected."""
    table = glance(path) or {}
    if "geometry" in table:
        kind, repair = "this is an actuator, not a run", "the actuator, where one is needed, comes first, then the runs"
    elif "channels" in table:
        kind, repair = (
            "this is an import map, not a run",
            f"ipmclab import RECORD --map {as_typed(path)} --out RUN.nc makes a run",
        )
    else:
        kind, repair = "this is a TOML file, not a run", "give a run, which ends in .nc"
    return InputError(kind, code="not-a-run", where=str(path), repair=repair)
