"""What the other tests of this folder rely on: a page is theirs once it has spoken with its server."""

from __future__ import annotations

import pytest

pytest.importorskip("playwright")

SLOW = (
    "data:text/html,<script>window.did_handshake = false; setTimeout(() => window.did_handshake = true, 300)</script>"
)
"""A page whose server answers late, as one does that has much else to do."""


def test_a_page_is_gone_to_until_its_server_has_answered(open_page) -> None:
    page = open_page(SLOW)
    assert page.evaluate("window.did_handshake")
    page.goto("about:blank")
    page.goto(SLOW)
    assert page.evaluate("window.did_handshake")
