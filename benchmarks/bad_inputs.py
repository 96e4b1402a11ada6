"""Bad inputs, drawn by hypothesis over every verb and every kind of file: ``python -m benchmarks.bad_inputs``.

``[--inputs 100000] [--first 0] [--verbs a,b] [--minutes 60] [--record]``. A command that is sound, with the files that
it reads, is spoiled in one to three places: a word of the command line, a number, a line, bytes, or a file that is
another one (``bad_input_files.py``). It runs in this process, as the program itself would run it. Then

* it ended with 0, 1 or 2 and nothing escaped it; "a fault in ipmclab" is one;
* what was refused was refused in one message with what to do, and left the folder as it was;
* with ``--json`` there is exactly one document, without a number that is not finite;
* what was taken was taken as it was written: rows and voltage of a simulation, the quantities of an actuator's file
  and the numbers of a table are read once more, by pint and by Python's own csv, and runs are what was written.

What a sound command would set going is not set going, as others test it: a fit (one in fifty is), a demo, a server, a
recorder, samples. A command that came so far was taken.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import json
import math
import os
import random
import re
import shutil
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from time import monotonic, process_time
from typing import Any, Final, NoReturn

import typer
from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings
from hypothesis import strategies as st

from benchmarks.bad_input_files import COMMANDS, make_files, spoiled_file, spoiled_words, words_of
from benchmarks.bad_input_numbers import wrong_numbers
from benchmarks.harness import finish
from ipmclab.cli.app import run as run_command

SOURCES = ("src/ipmclab", "benchmarks/bad_input_files.py", "benchmarks/bad_input_numbers.py")
SEED: Final = 20261121
SHARES: Final = {
    "simulate": 16, "import": 26, "check": 10, "export": 6, "validate": 6, "record": 8, "identify": 5, "forecast": 4,
    "procedure": 4, "rig": 3, "runs": 1, "recover": 1, "plot": 1, "choose": 2, "report": 2, "profile": 1,
    "bootstrap": 1, "posterior": 1, "page": 1, "demo": 1, "identifiability": 2, "baseline": 2, "smooth": 2,
    "compare": 4, "next": 4, "sweep": 4, "characterise": 4,
}  # fmt: skip
"""Of a hundred inputs and some more; what reads many kinds of files has most."""

SLICE: Final = 20
KEEP: Final = "IPMCLAB_BAD_INPUTS"
"""A folder that gets the files of every fault."""

SLOW: Final = 20.0
"""An answer that takes more processor time [s] is told."""


class Taken(BaseException):
    """A command has come to where it would set something going."""


@dataclass
class Tally:
    """What became of the inputs of a verb, and what was wrong."""

    inputs: int = 0
    ends: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument(
        "--first", type=int, default=0, help="the number of the first slice; each has a seed of its own"
    )
    parser.add_argument("--verbs", default=",".join(SHARES))
    parser.add_argument("--minutes", type=float, default=math.inf, help="after which nothing is drawn")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/bad_inputs.md")
    options = parser.parse_args()
    verbs = options.verbs.split(",")
    tallies = draw_inputs({verb: SHARES[verb] for verb in verbs}, options.inputs, options.first, 60.0 * options.minutes)
    finish("bad_inputs", "Bad inputs: a message and what to do", page(tallies), [], record=options.record, gate=False)
    if any(tally.faults for tally in tallies.values()):
        sys.exit(1)


def draw_inputs(shares: Mapping[str, int], inputs: int, first: int, seconds: float) -> dict[str, Tally]:
    """Draw so many inputs of these verbs, in rounds, until the time is over [s]."""
    tallies = {verb: Tally() for verb in shares}
    end = monotonic() + seconds
    total = sum(shares.values())
    each = min(SLICE, max(1, inputs // total))
    with sound_files() as (folder, files), nothing_set_going(random.Random(SEED + first)):
        for turn in range(first, first + math.ceil(inputs / each / total)):
            for verb, share in shares.items():
                if monotonic() < end:
                    draw_slice(verb, each * share, turn, folder, files, tallies[verb])
            print(f"{turn}: {sum(tally.inputs for tally in tallies.values())} inputs", file=sys.stderr, flush=True)
    return tallies


@contextlib.contextmanager
def sound_files() -> Iterator[tuple[Path, dict[str, bytes]]]:
    """A folder to work in, and the sound files."""
    with tempfile.TemporaryDirectory() as name:
        source, folder = Path(name, "sound"), Path(name, "folder")
        source.mkdir()
        files = make_files(source)
        folder.mkdir()
        before = Path.cwd()
        os.chdir(folder)
        try:
            yield folder, files
        finally:
            os.chdir(before)


@contextlib.contextmanager
def nothing_set_going(chance: random.Random) -> Iterator[None]:
    """Where something long, or for ever, would begin, a command is over."""
    from unittest.mock import patch

    import ipmclab.store.journal.recover as recover_module
    from ipmclab.cli import recorder
    from ipmclab.identification import identify as identify_module
    from ipmclab.reporting import document, save
    from ipmclab.store.journal.finalise import finish_here
    from ipmclab.store.journal.laboratory import Laboratory

    def stop(*_: object, **__: object) -> NoReturn:
        raise Taken

    def seldom(function: Callable[..., Any]) -> Callable[..., Any]:
        def once_in_fifty(*arguments: Any, **named: Any) -> Any:
            if chance.random() > 0.02:
                raise Taken
            return function(*arguments, **named)

        return once_in_fifty

    def plan_only(_: str, job: Mapping[str, Any]) -> NoReturn:
        """What a recorder's process does before it waits for the word to start."""
        experiment = recorder.read_experiment(job)
        rig = recorder.rig_of(experiment)
        plan = recorder.plan_of(experiment, rig, Laboratory.open(experiment.folder))
        recorder.answers_of(job, plan)
        json.dumps(plan.as_dict(), allow_nan=False)
        raise Taken

    with contextlib.ExitStack() as stack:
        for where, what in (
            ("ipmclab.identification.identify.estimate", seldom(identify_module.estimate)),
            ("ipmclab.reporting.document.write_page", seldom(document.write_page)),
            ("ipmclab.reporting.save.save_figure", seldom(save.save_figure)),
            ("ipmclab.rig.process.client.launch", plan_only),
            ("ipmclab.store.journal.recover.finish", lambda path, laboratory: finish_here(Path(path), laboratory)),
            ("ipmclab.posterior.posterior.sample_posterior", stop),
            ("ipmclab.choosing.choose.hold_out", stop),
            ("ipmclab.refitting.bootstrap.bootstrap", stop),
            ("ipmclab.page.server.serve", stop),
            ("ipmclab.cli.demo._record", stop),
            ("virtual_cdaq.server.Server.__init__", stop),
            ("ipmclab.rig.checks.prove.prove", stop),
            ("ipmclab.campaign.conduct.Conduct.run", stop),
            ("ipmclab.comparison.population.populations_of", stop),
            ("ipmclab.comparison.fits._sampled", stop),
            ("ipmclab.engine.processes.Processes.__init__", stop),
            ("time.sleep", lambda _: None),
            ("typer.main.get_command", functools.cache(typer.main.get_command)),  # made anew it takes most of the time
        ):
            stack.enter_context(patch(where, what))
        sweeping = import_module("ipmclab.sweep.run_sweep")  # its package calls the function so
        stack.enter_context(patch.object(sweeping, "_run", seldom(sweeping._run)))
        assert recover_module.finish is not None
        yield


