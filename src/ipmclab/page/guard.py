"""Who may speak with the page: what is asked is looked at before anything of the page sees it.

A page of somebody else in the same browser could send requests here, and by a trick with names (DNS rebinding) even
read the answers. So every request and every WebSocket must name this host, and come from a page of this origin.
Answers forbid that others frame this page and that it loads anything from elsewhere.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any, Final
from urllib.parse import urlsplit

from ipmclab.page.login import MOST_FORM, Door, Passes, Refused
from ipmclab.page.settings import MOST_BYTES, Settings, bracketed

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

SEAT: Final = "ipmclab-seat"
"""Cookie that distinguishes one browser from another: who holds the bench. Browsers have it with the port behind its
name, since they do not distinguish the servers of a host; the application has it without."""

PASS: Final = "ipmclab-pass"
"""Cookie of a browser that knew the token, with the port behind its name."""

_POLICY: Final = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; frame-ancestors 'self'; base-uri 'none'; "
    "form-action 'self'"
)

_HEADERS: Final = (
    (b"content-security-policy", _POLICY.encode()),
    (b"x-frame-options", b"SAMEORIGIN"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),  # under no-referrer our own form comes with Origin: null
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)

_TOO_LARGE: Final = f"413: a request has at most {MOST_BYTES // 2**20} MB\n"

_MOST_UNCLAIMED: Final = 32
_HTML: Final = "text/html; charset=utf-8"

_LOGIN: Final = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>ipmclab</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>
body {{ font: 16px system-ui, sans-serif; max-width: 26rem; margin: 15vh auto; padding: 0 1rem }}
input, button {{ font: inherit; padding: .5rem; width: 100%; box-sizing: border-box; margin-top: .5rem }}
</style></head><body><main><h1>ipmclab</h1><form method="post" action="/login">
<label for="token">The token of this page</label>
<input id="token" name="token" type="password" autocomplete="current-password" required autofocus>
<button>Enter</button><p role="alert">{message}</p></form></main></body></html>"""


class Guard:
    """An ASGI application in front of another.

    Parameters
    ----------
    app : ASGI application
    settings : Settings
    port : int
        Where it really listens.
    """

    def __init__(self, app: App, settings: Settings, port: int) -> None:
        self.app = app
        self._door = None if settings.token is None else Door(settings.token)
        self._unclaimed: dict[tuple[str, str], str] = {}
        self._seat, self._pass = f"{SEAT}-{port}", f"{PASS}-{port}"
        scheme, usual = ("http", 80) if settings.certificate is None else ("https", 443)
        names = {"127.0.0.1", "localhost", "[::1]", bracketed(settings.host)} if settings.is_local else set()
        hosts = {name if port == usual else f"{name}:{port}" for name in names}
        self._origins = {f"{scheme}://{host}" for host in hosts}
        self._hosts = hosts
        if settings.origin is not None:
            parts = urlsplit(settings.origin)
            host = parts.netloc.lower().removesuffix(":443")  # as browsers say it, who leave the port of HTTPS out
            self._hosts.add(host)
            self._origins.add(f"{parts.scheme}://{host}")
        self._secure = "; Secure" if settings.origin is not None or settings.certificate is not None else ""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        refusal = self._refusal(scope, headers)
        if refusal is not None:
            await _refuse(scope, receive, send, refusal)
            return
        cookies = _cookies(headers.get("cookie", ""))
        if self._door is not None:
            known = cookies.get(self._pass, "")
            if not self._door.passes.use(known):
                await self._let_in(self._door, scope, receive, send)
                return
            if scope["type"] == "http" and scope["path"] == "/login":  # a form that was open while another let it in
                await _answer(send, 303, "", extra=[(b"location", b"/")])
                return
            receive = _using(self._door.passes, known, receive)
        self._claim(cookies.get(self._seat, ""))
        asks = scope["type"] == "http" and scope["method"] == "GET"  # nothing else makes a page that has a seat
        seat = self._new_seat(scope, headers) if asks and not cookies.get(self._seat) else None
        # A page that is made now is this browser's already; cookies of other servers are nobody's business.
        cookie = f"{SEAT}={seat or cookies.get(self._seat, '')}".encode("latin-1", "replace")
        scope = {**scope, "headers": [*_without(scope["headers"], b"cookie"), (b"cookie", cookie)]}
        if scope["type"] == "websocket":
            await self.app(scope, receive, send)
            return
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > MOST_BYTES:
            await _answer(send, 413, _TOO_LARGE)
            return
        body = _Body(receive)
        try:
            await self.app(scope, body.receive, self._answering(send, seat, body))
        except _TooLargeError:
            if not body.answered:
                await _answer(send, 413, _TOO_LARGE)
        except Exception:
            if not body.is_gone:
                raise  # else the browser left before its answer, which is no fault

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> str | None:
        """Why a request is refused, None where it is not."""
        host, origin = headers.get("host", ""), headers.get("origin")
        if host.lower() not in self._hosts:
            return f"the host {host!r} is not this page's"
        if origin is not None and origin.lower() not in self._origins:
            return f"a page of {origin!r} may not ask anything here"
        changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if changes and origin is None:
            return "this needs the header Origin"
        site, mode = headers.get("sec-fetch-site", "none"), headers.get("sec-fetch-mode", "")
        place = headers.get("sec-fetch-dest", "document")
        if site not in ("same-origin", "none") and (mode, place) != ("navigate", "document"):
            return "another page may not ask anything here"
        return None

    def _answering(self, send: Send, seat: str | None, body: _Body) -> Send:
        async def answer(message: MutableMapping[str, Any]) -> None:
            if body.is_too_large and not body.answered:
                return  # what the application makes of it; the answer is ours
            body.answered = True
            if message["type"] == "http.response.start":
                kept = list(message.get("headers", []))
                names = {name.lower() for name, _ in kept}
                extra = [one for one in _HEADERS if one[0] not in names]  # an answer may have a stricter policy
                if seat is not None and any(n.lower() == b"content-type" and b"html" in v for n, v in kept):
                    extra.append((b"set-cookie", self._cookie(self._seat, seat, "Lax")))
                message["headers"] = [*kept, *extra]
            await send(message)

        return answer

    def _new_seat(self, scope: Scope, headers: dict[str, str]) -> str:
        """The seat of a browser that has none yet: one for all pages that it opens before it has an answer."""
        who = (str((scope.get("client") or ("",))[0]), headers.get("user-agent", ""))
        while len(self._unclaimed) >= _MOST_UNCLAIMED and who not in self._unclaimed:
            del self._unclaimed[next(iter(self._unclaimed))]
        return self._unclaimed.setdefault(who, secrets.token_urlsafe(16))

    def _claim(self, seat: str) -> None:
        """Take note that a browser has its seat: the next one like it gets another."""
        for who in [who for who, one in self._unclaimed.items() if one == seat]:
            del self._unclaimed[who]

    def _cookie(self, name: str, value: str, same_site: str = "Strict") -> bytes:
        """A seat is Lax: who comes by a foreign link must keep theirs. What changes anything needs our Origin."""
        return f"{name}={value}; Path=/; HttpOnly; SameSite={same_site}{self._secure}".encode()

    async def _let_in(self, door: Door, scope: Scope, receive: Receive, send: Send) -> None:
        """The form for the token, and what comes of it."""
        if scope["type"] == "websocket":
            await _refuse(scope, receive, send, "this needs the token")
            return
        if scope["path"] != "/login" or scope["method"] != "POST":
            # A foreign link that leads here comes without our cookie, and meets this too.
            await _answer(send, 401, _LOGIN.format(message=""), _HTML)
            return
        form, more = b"", True
        while more and len(form) <= MOST_FORM:
            message = await receive()
            form += message.get("body", b"")
            more = message.get("more_body", False)
        known = await door.knock(form) if not more else Refused(413, "This is too long for a token.")
        if isinstance(known, Refused):
            await _answer(send, known.status, _LOGIN.format(message=known.text), _HTML)
            return
        extra = [(b"location", b"/"), (b"set-cookie", self._cookie(self._pass, known))]
        await _answer(send, 303, "", extra=extra)


