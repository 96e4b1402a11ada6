"""Arguments and options that several verbs share."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from ipmclab.errors import InputError
from ipmclab.units import Quantity, parse_number, parse_quantity

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document (SI units) instead of tables.")]
Details = Annotated[
    bool, typer.Option("--details", help="Print everything that is known, with every finding and its repair.")
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="tcp://HOST:PORT",
        help="Do the work on the Dask cluster of this scheduler (extra cluster).",
        show_default=False,
    ),
]
Workers = Annotated[
    int | None, typer.Option(metavar="N", help="Do the work in N processes of this machine.", show_default=False)
]
Yes = Annotated[bool, typer.Option("--yes", help="Start without asking; what only a person can have done is unknown.")]
Answer = Annotated[
    list[str] | None,
    typer.Option(metavar="STEP=VALUE", help="Answer the question of a step, such as clamp=kept; may be repeated."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace the output file if it exists.")]
ActuatorName = Annotated[
    str,
    typer.Argument(
        metavar="ACTUATOR",
        help="A strip of the library (friend-2, friend-2-appendix; friend-1-measured to friend-7-measured) or a TOML "
        "file, with further stages after a + (friend-2+leak.exponential+relaxation.displacement=2).",
        show_default=False,
    ),
]
RunFile = Annotated[Path, typer.Argument(metavar="RUN", help="A run (.nc).", show_default=False)]
RunFiles = Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs (.nc).", show_default=False)]
Free = Annotated[
    list[str],
    typer.Option(
        metavar="NAMES",
        default_factory=lambda: ["electrical"],
        show_default=False,
        help="What is identified: groups (electrical, coupling, leak, relaxation, viscoelastic, clamp, environment) or "
        "dotted names, age.runs.NAME for how fast a parameter ages; repeat it, or use commas. Unless given: "
        "electrical.",
    ),
]
PerRun = Annotated[
    list[str],
    typer.Option(
        metavar="NAMES", default_factory=list, show_default=False, help="Free parameters that each run has for itself."
    ),
]
PerMounting = Annotated[
    list[str],
    typer.Option(
        metavar="NAMES",
        default_factory=list,
        show_default=False,
        help="Free parameters that each mounting has for itself.",
    ),
]
Prior = Annotated[
    list[str],
    typer.Option(
        metavar="NAMES",
        default_factory=list,
        show_default=False,
        help="Free parameters whose value and standard uncertainty in the file count as known beforehand.",
    ),
]


_WHOLE: Final = 1000
"""Letters: no first sentence is as long."""


class PlainGroup(TyperGroup):
    """Verbs whose list has the whole first sentence of each one's help."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write the list."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, verb.get_short_help_str(_WHOLE)) for name, verb in self.commands.items()])


class PlainCommand(TyperCommand):
    """A command whose help names its arguments without their types in Python, and as the usage of others has them."""

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        for one in self.params:
            if isinstance(one, TyperArgument):
                vars(one)["display_type_rich"] = lambda ctx: None  # noqa: ARG005  # typer gives it

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """``ACTUATOR RUN...`` where typer has ``{ACTUATOR} {RUN...}...``."""
        return [re.sub(r"^\{(.*)\}(\.\.\.)?$", r"\1", piece) for piece in super().collect_usage_pieces(ctx)]


class SpreadCommand(PlainCommand):
    """A command that takes patterns of files, and options with several values: ``--runs a.nc b.nc``.

    The parser takes one value an option, so ``--runs a.nc b.nc`` is read as ``--runs a.nc --runs b.nc``.
    Only options declared as ``SPREAD`` do this, so that a positional argument is never taken by accident elsewhere.
    """

    SPREAD = ("--runs", "--validation")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Repeat a spread option in front of each of its values, and put files in the place of patterns."""
        valued = {name for one in self.params if not getattr(one, "is_flag", True) for name in one.opts}
        known = {option for parameter in self.params for option in parameter.opts}
        repeated: list[str] = []
        current: str | None = None
        values = 0
        for word, before in zip(args, ["", *args], strict=False):
            is_value = before in valued and before not in self.SPREAD
            for each in [word] if is_value else matching_files(word):
                if each.startswith("-"):
                    name, joined, _ = each.partition("=")
                    current = name if name in self.SPREAD and name in known else None
                    values = 1 if joined else 0
                elif current is not None:
                    values += 1
                    if values > 1:
                        repeated.append(current)
                repeated.append(each)
        return super().parse_args(ctx, repeated)


def matching_files(word: str) -> list[str]:
    """The files that a pattern names which the shell left as it is: ``*.nc``, ``runs/**/*.nc``; other words as such."""
    if word.startswith("-") or not any(mark in word for mark in "*?") or Path(word).exists():
        return [word]
    return sorted(glob.glob(word, recursive=True)) or [word]


def answers_in(texts: Iterable[str], *, example: str, option: str = "--answer") -> dict[str, str]:
    """What values of ``--answer`` such as ``clamp=done`` say, or of another such option.

    Parameters
    ----------
    texts : iterable of str
    example : str
        For the message.
    option : str

    Raises
    ------
    InputError
        One has no ``=``.

    Examples
    --------
    >>> answers_in(["sampling_period = 20 ms"], example="sampling_period='20 ms'")
    {'sampling_period': '20 ms'}
    """
    found = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(
                f"{text!r} has no '='",
                code="usage",
                where=option,
                repair=f"write for example {option} {example}",
            )
        found[name.strip()] = value.strip()
    return found


def positive(text: str, quantity: Quantity, *, option: str) -> float:
    """A quantity above zero that was given as the value of an option [SI].

    Raises
    ------
    InputError
        No number, no unit, another unit, zero or less.
    """
    number, _ = parse_number(text, where=option)
    if number <= 0:
        raise InputError(
            f"the {quantity.name} is {text!r}, it must be above 0",
            code="out-of-range",
            where=option,
            repair=f"give for example '10 {quantity.display_unit}'",
        )
    return parse_quantity(text, quantity, where=option)