def draw_slice(verb: str, inputs: int, turn: int, folder: Path, files: Mapping[str, bytes], tally: Tally) -> None:
    """Draw some inputs of a verb; what is wrong is kept, and stops nothing."""

    @seed(SEED + turn)
    @settings(
        max_examples=inputs,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
        verbosity=Verbosity.quiet,
    )
    @given(st.data())
    def one(data: st.DataObject) -> None:
        words = words_of(data.draw(st.sampled_from(COMMANDS[verb])))
        there = dict(files)
        named = [name for name in there if any(word in (name, name.partition("/")[0]) for word in words)]
        for _ in range(data.draw(st.sampled_from((1, 1, 1, 2, 3)))):
            if named and data.draw(st.integers(0, 9)) < 6:
                name = data.draw(st.sampled_from(named))
                there[name] = spoiled_file(there[name], files, data.draw)
            else:
                words = spoiled_words(words, data.draw)
        if data.draw(st.booleans()) and words[0] != "--json":
            words = [*words, "--json"]
        tally.inputs += 1
        judge(words, folder, there, named, tally)

    one()


def judge(words: list[str], folder: Path, files: Mapping[str, bytes], named: list[str], tally: Tally) -> None:
    """Run a command over its files, and note how it ended and what is wrong with that."""
    _lay_out(folder, {name: content for name, content in files.items() if name in named or "/" not in name})
    before = _contents(folder)
    end, out, err, begun = "", io.StringIO(), io.StringIO(), process_time()
    faults: list[str] = []
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), _no_stdin():
            status = run_command(words)
        end = str(status)
    except Taken:
        status, end = -1, "taken"
    except BaseException as error:
        status, end = -1, "escaped"
        faults.append(f"{type(error).__name__} escaped: {traceback.format_exc(limit=-3)}")
    if process_time() - begun > SLOW:
        faults.append(f"it took {process_time() - begun:.0f} s")
    tally.ends[end] += 1
    if status >= 0:
        faults += _wrong_ending(words, status, out.getvalue(), err.getvalue())
    if status == 2 and (changed := _changed(before, _contents(folder))):
        faults.append(f"refused, and changed {changed}")
    if status == 0 or end == "taken":
        faults += wrong_numbers(words, folder)
    for text in faults:
        tally.faults.append(f"`{' '.join(words)}`: {text}")
        print(f"FAULT {words}: {text}\n  {err.getvalue()[-600:]}", flush=True)
        if keep := os.environ.get(KEEP):
            shutil.copytree(folder, Path(keep, str(len(tally.faults)) + words[0]), dirs_exist_ok=True)


