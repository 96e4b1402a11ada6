"""``ipmclab import``: a foreign record becomes a run."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ipmclab.cli.files import check_output
from ipmclab.cli.options import Force, Json, answers_in
from ipmclab.cli.output import print_json, print_paragraph, print_table, progress, read, with_unit
from ipmclab.destination import target_of, write_text
from ipmclab.errors import InputError
from ipmclab.units import CHANNELS, TIME

if TYPE_CHECKING:
    from ipmclab.run import Run
    from ipmclab.store.guess import Guess, Question


def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The foreign record.", show_default=False)],
    out: Annotated[Path | None, typer.Option(metavar="RUN.nc", help="The run to write.")] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="MAP.toml", help="What its columns are; without it, that is guessed and shown."),
    ] = None,
    template: Annotated[
        Path | None,
        typer.Option(metavar="MAP.toml", help="Write the guessed map, with what is not known, and import nothing."),
    ] = None,
    answer: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="What the file does not say, such as sampling_period='20 ms'."),
    ] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Import a foreign record (CSV, XLSX, MAT, TDMS, LVM, the thesis's binary).

    What its columns are is guessed, shown, and written next to the run as a map; what cannot be known is asked.

    \b
    ipmclab import step.csv --out step.nc
    ipmclab import step.csv.gz --map platform.toml --out step.nc
    """
    from ipmclab import import_run, write_run
    from ipmclab.quality.record import Record
    from ipmclab.store.import_map import load_import_map
    from ipmclab.store.importing import unmet_sentinels

    answers = answers_in(answer or [], example="sampling_period='20 ms'")
    if map_file is not None:
        _refuse_unused(answers, "the map says all of the file", "write it into the map")
    if template is not None:
        _write_template(file, template, answers, force=force, as_json=as_json)
        return
    if out is None:
        raise InputError(
            "neither --out nor --template is given", code="usage", where="import", repair="add --out RUN.nc"
        )
    check_output(out, force=force, suffixes=(".nc",), reads=[file] if map_file is None else [file, map_file])
    import_map = None if map_file is None else load_import_map(map_file)
    guessed, own_map = None, out.with_suffix(".map.toml")
    if import_map is None:
        guessed = _guess(file, own_map, answers, force=force)
        import_map = None if guessed is None else guessed.map
    with progress(f"importing {file.name}"):
        run = import_run(file, import_map)
        write_run(run, out, overwrite=force)
    if guessed is not None:
        write_text(guessed.as_toml(file.name), own_map, overwrite=force)

    responses = Record.of(run).channels
    far_out = {name: responses[name].beyond if name in responses else () for name in run.channels}
    channels = {name: _describe(run, name, far_out[name]) for name in run.channels}
    unmet = [] if import_map is None else unmet_sentinels(run, import_map)
    notes = [*(f"{one}: see sentinels in the map." for one in unmet), *_notes(channels)]
    period_known = run.metadata.sampling_period_known
    if as_json:
        print_json(
            {
                "source": file,
                "rows": len(run),
                "duration": with_unit(float(run.time[-1] - run.time[0]), "s"),
                "period": with_unit(1.0 / run.rate, "s"),
                "sampling_period_known": period_known,
                "hold": run.hold,
                "channels": {
                    name: {
                        "low": with_unit(entry["low"], CHANNELS[name].unit),
                        "high": with_unit(entry["high"], CHANNELS[name].unit),
                        "sentinels": entry["sentinels"],
                        "missing": entry["missing"],
                        "far_out": len(entry["far_out"]),
                    }
                    for name, entry in channels.items()
                },
                "map": map_file or (own_map if guessed is not None else None),
                "taken": [] if guessed is None else [*guessed.taken, *guessed.left_out],
                "out": out,
            }
        )
        return
    if guessed is not None:
        print("\n".join((*guessed.taken, *guessed.left_out)))
    rows = [
        [
            CHANNELS[name].name,
            read(entry["low"], CHANNELS[name]),
            read(entry["high"], CHANNELS[name]),
            str(entry["sentinels"]),
            str(entry["missing"]),
        ]
        for name, entry in channels.items()
    ]
    period = read(1.0 / run.rate, TIME) + (" between rows" if run.is_uniform else " between rows on average")
    length = read(float(run.time[-1] - run.time[0]) + 1.0 / run.rate, TIME)
    print_table(
        ["channel", "lowest", "highest", "sentinels", "missing"],
        rows,
        title=f"{file.name}: {period}, {len(run)} rows, {length} in all",
    )
    for note in notes:
        print_paragraph(note)
    if not period_known:
        print("The file does not hold its sampling period: every time constant scales with the one in the map.")
    print(f"wrote {out}" + (f" and {own_map}: see what was taken for what" if guessed is not None else ""))


