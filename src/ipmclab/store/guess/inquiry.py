"""What is known of a foreign record so far, what its user was asked, and what was answered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import InputError
from ipmclab.store.guess.headings import Heading
from ipmclab.store.guess.question import Question
from ipmclab.store.guess.readings import Readings
from ipmclab.store.importers.columns import Columns

NONE: Final = "none"
"""The answer to a question about a column that the record lacks."""


@dataclass
class Column:
    """A column of the record: its place, how a map names it, what its heading says, and its readings."""

    place: int
    name: int | str
    heading: Heading
    readings: Readings | None
    """None where its cells are no numbers."""

    @property
    def is_blank(self) -> bool:
        """Whether no cell of it has anything."""
        return self.readings is not None and not self.readings.count


@dataclass
class Inquiry:
    """What is known of a record so far: its import map, and what only its user can know.

    Parameters
    ----------
    path : Path
    answers : dict of str to str
        By the keys of the questions.
    """

    path: Path
    answers: dict[str, str]
    sheets: dict[str, list[tuple[Any, ...]]] = field(default_factory=dict)
    """The cells of a workbook."""
    columns: Columns = field(init=False)
    table: dict[str, Any] = field(default_factory=dict)
    """The import map."""
    used: set[int] = field(default_factory=set)
    """Places of columns of which it is settled what they are."""
    all: list[Column] = field(default_factory=list)
    taken: list[str] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    asked: set[str] = field(default_factory=set)

    def label(self, column: Column) -> str:
        """A column as its user knows it: by its heading, or its number."""
        name = self.columns.names[column.place]
        return repr(name) if name else f"number {column.place}"

    def take(self, text: str) -> None:
        """Say what was taken for what."""
        self.taken.append(text)

    def ask(self, question: Question) -> str:
        """The answer to a question; an empty text where it is still open."""
        self.asked.add(question.key)
        answer = self.answers.get(question.key, "").strip()
        if answer and question.choices and answer not in question.choices:
            raise InputError(
                f"{answer!r} is not one of {', '.join(question.choices)}",
                code="bad-answer",
                where=question.key,
                repair="answer with one of these",
            )
        if not answer:
            self.questions.append(question)
        return answer

    def choose(self, channel: str, among: Sequence[Column], text: str, *, optional: bool) -> Column | None:
        """The column that a user chooses for a channel; None where that is open, or the record lacks it."""
        labels = {str(column.name): column for column in among}
        answer = self.ask(Question(f"channels.{channel}.column", text, (*labels, NONE) if optional else tuple(labels)))
        return labels.get(answer)

    def is_open(self, key: str) -> bool:
        """Whether a question was asked that has no answer."""
        return any(question.key == key for question in self.questions)
