"""Who is let in: by Host, Origin and token, for requests and for WebSockets alike."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from fastapi import FastAPI, Request, WebSocket
from fastapi.responses import HTMLResponse
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from ipmclab.errors import InputError
from ipmclab.page import guard
from ipmclab.page.guard import PASS, SEAT, Guard
from ipmclab.page.settings import Settings, checked

HERE = "http://127.0.0.1:8000"
TOKEN = "a-token-that-nobody-guesses"


def application() -> FastAPI:
    app = FastAPI()

    @app.get("/page")
    async def page() -> str:
        return "inside"

    @app.post("/bench/zero")
    async def zero(request: Request) -> dict[str, object]:
        return {"seat": guard.seat_of(request.headers.get("cookie", "")), "bytes": len(await request.body())}

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        await socket.accept()
        await socket.send_text("inside")

    @app.websocket("/heard")
    async def heard(socket: WebSocket) -> None:
        await socket.accept()
        async for _ in socket.iter_text():
            await socket.send_text("heard")

    return app


def client(settings: Settings | None = None, base: str = HERE) -> TestClient:
    return TestClient(Guard(application(), settings or Settings(), 8000), base_url=base)


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000", "[::1]:8000", "LOCALHOST:8000"])
def test_this_computer_is_let_in_by_each_of_its_names(host: str) -> None:
    assert client().get("/page", headers={"host": host}).text == '"inside"'


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8000.evil.example", ""])
def test_another_name_of_the_host_is_refused(host: str) -> None:
    answer = client().get("/page", headers={"host": host})
    assert answer.status_code == 403
    assert "inside" not in answer.text


@pytest.mark.parametrize("origin", ["http://evil.example", "https://127.0.0.1:8000", "http://127.0.0.1:9", "null"])
def test_a_page_of_another_origin_is_refused(origin: str) -> None:
    here = client()
    assert here.get("/page", headers={"origin": origin}).status_code == 403
    assert here.post("/bench/zero", headers={"origin": origin}).status_code == 403
    with pytest.raises(WebSocketDisconnect), here.websocket_connect("/live", headers={"origin": origin}):
        pass


def test_what_changes_something_must_say_where_it_comes_from() -> None:
    here = client()
    assert here.post("/bench/zero").status_code == 403
    assert here.post("/bench/zero", headers={"origin": HERE}).status_code == 200
    with pytest.raises(WebSocketDisconnect), here.websocket_connect("/live"):
        pass
    with here.websocket_connect("ws://127.0.0.1:8000/live", headers={"origin": HERE}) as socket:
        assert socket.receive_text() == "inside"


def test_a_picture_in_another_page_is_refused_and_a_link_is_not() -> None:
    here = client()
    foreign = {"sec-fetch-site": "cross-site"}
    assert here.get("/page", headers={**foreign, "sec-fetch-mode": "no-cors"}).status_code == 403
    assert here.get("/page", headers={**foreign, "sec-fetch-mode": "navigate"}).status_code == 200
    framed = {**foreign, "sec-fetch-mode": "navigate", "sec-fetch-dest": "iframe"}
    assert here.get("/page", headers=framed).status_code == 403


def test_a_server_at_another_port_neither_takes_nor_gives_a_seat() -> None:
    """Browsers send the cookies of a host to all its ports."""
    here = client()
    told = f"{SEAT}=spoofed; {SEAT}-9000=theirs; {SEAT}-8000=ours; other=1"
    assert here.post("/bench/zero", headers={"origin": HERE, "cookie": told}).json()["seat"] == "ours"
    told = f"{SEAT}=spoofed; {SEAT}-9000=theirs"
    assert here.post("/bench/zero", headers={"origin": HERE, "cookie": told}).json()["seat"] not in (
        "spoofed",
        "theirs",
    )


@pytest.mark.parametrize("odd", ['settings={"zoom": 1}', "list[0]=1", "no-value", "a b=1", "name=caf\u00e9", 'half="'])
def test_an_odd_cookie_of_another_server_hides_none_of_ours(odd: str) -> None:
    here = client()
    for told in (f"{odd}; {SEAT}-8000=ours", f"{SEAT}-8000=ours; {odd}"):
        cookie = told.encode("latin-1")
        assert here.post("/bench/zero", headers={b"origin": HERE.encode(), b"cookie": cookie}).json()["seat"] == "ours"


@pytest.mark.parametrize(
    "stated", ["https://Lab.Example.ORG", "https://lab.example.org:443", "https://lab.example.org/"]
)
def test_an_origin_is_known_however_it_was_written(stated: str) -> None:
    """Browsers say it in small letters, and leave out the port of HTTPS."""
    said = "https://lab.example.org"
    here = client(Settings(host="0.0.0.0", origin=stated), base=said)
    assert here.post("/bench/zero", headers={"origin": said}).status_code == 200


def test_at_the_usual_port_browsers_do_not_say_it(tmp_path: Path) -> None:
    secure = Settings(certificate=tmp_path, key=tmp_path)
    for port, settings, said in ((80, Settings(), "http://localhost"), (443, secure, "https://127.0.0.1")):
        here = TestClient(Guard(application(), settings, port), base_url=said)
        assert here.post("/bench/zero", headers={"origin": said}).status_code == 200


def test_answers_may_not_be_framed_by_others_and_load_nothing_from_elsewhere() -> None:
    headers = client().get("/page").headers
    assert headers["x-frame-options"] == "SAMEORIGIN"
    policy = dict(part.strip().split(" ", 1) for part in headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'self'"
    assert policy["frame-ancestors"] == "'self'"
    assert not any("http" in allowed or "*" in allowed for allowed in policy.values())


def test_an_answer_may_be_stricter_than_the_page() -> None:
    app = application()

    @app.get("/strict")
    async def strict() -> HTMLResponse:
        return HTMLResponse("", headers={"X-Frame-Options": "DENY"})

    headers = TestClient(Guard(app, Settings(), 8000), base_url=HERE).get("/strict").headers
    assert headers.get_list("x-frame-options") == ["DENY"]
    assert headers.get_list("x-content-type-options") == ["nosniff"]


def test_a_browser_gets_a_seat_of_its_own_which_scripts_cannot_read() -> None:
    app = application()

    @app.get("/html")
    async def html(request: Request):
        return HTMLResponse(guard.seat_of(request.headers.get("cookie", "")))

    first, second = (TestClient(Guard(app, Settings(), 8000), base_url=HERE) for _ in range(2))
    answer = first.get("/html")
    assert "HttpOnly; SameSite=Lax" in answer.headers["set-cookie"]
    assert (
        answer.text == first.cookies[f"{SEAT}-8000"] == first.get("/html").text
    )  # already in the request that made it
    assert second.get("/html").text != answer.text


def test_a_request_is_bounded_whether_it_says_its_length_or_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MOST_BYTES", 1000)
    here = client()
    assert here.post("/bench/zero", content=b"x" * 1000, headers={"origin": HERE}).json()["bytes"] == 1000
    assert here.post("/bench/zero", content=b"x" * 1001, headers={"origin": HERE}).status_code == 413
    for told in ("1001", "-1"):  # refused before anything is received
        assert here.get("/page", headers={"content-length": told}).status_code == 413
    pieces = iter([b"x" * 600, b"x" * 600])  # no length is told
    assert here.post("/bench/zero", content=pieces, headers={"origin": HERE}).status_code == 413


def test_the_token_lets_in_whoever_knows_it() -> None:
    settings = Settings(token=TOKEN)
    here = client(settings)
    assert here.get("/page").status_code == 401
    assert "inside" not in here.get("/page").text
    with pytest.raises(WebSocketDisconnect), here.websocket_connect("/live", headers={"origin": HERE}):
        pass
    elsewhere = here.post("/bench/zero", data={"token": TOKEN}, headers={"origin": HERE})
    assert (elsewhere.status_code, f"{PASS}-8000" in here.cookies) == (401, False)
    refused = here.post("/login", data={"token": "another"}, headers={"origin": HERE})
    assert (refused.status_code, f"{PASS}-8000" in here.cookies) == (401, False)
    answer = here.post("/login", data={"token": TOKEN}, headers={"origin": HERE}, follow_redirects=False)
    # A pass never comes with a link of another page, which a seat does: it must not let a foreign page act.
    assert "HttpOnly; SameSite=Strict" in answer.headers["set-cookie"]
    assert here.get("/page").text == '"inside"'
    assert TOKEN not in here.cookies[f"{PASS}-8000"]
    # A second form, which was open before, leads in too.
    again = here.post("/login", data={"token": TOKEN}, headers={"origin": HERE}, follow_redirects=False)
    assert (again.status_code, again.headers["location"]) == (303, "/")


def test_a_page_that_stays_open_keeps_its_pass_good(monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording of two days is watched over one WebSocket: what comes through it is heard of its browser."""
    now = [0.0]
    here = Guard(application(), Settings(token=TOKEN), 8000)
    assert here._door is not None
    monkeypatch.setattr(here._door.passes, "_clock", lambda: now[0])
    browser = TestClient(here, base_url=HERE)
    browser.post("/login", data={"token": TOKEN}, headers={"origin": HERE}, follow_redirects=False)
    with browser.websocket_connect("ws://127.0.0.1:8000/heard", headers={"origin": HERE}) as socket:
        for hour in range(6, 49, 6):
            now[0] = 3600.0 * hour
            socket.send_text("here I am")
            assert socket.receive_text() == "heard"
    assert browser.get("/page").status_code == 200
    now[0] += 3600.0 * 25
    assert browser.get("/page").status_code == 401


