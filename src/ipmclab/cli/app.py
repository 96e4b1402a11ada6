"""The verbs, and what becomes of an error.

Verbs import the heavy parts of the house inside their functions, so that ``--help`` stays quick.
"""

from __future__ import annotations

import inspect
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand

from ipmclab.cli import (
    again,
    baseline,
    characterise,
    check,
    choose,
    compare,
    demo,
    export,
    forecast,
    identifiability,
    identify,
    import_,
    next_,
    page,
    plot,
    posterior,
    procedure,
    record,
    recover,
    report,
    rig,
    runs,
    simulate,
    smooth,
    sweep,
    validate,
)
from ipmclab.cli.options import PlainGroup, SpreadCommand
from ipmclab.cli.output import print_json
from ipmclab.errors import INTERRUPTED, InputError, IpmclabError
from ipmclab.version import __version__

PROGRAM: Final = "ipmclab"

TRACEBACK: Final = "IPMCLAB_TRACEBACK"
"""Environment variable that, set to 1, shows where a fault of the program came from. No traceback comes otherwise."""

VERBS: Final[dict[str, Callable[..., None]]] = {
    "demo": demo.demo,
    "simulate": simulate.simulate,
    "sweep": sweep.sweep,
    "import": import_.import_,
    "export": export.export,
    "check": check.check,
    "baseline": baseline.baseline,
    "smooth": smooth.smooth,
    "plot": plot.plot,
    "identifiability": identifiability.identifiability,
    "identify": identify.identify,
    "profile": again.profile,
    "bootstrap": again.bootstrap,
    "posterior": posterior.posterior,
    "procedure": procedure.procedure,
    "validate": validate.validate,
    "forecast": forecast.forecast,
    "choose": choose.choose,
    "next": next_.next_,
    "compare": compare.compare,
    "report": report.report,
    "record": record.record,
    "characterise": characterise.characterise,
    "recover": recover.recover,
    "runs": runs.runs,
    "page": page.page,
}

GROUPS: Final = {"rig": rig.rig_app}
"""Verbs that have verbs of their own."""

SETTINGS: Final[dict[str, Any]] = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


class Verbs(PlainGroup):
    """The verbs, each read when it is asked for: reading the options of all of them takes longer than a short job.

    Until then a verb is its name and its help, which is all that the list of verbs shows.
    """

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        helps = {name: inspect.getdoc(verb) for name, verb in VERBS.items()}
        helps |= {name: group.info.help for name, group in GROUPS.items()}
        self.commands = {name: TyperCommand(name, help=text) for name, text in helps.items()}

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """A verb with its options, or None."""
        if cmd_name in GROUPS:
            return typer.main.get_command(GROUPS[cmd_name])
        if cmd_name not in VERBS:
            return None
        alone = typer.Typer(add_completion=False, rich_markup_mode=None, context_settings=SETTINGS)
        alone.command(cmd_name, cls=SpreadCommand)(VERBS[cmd_name])
        return typer.main.get_command(alone)


app = typer.Typer(
    cls=Verbs,
    # --install-completion and --show-completion, for bash, zsh, fish and PowerShell.
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # rich help costs 0.2 s more
    context_settings=SETTINGS,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"{PROGRAM} {__version__}")
        raise typer.Exit()


@app.callback()
def _house(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """From recorded runs of an IPMC actuator to a validated model of it.

    New here? Run: ipmclab demo
    """


def run(arguments: Sequence[str]) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str
        What follows the program's name.

    Returns
    -------
    status : int
        0 done; 1 the job ran and failed; 2 bad input; 130 interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # A redirected Windows console cannot write every letter; a question mark beats a crash.
            stream.reconfigure(errors="replace")
    command = typer.main.get_command(app)
    try:
        status = command.main(args=list(arguments) or ["--help"], prog_name=PROGRAM, standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of a pipe left, as `head` does. Python would complain once more when it closes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except typer.Abort:  # at a question: Ctrl-C, or the end of what is typed
        status = INTERRUPTED
    except Exception as error:
        explained = _explain(error)
        if explained.code == "fault" and os.environ.get(TRACEBACK, "").strip() == "1":
            traceback.print_exception(error)
        return _fail(explained, as_json="--json" in arguments)
    if status == INTERRUPTED:
        interrupted = IpmclabError("stopped before the end", code="interrupted", repair="run the command again")
        interrupted.exit_status = INTERRUPTED
        return _fail(interrupted, as_json="--json" in arguments)
    return int(status or 0)


def _fail(error: IpmclabError, *, as_json: bool) -> int:
    if as_json:
        print_json({"error": error.as_dict()})
    print(f"error: {error}", file=sys.stderr)
    return error.exit_status


def _explain(error: Exception) -> IpmclabError:
    """Any exception as one of ours, with what to do about it."""
    if isinstance(error, IpmclabError):
        return error
    if hasattr(error, "format_message"):  # what typer raises for a wrong use of the command line
        context = getattr(error, "ctx", None)
        path = context.command_path if context else PROGRAM
        message = " ".join(error.format_message().split()).rstrip(".")
        example = _example(context) if type(error).__name__ == "MissingParameter" else ""
        quotes = "put a text or a path that has blanks in quotes; " if "unexpected extra argument" in message else ""
        return InputError(message, code="usage", where=path, repair=example or f"{quotes}see {path} --help")
    if isinstance(error, UnicodeDecodeError):
        return InputError(
            f"this is not UTF-8 text (byte {error.start})", code="not-utf-8", repair="save the file as UTF-8"
        )
    if isinstance(error, OSError) and error.filename is not None:
        return InputError(
            error.strerror or str(error),
            code="file",
            where=str(error.filename),
            repair=_FILE_REPAIRS.get(type(error), "check the path and the disk"),
        )
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return IpmclabError(
        f"{type(error).__name__}: {error}",
        code="fault",
        where=f"{frame.filename}:{frame.lineno}",
        repair=f"this is a fault in {PROGRAM}: run the same command once more with the environment variable "
        f"{TRACEBACK} set to 1, and report what it prints",
    )


def _example(context: Any) -> str:
    """The first command in the help of a verb, as a repair of one that lacks something."""
    help_of = (context.command.help or "") if context is not None else ""
    lines = (line.strip() for line in help_of.splitlines())
    first = next((line for line in lines if line.startswith(f"{PROGRAM} ")), None)
    return f"write for example: {first}" if first else ""


_FILE_REPAIRS: Final[dict[type[OSError], str]] = {
    FileNotFoundError: "check the path",
    IsADirectoryError: "give a file, this is a folder",
    NotADirectoryError: "check the path, a part of it is a file",
    PermissionError: "ask for the right to this file, or choose another place",
}
