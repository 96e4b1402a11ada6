"""The token of the page: how often it can be guessed, and how long a pass is good."""

from __future__ import annotations

import asyncio

import httpx
import pytest
from fastapi import FastAPI

from ipmclab.page import login
from ipmclab.page.guard import Guard
from ipmclab.page.login import MOST_PASSES, MOST_TRYING, PASS_LASTS, Door, Passes, Refused
from ipmclab.page.settings import Settings

TOKEN = "a-token-that-nobody-guesses"
HERE = "http://127.0.0.1:8000"


def statuses(*forms: bytes) -> list[int]:
    """What came of forms that were sent at once."""

    async def knock() -> list[str | Refused]:
        door = Door(TOKEN)
        return await asyncio.gather(*(door.knock(form) for form in forms))

    return [one.status if isinstance(one, Refused) else 303 for one in asyncio.run(knock())]


def test_wrong_tokens_are_looked_at_one_after_another_and_not_too_many_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    at_once, real = 0, asyncio.sleep

    async def sleep(seconds: float) -> None:
        nonlocal at_once
        at_once += 1
        assert at_once == 1
        slept.append(seconds)
        for _ in range(5):
            await real(0)
        at_once -= 1

    monkeypatch.setattr(login.asyncio, "sleep", sleep)
    guesses = [f"token={k}".encode() for k in range(3 * MOST_TRYING)]
    found = statuses(*guesses)
    assert sorted(found) == MOST_TRYING * [401] + 2 * MOST_TRYING * [429]
    assert slept == MOST_TRYING * [1.0]


def test_the_right_token_waits_for_nobody_and_may_hold_any_letter() -> None:
    assert statuses(f"token={TOKEN}".encode()) == [303]

    async def knock() -> str | Refused:
        return await Door("Schlüssel/ß-sechzehn").knock(b"token=Schl%C3%BCssel%2F%C3%9F-sechzehn")

    assert isinstance(asyncio.run(knock()), str)


@pytest.mark.parametrize("form", [b"token=\xff", b"token=%ff", b"token=%ed%a0%80", b"\xed\xa0\x80=1"])
def test_what_is_no_text_is_refused_in_words(form: bytes) -> None:
    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app=Guard(FastAPI(), Settings(token=TOKEN), 8000))
        async with httpx.AsyncClient(transport=transport, base_url=HERE, headers={"origin": HERE}) as client:
            return await client.post("/login", content=form)

    answer = asyncio.run(ask())
    assert answer.status_code == 400
    assert "no form with a token" in answer.text


def test_a_pass_ends_a_day_after_its_browser_was_last_heard_of() -> None:
    now = [0.0]
    passes = Passes(lambda: now[0])
    mine, other = passes.new(), passes.new()
    now[0] = 0.9 * PASS_LASTS
    assert passes.use(mine)
    now[0] = 1.8 * PASS_LASTS
    assert passes.use(mine)
    assert not passes.use(other)
    now[0] = 3.0 * PASS_LASTS
    assert not passes.use(mine)


def test_of_too_many_passes_the_one_not_heard_of_ends() -> None:
    passes = Passes()
    first, second = passes.new(), passes.new()
    for _ in range(MOST_PASSES - 1):
        assert passes.use(first)
        passes.new()
    assert passes.use(first)
    assert not passes.use(second)
