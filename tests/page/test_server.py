"""The server of the page: where it binds, what it serves, what it does not import."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from ipmclab.cli.app import run
from ipmclab.cli.page import _token
from ipmclab.errors import InputError
from ipmclab.page.faults import add_faults
from ipmclab.page.lab import Lab
from ipmclab.page.server import bind, bind_own, vendored
from ipmclab.page.settings import Settings
from tests.waiting import HANGS


def test_it_binds_this_computer_only_unless_told_otherwise() -> None:
    with bind(Settings()) as bound:
        assert bound.getsockname()[0] == "127.0.0.1"
        with pytest.raises(InputError, match="cannot be used") as refused:
            bind(Settings(port=bound.getsockname()[1]))
        assert "another port" in refused.value.repair


def test_a_folder_has_its_own_port_unless_somebody_has_taken_it(tmp_path: Path) -> None:
    """Begun anew the page stands where it stood: what is open in a browser finds it, with what the browser has kept."""
    lab = Lab.open(tmp_path)
    with bind_own(Settings(), lab.port) as first:
        assert first.getsockname()[1] == Lab.open(tmp_path).port
        with bind_own(Settings(), lab.port) as second:
            assert second.getsockname()[1] != lab.port
    with bind(Settings()) as other, pytest.raises(InputError, match="cannot be used"):
        bind_own(Settings(port=other.getsockname()[1]), lab.port)  # one that was asked for is never another


def test_where_others_could_bind_it_too_they_are_kept_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only Windows has the option: another one that can be read back stands for it here."""
    if not hasattr(socket, "SO_EXCLUSIVEADDRUSE"):
        monkeypatch.setattr(socket, "SO_EXCLUSIVEADDRUSE", socket.SO_KEEPALIVE, raising=False)
    with bind(Settings()) as bound:
        assert bound.getsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE)
        assert not bound.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR)


def test_a_fault_of_the_server_says_what_happened_and_what_is_safe(capsys) -> None:
    app = FastAPI()
    add_faults(app)

    @app.get("/odd")
    def odd() -> None:
        raise ValueError("<b>something</b> odd")

    client = TestClient(app, raise_server_exceptions=False)
    answer = client.get("/odd", headers={"accept": "text/html,*/*"})
    assert answer.status_code == 500
    assert "something" not in answer.text  # it may name files of the server: it is for the terminal
    for told in ("This went wrong: ValueError.", "It touches no recording", 'id="lab-zero"', 'href="/run"'):
        assert told in answer.text
    assert client.get("/odd").text == "Internal Server Error"
    refused = client.post("/odd", headers={"accept": "text/html"})
    assert (refused.status_code, refused.json()) == (405, {"detail": "Method Not Allowed"})


def test_a_token_is_what_stands_in_its_file_whatever_wrote_it(tmp_path: Path) -> None:
    """Some editors put a mark before the text, and a line's end behind it."""
    (tmp_path / "token.txt").write_bytes(b"\xef\xbb\xbfa-token-that-nobody-guesses\r\n")
    assert _token(tmp_path / "token.txt") == "a-token-that-nobody-guesses"


def test_the_script_of_the_plots_is_there_without_its_package() -> None:
    assert (vendored() / "uPlot.iife.js").stat().st_size > 10_000
    assert "uplot" not in sys.modules


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["nowhere"], "no such folder"),
        (["--host", "0.0.0.0"], "--token-file"),
        (["--port", "70000"], "no port 70000"),
        (["--token-file", "none.txt"], "no such file"),
        (["--origin", "lab.example.org"], "https://"),
        (["--certificate", "junk.pem", "--key", "junk.pem"], "no certificate and its key"),
        (["--token-file", "junk.pem"], "cannot be read"),
    ],
)
def test_bad_options_are_refused(options: list[str], told: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "junk.pem").write_bytes(b"\xffjunk")
    assert run(["page", "--no-open", *options]) == 2
    assert told in capsys.readouterr().err


def address_of(server: subprocess.Popen[str]) -> str:
    """Where a page that was begun with ``--json`` says that it is."""
    assert server.stdout is not None
    text = ""
    while "}" not in text and (line := server.stdout.readline()):
        text += line
    return str(json.loads(text)["address"])