class _TooLargeError(Exception):
    """More came than a request may have."""


class _Body:
    """What is received, until it is too much: its length may not have been stated."""

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self._seen = 0
        self.is_too_large = False
        self.is_gone = False
        self.answered = False

    async def receive(self) -> MutableMapping[str, Any]:
        """The next piece.

        Raises
        ------
        _TooLargeError
        """
        message = await self._receive()
        self.is_gone = self.is_gone or message["type"] == "http.disconnect"
        self._seen += len(message.get("body", b""))
        if self._seen > MOST_BYTES:
            self.is_too_large = True
            raise _TooLargeError
        return message


def _using(passes: Passes, known: str, receive: Receive) -> Receive:
    """What is received with a pass: a page that stays open keeps it good."""

    async def heard() -> MutableMapping[str, Any]:
        message = await receive()
        passes.use(known)
        return message

    return heard


def _without(headers: Iterable[tuple[bytes, bytes]], name: bytes) -> list[tuple[bytes, bytes]]:
    return [one for one in headers if one[0] != name]


def _cookies(text: str) -> dict[str, str]:
    """Cookies by their names: what another server of this host calls its own, however odd, hides none of ours."""
    pairs = (one.partition("=") for one in text.split(";"))
    return {name.strip(): value.strip() for name, _, value in pairs}


def seat_of(cookies: str) -> str:
    """Whose browser it is, from the header Cookie; empty where it has no seat yet."""
    return _cookies(cookies).get(SEAT, "")


async def _refuse(scope: Scope, receive: Receive, send: Send, why: str) -> None:
    if scope["type"] == "websocket":
        await receive()  # the request to connect; a close before it was accepted is answered with 403
        await send({"type": "websocket.close", "code": 1008})
        return
    await _answer(send, 403, f"403: {why}\n")


async def _answer(
    send: Send,
    status: int,
    text: str,
    kind: str = "text/plain; charset=utf-8",
    extra: list[tuple[bytes, bytes]] | None = None,
) -> None:
    headers = [(b"content-type", kind.encode()), (b"cache-control", b"no-store"), *_HEADERS, *(extra or [])]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": text.encode()})
