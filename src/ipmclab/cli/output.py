"""What verbs print: one JSON document, or tables for people; progress on a terminal."""

from __future__ import annotations

import math
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ipmclab.progress import first_answer_to
from ipmclab.units import Quantity
from ipmclab.units import significant as significant

if TYPE_CHECKING:
    from rich.console import Console

    from ipmclab.fit.fit import Fit
    from ipmclab.run import Finding

PIPE_WIDTH = 120
"""Columns of a table that no terminal bounds."""

UNBOUNDED = 10_000

TEXT_WIDTH = 100
"""Longest line of running text."""

_STYLES = {"error": "bold red", "warning": "yellow", "info": "cyan"}

_NEVER_CUT = frozenset({"exact-fixed-value", "fixed-uncertainty", "undetermined"})


def print_json(document: Mapping[str, Any]) -> None:
    """Print one JSON document; a number that is not finite becomes null."""
    import json

    print(json.dumps(_plain(document), allow_nan=False, indent=2))


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):  # a NumPy array or scalar
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def with_unit(value: float | None, unit: str) -> dict[str, float | str | None]:
    """A number with its SI unit next to it, as it is written to a JSON document."""
    return {"value": value, "unit": unit}


def read(value: float | None, quantity: Quantity, *, digits: int = 4) -> str:
    """A number in the unit that people read, such as ``"60.35 mA"``; a dash when there is none.

    Examples
    --------
    >>> from ipmclab.units import CURRENT
    >>> read(0.0603480290, CURRENT)
    '60.35 mA'
    """
    if value is None or not math.isfinite(value):
        return "-"
    return f"{significant(quantity.to_display(value), digits)} {quantity.display_unit}".strip()


def console(*, stderr: bool = False, width: int | None = None) -> Console:
    """Where text goes that has colour or columns."""
    from rich.console import Console

    stream = sys.stderr if stderr else sys.stdout
    known = None if stream.isatty() else PIPE_WIDTH
    return Console(file=stream, width=width or known, highlight=False, markup=False)


def print_table(headers: Sequence[str], rows: Sequence[Sequence[str]], *, title: str | None = None) -> None:
    """Print a table; columns whose cells are numbers stand to the right."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for column, header in enumerate(headers):
        numbers = all(row[column][:1] in "-+<>0123456789" for row in rows)
        table.add_column(header, justify="right" if numbers else "left")
    for row in rows:
        table.add_row(*row)
    # A cell is never cut: the terminal wraps a line that is too long for it.
    out = console(width=UNBOUNDED)
    if title is not None:
        out.print(title, style="bold")
    out.print(table)


def print_lines(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print many rows quickly: plain columns, without those that have no cell."""
    from rich.cells import cell_len

    def shown(cell: str) -> str:
        return cell if cell.isprintable() else "".join(letter if letter.isprintable() else " " for letter in cell)

    texts = [[shown(cell) for cell in row] for row in rows]
    used = [column for column in range(len(headers)) if any(row[column] for row in texts)]
    table = [[headers[column] for column in used], *([row[column] for column in used] for row in texts)]
    widths = [max(map(cell_len, column)) for column in zip(*table, strict=True)]
    lines = (
        "  ".join(cell + " " * (width - cell_len(cell)) for cell, width in zip(row, widths, strict=True))
        for row in table
    )
    print("\n".join(line.rstrip() for line in lines))


def print_paragraph(text: str) -> None:
    """Print a text in lines of readable length; a number and its percent sign stay on one line."""
    bound = textwrap.fill(text.replace(" %", "\u00a0%"), min(console().width, TEXT_WIDTH))
    print(bound.replace("\u00a0", " "))


def print_remarks(texts: Sequence[str], word: str = "remark") -> None:
    """Print what to think of a result on stderr, so that stdout stays what it was."""
    for text in texts:
        print(textwrap.fill(f"{word}: {text}", TEXT_WIDTH, subsequent_indent="  "), file=sys.stderr)


