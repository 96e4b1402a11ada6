"""What a fit says in short: a table, one verdict, and the few findings that matter most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from ipmclab.fit.in_brief import Brief, in_brief, in_lines, more_in_words
from ipmclab.fit.rows import KNOWN, Row, known_rows, parameter_rows
from ipmclab.fit.verdict import REFUSED, lacks_something, verdict

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit

IN_PYTHON: Final = "see fit.findings"
"""Where the findings stand that a short answer does not say, for who has the fit itself."""


@dataclass(frozen=True)
class Answer:
    """The short answer of a fit.

    Parameters
    ----------
    parameters : tuple of Row
    known : tuple of Row
        What the readings determine; shown where some parameter is not determined.
    verdict : str
    findings : tuple of Brief
    more : int
        Findings that are not among them.
    known_title : str
        The title of what is known.
    """

    parameters: tuple[Row, ...]
    known: tuple[Row, ...]
    verdict: str
    findings: tuple[Brief, ...]
    more: int
    known_title: str = KNOWN

    @property
    def is_refused(self) -> bool:
        """Whether the fit is of no use: its numbers do not stand in the short answer."""
        return self.verdict.startswith(REFUSED)

    @property
    def rows(self) -> tuple[tuple[Row, ...], tuple[Row, ...]]:
        """The parameters, and what is known where one is not determined; nothing of a fit of no use."""
        if self.is_refused:
            return (), ()
        return self.parameters, () if all(row.determined for row in self.parameters) else self.known

    def __str__(self) -> str:
        return self.text()

    def text(self, where: str = IN_PYTHON) -> str:
        """The answer in lines; ``where`` the other findings stand.

        Sentences and findings have at most 100 columns, a row of the table as many as its names need.
        """
        lines = [] if self.is_refused else _lines(*self.rows, self.known_title)
        lines.append(in_lines(self.verdict))
        lines += [str(one) for one in self.findings]
        if self.is_refused and self.parameters:
            lines.append(f"its values{f' and {self.more} more findings' if self.more else ''}: {where}")
        elif self.more:
            lines.append(more_in_words(self.more, where))
        return "\n".join(lines)


def answer_of(fit: Fit, before: Fit | None = None) -> Answer:
    """The short answer of a fit, without the findings of one that was answered before."""
    outputs = list(dict.fromkeys(name for one in fit.observations for name in one.noise))
    labels = [one.label for one in fit.observations]
    said = [str(one) for one in answer_of(before).findings] if before is not None else []
    findings, more = in_brief(fit.findings, outputs, labels, said=said)
    return Answer(parameter_rows(fit), known_rows(fit), verdict(fit), findings, more, known_title(fit))


def summary_of(fit: Fit, where: str = IN_PYTHON, before: Fit | None = None) -> str:
    """The short answer as text; ``where`` the other findings stand, which fit was answered ``before``."""
    return answer_of(fit, before).text(where)


def known_title(fit: Fit) -> str:
    """The title of what is known: of a model that lacks something, intervals say nothing of what it lacks."""
    return KNOWN + (", if the model holds" if lacks_something(fit) else "")


def _lines(rows: Sequence[Row], known: Sequence[Row], title: str) -> list[str]:
    """The table as lines; what is known is below the parameters in the same columns."""
    remarks = any(row.remark for row in (*rows, *known))
    head = ["parameter", "value", "95 % interval", "unit", *([""] if remarks else [])]

    def cells(row: Row) -> list[str]:
        return [row.name, row.value, row.interval, row.unit, *([row.remark] if remarks else [])]

    table = [head, *map(cells, rows)]
    second = [[title, *[""] * (len(head) - 1)], *map(cells, known)] if known else []
    widths = [max(len(row[column]) for row in (*table, *second)) for column in range(len(head))]

    def line(row: Sequence[str]) -> str:
        name, value, interval, *rest = row
        first = f"{name:<{widths[0]}}  {value:>{widths[1]}}  {interval:>{widths[2]}}"
        return "  ".join([first, *(f"{cell:<{width}}" for cell, width in zip(rest, widths[3:], strict=True))]).rstrip()

    return [line(row) for row in (*table, *second)]
