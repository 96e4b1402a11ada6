"""What a foreign record seems to be: how it is written, what its columns mean, and what only its user can know."""

from __future__ import annotations

from ipmclab.store.guess.guess import Guess as Guess
from ipmclab.store.guess.guess import Question as Question
from ipmclab.store.guess.guess import guess_map as guess_map

__all__ = ["Guess", "Question", "guess_map"]