def test_tabs_that_a_browser_opens_at_once_have_one_seat() -> None:
    """None of them has the cookie yet; who comes once it was taken is another browser."""
    app = application()

    @app.get("/html")
    async def html(request: Request):
        return HTMLResponse(guard.seat_of(request.headers.get("cookie", "")))

    here = Guard(app, Settings(), 8000)
    tabs = [TestClient(here, base_url=HERE, headers={"user-agent": "a"}) for _ in range(3)]
    other = TestClient(here, base_url=HERE, headers={"user-agent": "b"})
    first, second = tabs[0].get("/html").text, tabs[1].get("/html").text
    assert first == second == tabs[1].cookies[f"{SEAT}-8000"]
    assert other.get("/html").text != first
    assert tabs[0].get("/html").text == first
    assert tabs[2].get("/html").text not in (first, "")


def test_only_a_page_gives_a_seat_and_only_to_a_browser_without_one() -> None:
    """Who opens another page keeps the seat, and with it the bench; what a page loads brings none."""
    app = application()

    @app.get("/html", response_class=HTMLResponse)
    async def html() -> str:
        return "a page"

    here = TestClient(Guard(app, Settings(), 8000), base_url=HERE)
    assert "set-cookie" not in here.get("/page").headers
    assert "set-cookie" not in here.post("/bench/zero", headers={"origin": HERE}).headers
    assert f"{SEAT}-8000=" in here.get("/html").headers["set-cookie"]
    seat = here.cookies[f"{SEAT}-8000"]
    assert "set-cookie" not in here.get("/html").headers
    assert here.cookies[f"{SEAT}-8000"] == seat
    assert here.post("/bench/zero", headers={"origin": HERE}).json()["seat"] == seat


