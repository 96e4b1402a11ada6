"""What an import map is guessed to be, and what only the user of the record can know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ipmclab.errors import InputError
from ipmclab.store.import_map import ImportMap


@dataclass(frozen=True)
class Question:
    """What only the user of a record can know.

    Parameters
    ----------
    key : str
        Its place in the import map, such as ``"channels.current.unit"``.
    text : str
    choices : tuple of str
        What can be answered; empty where any text can.
    example : str
    """

    key: str
    text: str
    choices: tuple[str, ...] = ()
    example: str = ""


@dataclass(frozen=True)
class Guess:
    """What a foreign record seems to be.

    Parameters
    ----------
    table : mapping
        The import map as far as it is known.
    taken : tuple of str
        What was taken for what, in words.
    left_out : tuple of str
        The columns that are no channel.
    questions : tuple of Question
        What cannot be known; none where the map is whole.
    unused : tuple of str
        Keys of the answers that nothing asked for: they changed nothing.
    """

    table: dict[str, Any]
    taken: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    questions: tuple[Question, ...] = ()
    unused: tuple[str, ...] = ()

    @property
    def map(self) -> ImportMap:
        """The import map.

        Raises
        ------
        InputError
            Something is not known yet.
        """
        if self.questions:
            first = self.questions[0]
            raise InputError(
                f"not known: {first.text}", code="open-question", where=first.key, repair="answer it in the import map"
            )
        return ImportMap.from_table(self.table)

    def as_toml(self, title: str) -> str:
        """The import map as a file, with a line for each question that is open."""
        import tomli_w

        asked = "".join(
            f"# {question.key} is not known: {question.text}"
            + (f" ({', '.join(question.choices)})" if question.choices else f" (for example {question.example!r})")
            + "\n"
            for question in self.questions
        )
        text = "".join(f"# {line}\n" for line in (*self.taken, *self.left_out))
        head = f"# {title}: what was found in it. Correct here what is wrong.\n#\n"
        return f"{head}{text}{asked}\n{tomli_w.dumps(self.table)}"
