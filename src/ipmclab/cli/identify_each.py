"""``ipmclab identify --each-strip``: a fit of its own for each strip of many runs."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from ipmclab.cli.files import check_output
from ipmclab.cli.output import print_json, print_table, progress
from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import is_device

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit
    from ipmclab.run import Run
    from ipmclab.workflows.many_strips import Asked

_UNSAFE = re.compile(r'[\x00-\x1f<>:"/\\|?*]|^\.+$|[. ]$')


def identify_each(
    asked: Asked,
    runs: Sequence[Run],
    out: Path,
    *,
    reads: Sequence[Path | str],
    document: Callable[[Fit], dict[str, Any]],
    scheduler: str | None,
    workers: int | None,
    force: bool,
    as_json: bool,
) -> None:
    """Fit each strip, and write its file as soon as it is fitted.

    Raises
    ------
    IpmclabError
        At the end, where a strip could not be fitted; the files of the others are there.
    """
    from ipmclab import write_fit
    from ipmclab.engine import opened
    from ipmclab.workflows.many_strips import by_strip, fit_strips

    strips = by_strip(runs)
    paths = {name: _path(out, name) for name in strips}
    _refuse_alike(strips, out)
    _make(out)
    for path in paths.values():
        check_output(path, force=force, suffixes=(".toml",), reads=reads)
    found: dict[str, Fit | IpmclabError] = {}
    with progress(f"identifying {len(strips)} strips") as tell, opened(scheduler=scheduler, workers=workers) as engine:
        for name, fit in fit_strips(strips, asked, engine=engine, progress=tell):
            found[name] = fit
            if not isinstance(fit, IpmclabError):
                write_fit(fit, paths[name], overwrite=force)
    fits = {name: fit for name in strips if not isinstance(fit := found[name], IpmclabError)}
    failed = {name: error for name in strips if isinstance(error := found[name], IpmclabError)}
    if as_json:
        documents = {name: document(fit) for name, fit in fits.items()}
        print_json({"fits": documents, "failed": {n: e.as_dict() for n, e in failed.items()}, "out": out})
    else:
        _print(fits, paths)
    if failed:
        name, error = next(iter(failed.items()))
        failure = IpmclabError(
            f"{len(failed)} of {len(strips)} strips could not be fitted, the first is {name}: {error.message}",
            code=error.code,
            where=error.where,
            repair=error.repair,
        )
        if not as_json:
            raise failure
        print(f"error: {failure}", file=sys.stderr)  # stdout has its one document
        raise typer.Exit(failure.exit_status)


def _print(fits: dict[str, Fit], paths: dict[str, Path]) -> None:
    from ipmclab.fit.rows import parameter_rows

    rows = [
        [name, row.name, row.value, row.interval, row.unit] for name, fit in fits.items() for row in parameter_rows(fit)
    ]
    if rows:
        print_table(["strip", "parameter", "value", "95 % interval", "unit"], rows)
    for name in fits:
        print(f"wrote {paths[name]}")


def _path(out: Path, name: str) -> Path:
    if _UNSAFE.search(name) or is_device(name):
        raise InputError(
            f"the strip {name!r} cannot be the name of a file",
            code="bad-path",
            where=str(out),
            repair="give its sample an id of letters and digits, or fit its runs without --each-strip",
        )
    return out / f"{name}.toml"


def _refuse_alike(names: Iterable[str], out: Path) -> None:
    """Refuse strips whose files would be one where capitals do not count."""
    seen: dict[str, str] = {}
    for name in names:
        other = seen.setdefault(name.casefold(), name)
        if other != name:
            raise InputError(
                f"the strips {other!r} and {name!r} would have one file",
                code="bad-path",
                where=str(out),
                repair="give one sample one id in all runs, or two samples ids that differ not in capitals alone",
            )


def _make(out: Path) -> None:
    try:
        out.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"this cannot be a folder: {error.strerror or error}",
            code="bad-path",
            where=f"--out {out}",
            repair="with --each-strip, give a folder, in a folder that exists",
        ) from error
