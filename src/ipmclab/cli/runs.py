"""``ipmclab runs``: what was recorded, from the catalogue."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.files import check_output
from ipmclab.cli.options import Force, Json
from ipmclab.cli.output import TEXT_WIDTH, counting, print_json, print_paragraph
from ipmclab.cli.plot import SUFFIXES
from ipmclab.errors import InputError, suggest
from ipmclab.platform import as_typed

if TYPE_CHECKING:
    from ipmclab.store.catalogue.catalogue import Catalogue, CatalogueRow, Problem, RunQuery, Sweep

PURPOSES: Final = ("signal", "baseline", "fingerprint", "reference")

_PROBLEMS_SHOWN: Final = 20


def runs(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER",
            help="A laboratory folder, or any other with runs; unless given, this one, or the folder runs in it.",
            show_default=False,
        ),
    ] = None,
    sample: Annotated[
        str | None,
        typer.Option(metavar="ID", help="The runs of this sample. Without another option: its life on one time line."),
    ] = None,
    signal: Annotated[str | None, typer.Option(metavar="KIND", help="A waveform, for example step or sine.")] = None,
    amplitude: Annotated[str | None, typer.Option(metavar="RANGE", help='For example "0.9 V..1.1 V".')] = None,
    frequency: Annotated[str | None, typer.Option(metavar="RANGE", help='For example "0.05 Hz..1 Hz".')] = None,
    measured: Annotated[
        list[str] | None, typer.Option(metavar="CHANNEL", help="For example force; may be repeated.")
    ] = None,
    humidity: Annotated[str | None, typer.Option(metavar="RANGE", help='For example "78 percent..82 percent".')] = None,
    temperature: Annotated[str | None, typer.Option(metavar="RANGE", help='For example "20 degC..25 degC".')] = None,
    since: Annotated[str | None, typer.Option(metavar="DATE", help="For example 2026-11-21.")] = None,
    until: Annotated[
        str | None, typer.Option(metavar="DATE", help="To the end of this day, for example 2026-11-28.")
    ] = None,
    finding: Annotated[
        list[str] | None, typer.Option(metavar="CODE", help="For example spike; may be repeated.")
    ] = None,
    state: Annotated[
        str | None, typer.Option(metavar="STATE", help="recording, complete, aborted, recovered, damaged or missing.")
    ] = None,
    purpose: Annotated[str | None, typer.Option(metavar="|".join(PURPOSES), help="Why it was recorded.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.svg|.png|.pdf", help="With --sample alone: the life as a figure.")
    ] = None,
    force: Force = False,
    catalogue: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="postgresql://USER@HOST/NAME of a group, or an SQLite file; otherwise IPMCLAB_CATALOGUE, or "
            "catalogue.db in the folder.",
        ),
    ] = None,
    rebuild: Annotated[bool, typer.Option("--rebuild", help="Make the catalogue again from the run files.")] = False,
    as_json: Json = False,
) -> None:
    """List the runs of a folder, or those that answer a question; the life of a sample.

    \b
    ipmclab runs runs --signal step --amplitude "0.9 V..1.1 V" --humidity "78 percent..82 percent"
    ipmclab runs --sample strip-1 --out life.svg
    """
    from ipmclab.store.catalogue.catalogue import Catalogue, RunQuery
    from ipmclab.store.catalogue.range import parse_moment, parse_range
    from ipmclab.units import FREQUENCY, RELATIVE_HUMIDITY, TEMPERATURE, VOLTAGE

    query = RunQuery(
        sample=sample,
        signal=None if signal is None else _waveform(signal),
        amplitude=None if amplitude is None else parse_range(amplitude, VOLTAGE, where="--amplitude", single=True),
        frequency=None if frequency is None else parse_range(frequency, FREQUENCY, where="--frequency", single=True),
        measured=tuple(_channel(name) for name in measured or ()),
        humidity=None if humidity is None else parse_range(humidity, RELATIVE_HUMIDITY, where="--humidity"),
        temperature=None if temperature is None else parse_range(temperature, TEMPERATURE, where="--temperature"),
        since=None if since is None else parse_moment(since, where="--since"),
        until=None if until is None else parse_moment(until, where="--until", end=True),
        findings=tuple(finding or ()),
        state=None if state is None else _one_of(state, _states(), "--state"),
        purpose=None if purpose is None else _one_of(purpose, PURPOSES, "--purpose"),
    )
    if query.since is not None and query.until is not None and query.since > query.until:
        raise InputError(
            f"it ends ({until}) before it begins ({since})",
            code="bad-range",
            where="--until",
            repair="give the earlier one as --since",
        )
    is_life = sample is not None and query == RunQuery(sample=sample)
    if out is not None:
        if not is_life:
            raise InputError(
                "a figure shows the life of one sample",
                code="usage",
                where=f"--out {out}",
                repair="give --sample ID alone, or ipmclab plot RUN... for records",
            )
        check_output(out, force=force, suffixes=SUFFIXES, reads=())  # which runs it shows is not known yet
    root, is_laboratory = _root(folder)
    known = Catalogue(root, catalogue)
    if folder is not None and known.laboratory:
        query = replace(query, laboratory=known.laboratory)
    swept = None
    if rebuild or folder is not None or is_laboratory or not known.laboratory:
        swept = _bring_up_to_date(known, rebuild=rebuild)
    rows, problems = _answer(known, query) if known.exists else ([], ())
    everything = [*(swept.problems if swept else ()), *problems]
    if is_life:
        _show_life(known, str(sample), rows, swept, everything, out=out, force=force, as_json=as_json)
    elif as_json:
        from ipmclab.cli.run_rows import run_document

        print_json({**_about(known, swept, everything), "runs": [run_document(row, known) for row in rows]})
    else:
        _print_table(known, query, rows, swept)
    _print_problems(everything)


def _bring_up_to_date(catalogue: Catalogue, *, rebuild: bool) -> Sweep | None:
    """Look at the files; None where there is nothing to look at, so that no database is left in any folder."""
    from ipmclab.store.catalogue.sweep import run_files

    is_laboratory = (catalogue.root / "recording").is_dir()
    if not catalogue.exists and not is_laboratory and next(run_files(catalogue.root, []), None) is None:
        return None
    with counting("reading run files") as tell:
        return catalogue.rebuild(None, tell) if rebuild else catalogue.sweep(None, tell)


def _answer(catalogue: Catalogue, query: RunQuery) -> tuple[list[CatalogueRow], tuple[Problem, ...]]:
    """The runs that answer a question; what nobody has looked into yet is inspected first."""
    from ipmclab.rig.experiments.fingerprint import inspect

    rows = catalogue.query(replace(query, findings=()))
    with counting("checking runs") as tell:
        problems = catalogue.inspect(rows, inspect, tell)
    return catalogue.query(query), problems


def _show_life(
    catalogue: Catalogue,
    sample: str,
    rows: list[CatalogueRow],
    swept: Sweep | None,
    problems: list[Problem],
    *,
    out: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    from ipmclab.cli.life import draw_life, life_document, print_life
    from ipmclab.store.catalogue.life import life_of

    if not rows:
        known = catalogue.samples() if catalogue.exists else []
        raise InputError(
            f"no run of a sample {sample!r} in {catalogue.root}",
            code="unknown-sample",
            where="--sample",
            repair=suggest(sample, known) if known else "no run here names a sample",
        )
    life = life_of(sample, rows)
    if out is not None:
        shown = [file for row in rows if (file := catalogue.file_of(row)) is not None]
        check_output(out, force=force, suffixes=SUFFIXES, reads=[catalogue.where, *shown])
        draw_life(life, out, force=force)
    if as_json:
        print_json({**_about(catalogue, swept, problems), **life_document(life, catalogue), "out": out})
        return
    print_life(life)
    if out is not None:
        print(f"wrote {out}")


def _about(catalogue: Catalogue, swept: Sweep | None, problems: list[Problem]) -> dict[str, Any]:
    return {
        "folder": catalogue.root,
        "catalogue": catalogue.where,
        "files": None
        if swept is None
        else {
            "there": swept.files,
            "added": swept.added,
            "changed": swept.changed,
            "gone": swept.gone,
            "not_runs": swept.foreign,
        },
        "problems": [{"path": one.path, "code": one.code, "message": one.message} for one in problems],
    }


def _print_table(catalogue: Catalogue, query: RunQuery, rows: list[CatalogueRow], swept: Sweep | None) -> None:
    from ipmclab.cli.run_rows import print_runs

    if rows:
        print_runs(rows, catalogue)
    if swept is not None and swept.files == 0 and not rows:
        print(f"no run files in {catalogue.root}")
    elif swept is None and not rows:
        print(f"no runs in {catalogue.root if not catalogue.exists else catalogue.where}")
    else:
        print(f"{len(rows) or 'no'} run{'' if len(rows) == 1 else 's'}")
    if any(row.state == "recording" for row in rows):
        print_paragraph(
            "A run that says 'recording' although nobody records it was left by a crash: "
            f"ipmclab recover {as_typed(catalogue.root)}"
        )
    unknown = [code for code in query.findings if code not in catalogue.codes()] if query.findings else []
    if unknown and not rows:
        listed = ", ".join(catalogue.codes()) or "none"
        print_paragraph(f"No run has the finding {', '.join(unknown)}; findings here: {listed}.")


def _print_problems(problems: list[Problem]) -> None:
    """Name on stderr what could not be taken in or checked: it stops nothing else."""
    import textwrap

    for one in problems[:_PROBLEMS_SHOWN]:
        text = f"problem: {one.path}: {one.message}"
        print(textwrap.fill(text, TEXT_WIDTH, subsequent_indent="  ", break_long_words=False), file=sys.stderr)
    if len(problems) > _PROBLEMS_SHOWN:
        print(f"problem: {len(problems) - _PROBLEMS_SHOWN} more, see --json", file=sys.stderr)


def _root(folder: Path | None) -> tuple[Path, bool]:
    """The folder that is meant, and whether the recorder records there."""
    if folder is not None:
        return folder, (folder / "recording").is_dir()
    here = Path()
    for place in (here, here / "runs"):
        if (place / "recording").is_dir():
            return place, True
    return here, False


def _waveform(word: str) -> str:
    from ipmclab.signals.text import WORDS

    if word in WORDS:
        return "step" if word == "dc" else word  # two words for one waveform, the catalogue has the first
    first = word.split(maxsplit=1)[0] if word.strip() else ""
    repair = f"write --signal {first}, and the rest as --amplitude and --frequency" if first in WORDS else None
    raise InputError(
        f"unknown waveform {word!r}",
        code="unknown-waveform",
        where="--signal",
        repair=repair or suggest(word, WORDS),
    )


def _channel(name: str) -> str:
    from ipmclab.units import CHANNELS

    return _one_of(name, tuple(CHANNELS), "--measured")


def _states() -> tuple[str, ...]:
    from ipmclab.store.catalogue.query import STATES

    return STATES


def _one_of(word: str, known: tuple[str, ...], option: str) -> str:
    if word not in known:
        raise InputError(
            f"unknown {option[2:]} {word!r}", code="unknown-word", where=option, repair=suggest(word, known)
        )
    return word