def test_like_browsers_of_two_computers_have_two_seats() -> None:
    """Also before either has its cookie; the connections of one computer have one."""
    here = Guard(application(), Settings(), 8000)
    computers = [("10.0.0.1", 50001), ("10.0.0.1", 50002), ("10.0.0.2", 50001)]
    for computer in computers:
        TestClient(here, base_url=HERE, client=computer).get("/page")
    assert len(set(here._unclaimed.values())) == len(here._unclaimed) == 2


def test_seats_that_nobody_comes_back_for_are_bounded() -> None:
    here = client()
    for k in range(200):
        assert here.get("/page", headers={"user-agent": str(k)}).status_code == 200
    assert len(here.app._unclaimed) <= 32


def test_elsewhere_it_is_reached_by_its_stated_name_only(tmp_path: Path) -> None:
    settings = Settings(host="0.0.0.0", origin="https://lab.example.org", token=TOKEN)
    here = client(settings, base="https://lab.example.org")
    answer = here.post(
        "/login", data={"token": TOKEN}, headers={"origin": "https://lab.example.org"}, follow_redirects=False
    )
    assert "Secure" in answer.headers["set-cookie"]
    assert here.get("/page").status_code == 200
    assert here.get("/page", headers={"host": "127.0.0.1:8000"}).status_code == 403


