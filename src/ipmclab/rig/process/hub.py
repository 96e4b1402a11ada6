"""The place where a recorder meets its clients: several at once, none of which can hold it up."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import secrets
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing import AuthenticationError
from multiprocessing.connection import Connection, Listener, answer_challenge, deliver_challenge
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import IpmclabError
from ipmclab.platform import move_file, write_for_owner_only
from ipmclab.rig.process.messages import LONGEST_REQUEST, REQUESTS, Message, decode, encode

HOST: Final = "127.0.0.1"
SUFFIX: Final = ".recorder"
"""Of the file in the laboratory folder that says where a recorder listens."""

_MOST_CLIENTS: Final = 16
_LONGEST_QUEUE: Final = 2000
"""Messages that a client may be behind; one that is further behind is let go."""

_PASSING: Final = ("block", "air")
"""Messages for those who asked for readings; who comes later does not get them."""

_NEWEST: Final = ("progress", "chamber", "equilibrium")
"""Messages of which who comes later gets the newest only."""

_BLOCKS_BEHIND: Final = 200
"""Messages behind which a client gets no more blocks until it has caught up."""

_LAST_WORDS: Final = 2.0
"""How long [s] the clients have to take the last message."""

OnRequest = Callable[[Message], None]


class _Client:
    """One client: a thread reads what it asks for, another sends it its messages."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.wants_blocks = False
        self.answers = True
        self.queue: queue.Queue[bytes | None] = queue.Queue()
        self.sender = threading.Thread(target=self._send, name="recorder client sender", daemon=True)

    def _send(self) -> None:
        while (payload := self.queue.get()) is not None:
            try:
                self.connection.send_bytes(payload)
            except (OSError, ValueError):
                break
        hang_up(self.connection)


def hang_up(connection: Connection) -> None:
    """End a connection for both sides: to close it is not enough while another thread waits for it."""
    with contextlib.suppress(OSError):
        there = socket.socket(fileno=connection.fileno())
        try:
            there.shutdown(socket.SHUT_RDWR)
        finally:
            there.detach()


def _others_may_steer(file: Path, why: str) -> str:
    return (
        f"other users of this computer may be able to steer this recorder: the rights to {file} could not be left to "
        f"you alone ({why}); keep the laboratory folder where only you can read"
    )


class Hub:
    """Listens on 127.0.0.1, lets in who knows the token, and sends every client the same.

    A client that comes late first gets what happened before, blocks excepted. A client that is slow misses
    blocks; one that is gone is forgotten. Nothing that a client does or leaves undone delays ``tell``.

    Parameters
    ----------
    folder : Path
        Where the file with the address and the token is put, which only its owner can read.
    on_request : callable
        Called with each request, in the thread of the client that made it.
    about : mapping, optional
        What else the file says, for people who look for their recorder.
    """

    def __init__(self, folder: Path, on_request: OnRequest, about: dict[str, Any] | None = None) -> None:
        self._on_request = on_request
        self._token = secrets.token_bytes(32)
        # The token is asked for in a thread of each client: one that never answers must not keep others out.
        self._listener = Listener((HOST, 0), backlog=8)
        self._clients: list[_Client] = []
        self._past: list[Message] = []
        self._lock = threading.Lock()
        self._closed = False
        self.had_clients = threading.Event()
        self.alone_since = time.monotonic()
        self._address = host, port = self._listener.address
        self.file = folder / f"{secrets.token_hex(4)}{SUFFIX}"
        head = {"address": f"{host}:{port}", "token": self._token.hex(), "process": os.getpid(), **(about or {})}
        new = self.file.with_suffix(".new")  # whoever looks for recorders finds a whole file or none
        try:
            open_to_others = write_for_owner_only(new, json.dumps(head) + "\n")
            move_file(new, self.file)
        except OSError:
            self._listener.close()
            raise
        if open_to_others:
            self.tell(Message("note", {"text": _others_may_steer(self.file, open_to_others), "passing": False}))
        self._door = threading.Thread(target=self._accept, name="recorder door", daemon=True)
        self._door.start()

    @property
    def clients(self) -> int:
        """How many are connected now."""
        return len(self._clients)

    @property
    def answerers(self) -> int:
        """How many of them could answer a question: one without a terminal only looks on."""
        return sum(client.answers for client in list(self._clients))

    def tell(self, message: Message) -> None:
        """Send to all clients, at once and without waiting for any."""
        is_block = message.kind in _PASSING
        message = replace(message, at=time.time()) if message.at is None else message
        payload = encode(message)
        with self._lock:
            if not is_block:
                self._remember(message)
            for client in list(self._clients):
                behind = client.queue.qsize()
                if is_block and (not client.wants_blocks or behind > _BLOCKS_BEHIND):
                    continue
                if behind > _LONGEST_QUEUE:
                    self._forget(client)
                    continue
                client.queue.put(payload)

    def _remember(self, message: Message) -> None:
        """Keep a message for who comes later; of some kinds only the newest since anything else was sent."""
        for place in range(len(self._past) - 1, -1, -1):
            if message.kind not in _NEWEST or self._past[place].kind not in _NEWEST:
                break
            if self._past[place].kind == message.kind:
                del self._past[place]
                break
        self._past.append(message)

    def close(self) -> None:
        """Give the clients what is left to say, and leave."""
        with self._lock:
            self._closed = True
            clients = list(self._clients)
            for client in clients:
                client.queue.put(None)
        until = time.monotonic() + _LAST_WORDS
        for client in clients:
            client.sender.join(max(0.0, until - time.monotonic()))
        self.file.unlink(missing_ok=True)
        # A thread that waits at a socket which is closed meanwhile may wait on at the next one of the same number:
        # somebody knocks, so that it goes first.
        with contextlib.suppress(OSError):
            socket.create_connection(self._address, _LAST_WORDS).close()
        self._door.join(_LAST_WORDS)
        with contextlib.suppress(OSError):
            self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                connection = self._listener.accept()
            except OSError:
                return
            if self._closed:
                connection.close()
                return
            with self._lock:
                crowded = len(self._clients) >= _MOST_CLIENTS
            if crowded:
                connection.close()
                continue
            threading.Thread(target=self._serve, args=(connection,), name="recorder client", daemon=True).start()

    def _serve(self, connection: Connection) -> None:
        client = _Client(connection)
        try:
            deliver_challenge(connection, self._token)
            answer_challenge(connection, self._token)
        except (AuthenticationError, OSError, EOFError):
            connection.close()
            return
        with self._lock:
            for message in self._past:
                client.queue.put(encode(message))
            client.sender.start()
            self._clients.append(client)
        self.had_clients.set()
        try:
            while True:
                request = decode(connection.recv_bytes(LONGEST_REQUEST))
                if request.kind == "subscribe":
                    client.wants_blocks = bool(request.values.get("blocks", True))
                    answers = bool(request.values.get("answers", True))
                    if client.answers and not answers:
                        self.alone_since = time.monotonic()
                    client.answers = answers
                elif request.kind in REQUESTS:
                    self._on_request(request)
        except (OSError, EOFError, IpmclabError):
            pass  # it is gone, or speaks another language: the run continues without it
        finally:
            with self._lock:
                self._forget(client)
            client.sender.join()
            connection.close()

    def _forget(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
            if client.answers:
                self.alone_since = time.monotonic()
        client.queue.put(None)
