"""What a foreign record seems to be: how it is written, what its columns mean, and what only its user can know."""

from __future__ import annotations

from ipmclab.store.guess.guess import guess_map as guess_map
from ipmclab.store.guess.question import Guess as Guess
from ipmclab.store.guess.question import Question as Question

__all__ = ["Guess", "Question", "guess_map"]