@pytest.mark.parametrize(
    ("settings", "proxy", "told"),
    [
        (Settings(host="0.0.0.0"), False, "--token-file"),
        (Settings(host="192.168.1.7", token=TOKEN), False, "--origin"),
        (Settings(host="0.0.0.0", token=TOKEN, origin="https://lab.example.org"), False, "--certificate"),
        (Settings(host="0.0.0.0", token=TOKEN, origin="http://lab.example.org"), True, "https://"),
        (Settings(host="0.0.0.0", token="short", origin="https://lab.example.org"), True, "16"),
        (Settings(origin="https://lab.example.org", certificate=Path("c"), key=Path("k")), False, "--token-file"),
        (Settings(origin="https://lab.example.org", token=TOKEN), False, "--proxy"),
        (Settings(origin="https://["), False, "https://NAME"),
        (Settings(origin="https://lab.example.org:x"), False, "https://NAME"),
        (Settings(host="127.0.0.1"), True, "--token-file"),
        (Settings(certificate=Path("c.pem")), False, "--key"),
    ],
)
def test_an_address_that_others_reach_needs_token_and_https(settings: Settings, proxy: bool, told: str) -> None:
    with pytest.raises(InputError, match=told):
        checked(settings, proxy=proxy)


def test_loopback_needs_nothing_and_a_proxy_only_what_it_states() -> None:
    for host in ("127.0.0.1", "localhost", "::1", "127.8.8.8"):
        assert checked(Settings(host=host), proxy=False).host == host
    with pytest.raises(InputError, match="others reach lab"):  # a name may be anybody's
        checked(Settings(host="lab"), proxy=False)
    stated = Settings(token=TOKEN, origin="https://lab.example.org")
    assert checked(stated, proxy=True) is stated


def test_a_browser_that_leaves_before_its_answer_is_no_fault() -> None:
    """What an application makes of it ends at the guard; any other fault does not."""

    async def impatient(scope, receive, send) -> None:
        assert (await receive())["type"] == kind
        raise RuntimeError("No response returned.")

    async def receive() -> dict[str, object]:
        return {"type": kind}

    async def send(message: object) -> None:
        raise AssertionError("nobody is there")

    scope = {"type": "http", "method": "GET", "path": "/", "headers": [(b"host", b"127.0.0.1:8000")]}
    kind = "http.disconnect"
    asyncio.run(Guard(impatient, Settings(), 8000)(scope, receive, send))
    kind = "http.request"
    with pytest.raises(RuntimeError):
        asyncio.run(Guard(impatient, Settings(), 8000)(scope, receive, send))


def test_too_much_after_the_answer_began_is_no_second_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "MOST_BYTES", 3)
    sent: list[str] = []

    async def hasty(scope, receive, send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await receive()

    async def receive() -> dict[str, object]:
        return {"type": "http.request", "body": b"four"}

    async def send(message) -> None:
        sent.append(message["type"])

    scope = {"type": "http", "method": "GET", "path": "/", "headers": [(b"host", b"127.0.0.1:8000")]}
    asyncio.run(Guard(hasty, Settings(), 8000)(scope, receive, send))
    assert sent == ["http.response.start"]
