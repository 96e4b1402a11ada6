"""Who gets what an experiment does, and answers its questions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ipmclab.rig.experiments.steps import Question
from ipmclab.rig.process.messages import Message


class Operator(Protocol):
    """The operator, at one terminal or at many clients."""

    def tell(self, message: Message) -> None:
        """Send to all who listen; never waits."""

    def ask(self, question: Question, ended: Callable[[], bool]) -> str:
        """The answer to a question, or any text once ``ended`` says that the experiment has ended meanwhile."""
