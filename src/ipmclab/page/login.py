"""Who knows the token of the page: attempts one after another, and passes that end."""

from __future__ import annotations

import asyncio
import hmac
import secrets
import time
from collections.abc import Callable
from typing import Final, NamedTuple
from urllib.parse import parse_qs

MOST_FORM: Final = 4096
"""Bytes of a form with a token."""

PASS_LASTS: Final = 24 * 3600.0
"""How long [s] a pass is good after its browser was last heard of."""

MOST_PASSES: Final = 64
MOST_TRYING: Final = 8
"""Tokens that may wait to be looked at."""

PENALTY: Final = 1.0
"""How long [s] a wrong one keeps the others waiting."""


class Passes:
    """What browsers have that knew the token: each until nothing was heard of it for a day.

    Parameters
    ----------
    clock : callable
        Seconds that only grow.

    Examples
    --------
    >>> passes = Passes()
    >>> passes.use(passes.new()), passes.use("another")
    (True, False)
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._heard: dict[str, float] = {}  # the one not heard of for longest is the first

    def new(self) -> str:
        """A pass for one more browser; where there are too many, the one not heard of for longest ends."""
        made = secrets.token_urlsafe(32)
        self._heard[made] = self._clock()
        if len(self._heard) > MOST_PASSES:
            del self._heard[next(iter(self._heard))]
        return made

    def use(self, known: str) -> bool:
        """Whether a pass is good; it then is for a day more."""
        heard = self._heard.pop(known, None)
        if heard is None or self._clock() - heard > PASS_LASTS:
            return False
        self._heard[known] = self._clock()
        return True


class Refused(NamedTuple):
    """Why nobody was let in: the status of HTTP, and words."""

    status: int
    text: str


class Door:
    """Where a token is looked at.

    Parameters
    ----------
    token : str
    """

    def __init__(self, token: str) -> None:
        self.passes = Passes()
        self._token = token
        self._one = asyncio.Lock()
        self._trying = 0

    async def knock(self, form: bytes) -> str | Refused:
        """A pass for who sent this form, or why there is none."""
        try:
            given = parse_qs(form.decode("ascii"), errors="strict").get("token", [""])[0]
        except ValueError:
            return Refused(400, "This is no form with a token.")
        if self._trying >= MOST_TRYING:
            return Refused(429, "Too many are trying to enter: wait a few seconds, then try again.")
        self._trying += 1
        try:
            async with self._one:  # however many guess, it is one a second
                if hmac.compare_digest(given.encode(), self._token.encode()):
                    return self.passes.new()
                await asyncio.sleep(PENALTY)
        finally:
            self._trying -= 1
        return Refused(401, "This is not the token.")