def _write_template(file: Path, template: Path, answers: dict[str, str], *, force: bool, as_json: bool) -> None:
    """Write what is guessed as a map, to be corrected."""
    from ipmclab.store.guess import guess_map

    check_output(template, force=force, suffixes=(".toml",), reads=[file], option="--template")
    guess = guess_map(file, answers)
    if not guess.questions:
        _refuse_unused(guess.unused)
    write_text(guess.as_toml(file.name), template, overwrite=force)
    questions = [{"key": one.key, "text": one.text, "choices": one.choices} for one in guess.questions]
    if as_json:
        assumptions = [*guess.taken, *guess.left_out]
        print_json({"source": file, "map": template, "taken": assumptions, "questions": questions})
        return
    print("\n".join((*guess.taken, *guess.left_out)))
    for question in guess.questions:
        print_paragraph(f"not known: {_asked(question)}")
    print(f"wrote {template}")


def _guess(file: Path, own_map: Path, answers: dict[str, str], *, force: bool) -> Guess | None:
    """What a file seems to be; None where ipmclab exported it. What cannot be known is asked at a terminal.

    Raises
    ------
    InputError
        Something cannot be known, and there is nobody to ask.
    """
    from ipmclab.store.guess import guess_map
    from ipmclab.store.importing import is_own_export

    if is_own_export(file):
        _refuse_unused(answers)
        return None
    target_of(own_map, overwrite=force)
    given = dict(answers)
    guess = guess_map(file, answers)
    while guess.questions and sys.stdin.isatty():
        print(f"{_asked(guess.questions[0])}\n> ", end="", file=sys.stderr, flush=True)
        typed = sys.stdin.readline()
        if not typed:
            break
        said = answers | {guess.questions[0].key: typed.strip()}
        try:
            guess = guess_map(file, said)
        except InputError as error:
            print(error, file=sys.stderr)
        else:
            answers = said
    if guess.questions:
        asked = "; ".join(f"{question.key}: {_asked(question)}" for question in guess.questions)
        first = guess.questions[0]
        raise InputError(
            f"the file does not say all that is needed. {asked}",
            code="open-question",
            where=str(file),
            repair=f"add for example --answer '{first.key}={first.choices[0] if first.choices else first.example}', or "
            f"write a map with --template MAP.toml and correct it",
        )
    _refuse_unused(key for key in guess.unused if key in given)
    return guess


def _refuse_unused(
    answers: Iterable[str],
    why: str = "the file says that itself, or there is no such question",
    repair: str = "leave it out; where the file is wrong, write a map with --template MAP.toml and correct it",
) -> None:
    """Refuse answers that nobody asked for: the run would be another than they say."""
    for key in answers:
        raise InputError(
            f"nothing is asked that this answers: {why}", code="usage", where=f"--answer {key}", repair=repair
        )


def _asked(question: Question) -> str:
    choices = f" ({', '.join(question.choices)})" if question.choices else f" (for example {question.example})"
    return question.text + choices


def _describe(run: Run, name: str, far_out: Sequence[float]) -> dict[str, Any]:
    from ipmclab.run import QUALITY_FLAGS

    values = run.channels[name]
    lost = values != values  # NaN
    present = values[~lost]
    flags = run.quality.get(name)
    sentinels = 0 if flags is None else int(((flags & QUALITY_FLAGS["sentinel"]) > 0).sum())
    return {
        "low": float(present.min()) if len(present) else None,
        "high": float(present.max()) if len(present) else None,
        "sentinels": sentinels,
        "missing": int(lost.sum()) - sentinels,
        "far_out": far_out,
    }


def _notes(channels: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """What the numbers of the table alone do not say."""
    from ipmclab.quality.record import counted

    notes = []
    for name, entry in channels.items():
        quantity = CHANNELS[name]
        if entry["far_out"]:
            shown = ", ".join(read(value, quantity) for value in entry["far_out"][:3])
            more = ", ..." if len(entry["far_out"]) > 3 else ""
            notes.append(
                f"Next to lost readings, the {quantity.name} has {counted(len(entry['far_out']), 'reading')} far from "
                f"the others ({shown}{more}): identification leaves such readings out."
            )
    return notes
