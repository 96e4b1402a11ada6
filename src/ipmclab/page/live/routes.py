"""The live link of a browser: one WebSocket for readings and state, plain POSTs for what steers the bench."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import threading
import time
from concurrent.futures import Future
from typing import Any, Final

import numpy as np
from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import JSONResponse, Response

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.curves import header_name
from ipmclab.page.guard import seat_of
from ipmclab.page.live.bench import Bench
from ipmclab.page.live.view import View
from ipmclab.page.wire import BAD_REQUEST, read_object

TICK: Final = 0.05
"""How often [s] a browser is sent new readings."""

PULSE: Final = 0.25
"""How often [s] it gets numbers and progress."""

ALIVE: Final = 1.0
"""At least so often [s] it hears something, so that it notices a link that is dead."""

PATIENCE: Final = 3.0
"""How long [s] an answer waits for the recorder; what was asked is tried further."""

_SLOW: Final = (
    f"the recorder has not taken it in within {PATIENCE:g} s, and may be driving the output; it is tried further; "
    "switch the amplifier off if in doubt"
)

_MOST_TEXT: Final = 2000
_MOST_QUESTIONS: Final = 1_000_000


def routes(bench: Bench) -> APIRouter:
    """The routes of a bench."""
    router = APIRouter()

    @router.websocket("/live")
    async def live(socket: WebSocket) -> None:
        await socket.accept()
        seat = seat_of(socket.headers.get("cookie", ""))
        view = View()
        bench.seats.come(seat)
        listening = asyncio.create_task(_listen(socket, view))
        try:
            await _send(socket, bench, seat, view, listening)
        except (WebSocketDisconnect, RuntimeError, OSError):
            pass  # it is gone
        except asyncio.CancelledError:
            pass  # the server ends, and this browser did not answer that in time: no fault of anybody's
        finally:
            listening.cancel()
            bench.seats.leave(seat)
            bench.follower.let_answer(bench.seats.operator_is_there)

    @router.post("/bench/{what}")
    async def steer(what: str, request: Request) -> JSONResponse:
        seat = seat_of(request.headers.get("cookie", ""))
        try:
            values = await read_object(request) if what in ("hold", "mark", "answer") else {}
            message = await asyncio.wait_for(asyncio.shield(_begun(bench, seat, what, values)), PATIENCE)
        except TimeoutError:
            return JSONResponse({"message": _SLOW}, 503)
        except IpmclabError as error:
            answer = {**error.as_dict(), "message": f"{error.message}; {error.repair}"}
            status = 400 if error.code == BAD_REQUEST else 409 if error.exit_status == 1 else 422
            return JSONResponse(answer, status)
        except KeyError:
            return JSONResponse({"message": f"the bench cannot be asked for {what!r}"}, 404)
        return JSONResponse({"message": message})

    @router.get("/live/readings")
    async def readings(csv: str = "readings") -> Response:
        text = await asyncio.to_thread(_csv, bench)
        headers = {"content-disposition": f'attachment; filename="{header_name(csv)}.csv"'}
        return Response(text, media_type="text/csv; charset=utf-8", headers=headers)

    return router


def _begun(bench: Bench, seat: str, what: str, values: dict[str, Any]) -> asyncio.Future[str]:
    """Steer in a thread of its own: nothing that others fill delays ZERO, and a recorder that hangs delays nobody."""
    future: Future[str] = Future()
    future.set_running_or_notify_cancel()

    def steer() -> None:
        try:
            future.set_result(_steer(bench, seat, what, values))
        except Exception as error:
            future.set_exception(error)

    threading.Thread(target=steer, name=f"bench {what[:20]}", daemon=True).start()
    return asyncio.wrap_future(future)


def _steer(bench: Bench, seat: str, what: str, values: dict[str, Any]) -> str:
    match what:
        case "hold":
            bench.take(seat, again=values.get("again") is True)
            return "you hold the bench"
        case "release":
            bench.seats.release(seat)
            return "the bench is free"
        case "zero" | "stop" | "abort" | "start":
            return bench.ask(seat, what)
        case "mark":
            return bench.ask(seat, what, text=_text(values.get("text", "")).strip() or "mark")
        case "answer":
            return bench.ask(seat, what, number=_number(values), value=_text(values.get("value", "")))
    raise KeyError(what)


def _number(values: dict[str, Any]) -> int:
    """Which question is answered. What is too long for the recorder would make it hang up on this page."""
    number = values.get("number")
    if type(number) is not int or not 0 <= number < _MOST_QUESTIONS:
        raise InputError(
            f"this answers no question: its number must be a whole one from 0 to {_MOST_QUESTIONS - 1}",
            code=BAD_REQUEST,
            where="bench",
            repair="reload the page",
        )
    return number


def _text(value: object) -> str:
    """A text as it may be written down: bounded."""
    return str(value)[:_MOST_TEXT]


async def _listen(socket: WebSocket, view: View) -> None:
    """What the browser wants to see; ends when it is gone."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            text = await socket.receive_text()
            with contextlib.suppress(ValueError, TypeError, KeyError, RecursionError, OverflowError, AttributeError):
                view.choose(json.loads(text[:_MOST_TEXT]))


async def _send(socket: WebSocket, bench: Bench, seat: str, view: View, listening: asyncio.Task[None]) -> None:
    """Send what is new until the browser is gone. A slow one gets larger pieces, not a queue of small ones."""
    state, sent, pulsed, spoken = bench.follower.state, (-1, -1), (-1, 0.0), 0.0
    while not listening.done():
        now = time.monotonic()
        versions = (state.version, bench.seats.version)
        if versions != sent:
            sent, spoken = versions, now
            await socket.send_text(json.dumps(bench.document(seat), allow_nan=False))
        if now - pulsed[1] >= PULSE and state.pulse != pulsed[0]:
            pulsed, spoken = (state.pulse, now), now
            await socket.send_text(json.dumps(state.readings(), allow_nan=False))
        if (columns := bench.follower.columns) is not None:
            for frame in await view.frames(columns, state.generation, now):
                spoken = now
                await socket.send_bytes(frame)
        if now - spoken >= ALIVE:
            spoken = now
            await socket.send_text('{"kind": "pulse"}')
        bench.follower.let_answer(bench.seats.operator_is_there)
        await asyncio.wait([listening], timeout=TICK)


def _csv(bench: Bench) -> str:
    """The readings that are held, for a table program; the record itself is the run's file."""
    columns = bench.follower.columns
    if columns is None:
        return "time [s]\n"
    time_, values = columns.snapshot()
    from ipmclab.units import CHANNELS

    names = ["time [s]", *(f"{name} [{CHANNELS[name].display_unit}]" for name in values)]
    stream = io.StringIO()
    table = np.column_stack([time_, *(CHANNELS[name].to_display(column) for name, column in values.items())])
    np.savetxt(stream, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return stream.getvalue()