def print_briefly(findings: Sequence[Finding]) -> None:
    """Print findings of a fit: errors and warnings first and in full, with what to do; of infos one for each code.

    What a fixed value does to the answer is one number at the end of a sentence: it is never cut.
    """
    ordered = sorted(findings, key=lambda one: list(_STYLES).index(one.severity))
    print_findings([one for one in ordered if one.severity != "info"], width=TEXT_WIDTH)
    groups: dict[str, list[Finding]] = {}
    for finding in ordered:
        if finding.severity == "info":
            groups.setdefault(finding.code, []).append(finding)
    out = console()
    cut = min(out.width, 2 * TEXT_WIDTH) - 6
    for code, members in groups.items():
        out.print("  info", style=_STYLES["info"], end=" ")
        out.print(code, style="bold", end="")
        out.print(f" ({len(members)} times)" if len(members) > 1 else "")
        for member in members if code in _NEVER_CUT else members[:1]:
            if code in _NEVER_CUT:
                out.print(_indented(member.message, "    ", min(out.width, TEXT_WIDTH)))
            else:
                out.print("    " + textwrap.shorten(member.message, cut, placeholder=" ..."))
    if groups:
        print("The report and --json have the full text of what is only noted (info).")


def print_most_important(
    findings: Sequence[Finding],
    *,
    details: bool,
    outputs: Sequence[str] = (),
    labels: Sequence[str] = (),
    where: str = "--details",
) -> None:
    """Print the findings that matter most in a sentence each, or with ``details`` every one in full.

    Parameters
    ----------
    findings : sequence of Finding
    details : bool
    outputs : sequence of str
        What was fitted, where errors of other channels matter less.
    labels : sequence of str
        Of the runs.
    where : str
        Where the others stand.
    """
    from ipmclab.fit.in_brief import in_brief, more_in_words

    if details:
        print_briefly(findings)
        return
    lines, more = in_brief(findings, outputs, labels)
    for line in lines:
        print(line)
    if more:
        print(more_in_words(more, where))


def print_findings(findings: Sequence[Finding], *, width: int = UNBOUNDED) -> None:
    """Print findings: severity, code and channel; what was found; what to do.

    Those that ask for the same thing stand together.
    """
    groups: dict[tuple[str, str, str | None, str], list[str]] = {}
    for one in findings:
        groups.setdefault((one.severity, one.code, one.channel, one.repair), []).append(one.message)
    out = console()
    within = min(out.width, width)
    for (severity, code, channel, repair), messages in groups.items():
        out.print(f"  {severity}", style=_STYLES[severity], end=" ")
        times = f" ({len(messages)} times)" if len(messages) > 1 else ""
        out.print(code + (f" ({channel})" if channel else "") + times, style="bold")
        for text in filter(None, messages):
            out.print(_indented(text, "    ", within))
        if repair:
            out.print(_indented(repair, "    -> ", within))


def _indented(text: str, indent: str, width: int) -> str:
    return textwrap.fill(text, width, initial_indent=indent, subsequent_indent=" " * len(indent))


def finding_document(finding: Finding) -> dict[str, Any]:
    """A finding as it is written to a JSON document."""
    return {
        "code": finding.code,
        "severity": finding.severity,
        "channel": finding.channel,
        "message": finding.message,
        "repair": finding.repair,
        "samples": finding.samples,
        "count": finding.count,
        "effect": finding.effect,
        "values": finding.values,
    }


@contextmanager
def counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """Say on a terminal how many of many things are done: the function that is given is called with both."""
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    with console(stderr=True).status(what) as status:

        def tell(done: int, total: int) -> None:
            if done % 25 == 0 or done == total:
                status.update(f"{what}: {done} of {total}")

        yield tell


@contextmanager
def progress(what: str, *, answering: bool = False) -> Iterator[Callable[[str, float], None]]:
    """Say on a terminal what is being done, until it is done.

    Long work calls the function that is given with a sentence and the fraction that is done. The fraction comes first:
    a narrow terminal cuts the end of the line. The first answer of a fit is shown above that where the verb is
    ``answering`` with that fit.
    """
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    from ipmclab.fit.first_answer import first_answer

    def above(fit: Fit) -> None:
        status.console.print(first_answer(fit))

    with console(stderr=True).status(what) as status, first_answer_to(above) if answering else nullcontext():
        yield lambda sentence, done: status.update(f"{100.0 * done:.0f} % {what}: {sentence}")