def test_a_page_that_ends_within_a_request_says_no_fault(tmp_path: Path) -> None:
    """An upload that hangs is given up: nothing went wrong, and there is no traceback at the terminal."""
    command = [sys.executable, "-m", "ipmclab", "page", str(tmp_path), "--no-open", "--json"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    address = address_of(server)
    host = address.removeprefix("http://")
    head = ("POST /uploads HTTP/1.1", f"Host: {host}", f"Origin: {address}", "Content-Length: 100000")
    kind = "Content-Type: multipart/form-data; boundary=x"
    with socket.create_connection(("127.0.0.1", int(host.rpartition(":")[2]))) as upload:
        upload.sendall("\r\n".join([*head, kind, "", "--x\r\n"]).encode())
        with urllib.request.urlopen(f"{address}/run") as answer:  # it has the other request by then
            assert answer.status == 200
        server.terminate()
        assert server.communicate(timeout=HANGS)[1] == ""


def test_a_served_page_is_guarded_and_small(tmp_path: Path) -> None:
    """The real server, as a foreign page, a foreign name and a curious path meet it."""
    folder = tmp_path / "lab"
    folder.mkdir()
    (tmp_path / "secret.txt").write_text("secret")
    command = [sys.executable, "-X", "importtime", "-m", "ipmclab", "page", str(folder), "--no-open", "--json"]
    with (tmp_path / "imports").open("w") as imports, bind_own(Settings(), Lab.open(folder).port):
        server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=imports, text=True)
        address = address_of(server)
    try:
        port = int(address.rpartition(":")[2])

        def get(path: str, **headers: str) -> tuple[int, str]:
            asked = urllib.request.Request(address + path, headers=headers)
            try:
                with urllib.request.urlopen(asked) as answer:
                    return answer.status, answer.read().decode(errors="replace")
            except urllib.error.HTTPError as error:
                return error.code, error.read().decode(errors="replace")

        for section in ("run", "runs", "identify", "simulate", "report"):
            status, body = get(f"/{section}")
            assert status == 200
            assert 'id="lab-zero"' in body
        for path in ("/nowhere", "/reports/none.html", "/static/none.js", "/a/b/<script>alert(1)</script>"):
            status, body = get(path, Accept="text/html")
            assert status == 404
            assert 'id="lab-zero"' in body  # a page of ours, with its header
            assert "Nothing was changed" in body
            assert "<script>alert" not in body
            assert "<html" not in get(path)[1]  # no program asked for a page
        assert get("/run", Host="evil.example")[0] == 403
        assert get("/run", Origin="http://evil.example")[0] == 403
        for path in ("/static/../server.py", "/static/%2e%2e/server.py", "/vendor/..%2f..%2f__init__.py"):
            assert get(path)[0] in (400, 403, 404)
        for path in ("/../secret.txt", "/static/%2e%2e/%2e%2e/%2e%2e/secret.txt", "/docs", "/openapi.json"):
            assert get(path)[1] != "secret"
            assert get(path)[0] != 200
        asked = (
            "GET /live HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        )
        asked += "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        here = f"127.0.0.1:{port}"
        answers = {}
        for host, origin in ((here, address), (here, "http://evil.example"), ("evil.example", "http://evil.example")):
            for path in ("/live", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"):
                with socket.create_connection(("127.0.0.1", port)) as link:
                    link.sendall(asked.replace("/live", path).format(host=host, origin=origin).encode())
                    answers[host, origin, path] = int(link.recv(100).split()[1])
        assert {status for (_, origin, _), status in answers.items() if origin == address} == {101}
        assert {status for (_, origin, _), status in answers.items() if origin != address} == {403}
    finally:
        server.terminate()
        server.communicate(timeout=180)
    assert f"port {Lab.open(folder).port} of this folder is taken" in (tmp_path / "imports").read_text()
    loaded = {line.rpartition("|")[2].strip() for line in (tmp_path / "imports").read_text().splitlines()}
    assert "nicegui" in loaded
    assert not {"numba", "llvmlite", "scipy.optimize", "matplotlib", "pandas", "IPython"} & loaded