def _wrong_ending(words: list[str], status: int, out: str, err: str) -> list[str]:
    wrong = []
    if "fault in ipmclab" in err or "Traceback" in err or "Traceback" in out:
        wrong.append("a fault of the program")
    if status not in (0, 1, 2):
        wrong.append(f"it ended with {status}")
    errors = re.findall(r"^error: ", err, re.MULTILINE)
    if status == 2 and not (len(errors) == 1 and len(err.strip()) > 20):
        wrong.append(f"no message, or more than one: {err!r}")
    if "--json" in words[-1:] and "--help" not in words and "-h" not in words:
        try:
            document = json.loads(out, parse_constant=_no_constant)
        except ValueError as error:
            if not _is_other_output(words):
                wrong.append(f"no single JSON document: {error}: {out[:200]!r}")
        else:
            told = document.get("error") if isinstance(document, dict) else None
            if status == 2 and not (told and told.get("message") and told.get("repair")):
                wrong.append(f"a refusal without its message or repair: {told}")
    return wrong


def _is_other_output(words: list[str]) -> bool:
    return "--" in words or words[0] in ("--help", "--version", "-h") or "--template" in words


def _no_constant(text: str) -> NoReturn:
    raise ValueError(f"{text} is no JSON")


@contextlib.contextmanager
def _no_stdin() -> Iterator[None]:
    before, sys.stdin = sys.stdin, io.StringIO("")
    try:
        yield
    finally:
        sys.stdin = before


def _lay_out(folder: Path, files: Mapping[str, bytes]) -> None:
    """Nothing but these files in the folder."""
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif (
            path.name not in files
            or path.stat().st_size != len(files[path.name])
            or path.read_bytes() != files[path.name]
        ):
            path.unlink()
    for name, content in files.items():
        path = folder / name
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def _contents(folder: Path) -> dict[str, tuple[int, int]]:
    found = {}
    for path in folder.rglob("*"):
        told = path.lstat()
        found[str(path.relative_to(folder))] = (
            told.st_size if path.is_file() else 0,
            told.st_mtime_ns if path.is_file() else 0,
        )
    return found


def _changed(before: Mapping[str, object], after: Mapping[str, object]) -> str:
    """What a command that was refused has left; folders of a laboratory and its catalogue may be made."""
    allowed = re.compile(r"(^|/)(recording|runs|journal-archive|lost\+found|laboratory|catalogue\.db.*)(/|$)")
    names = [name for name in {*before, *after} if before.get(name) != after.get(name) and not allowed.search(name)]
    return ", ".join(sorted(names))


def page(tallies: Mapping[str, Tally]) -> str:
    """How the inputs of each verb ended, and every fault."""
    total = sum(tally.inputs for tally in tallies.values())
    rows = [
        f"| {verb} | {tally.inputs} | {tally.ends['2']} | {tally.ends['1']} | "
        f"{tally.ends['0'] + tally.ends['taken']} | {len(tally.faults)} |"
        for verb, tally in tallies.items()
    ]
    faults = [f"* {text}" for tally in tallies.values() for text in tally.faults] or ["None."]
    return "\n".join(
        [
            f"{total} inputs, seed {SEED} and on. Some are still sound when they are spoiled: those were taken.",
            "",
            "| verb | inputs | refused, 2 | failed, 1 | taken | faults |",
            "|---|---|---|---|---|---|",
            *rows,
            "",
            "## Faults",
            "",
            *faults,
        ]
    )


if __name__ == "__main__":
    main()
