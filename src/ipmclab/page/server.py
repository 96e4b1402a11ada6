"""The server of the page: binds, guards, and serves the sections, the live link and the files they need."""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import importlib.util
import logging
import os
import socket
import ssl
import traceback
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.faults import add_faults, fault, report_fault
from ipmclab.page.guard import Guard
from ipmclab.page.lab import Lab
from ipmclab.page.settings import Settings, bracketed

if TYPE_CHECKING:
    from fastapi import FastAPI

    from ipmclab.page.context import Context

_STATIC: Final = Path(__file__).parent / "static"
_PING: Final = 20.0
"""How often [s] a WebSocket is asked whether its browser is still there, and how long it may take to answer."""


def serve(lab: Lab, settings: Settings, on_ready: Callable[[str, bool], None]) -> None:
    """Serve the page until it is asked to end.

    Parameters
    ----------
    lab : Lab
    settings : Settings
    on_ready : callable
        Called once it answers, with the address and whether the folder's own port was wanted and is taken.

    Raises
    ------
    InputError
        The address cannot be bound, or the certificate not be used.
    """
    import uvicorn

    check_certificate(settings)
    bound = bind_own(settings, lab.port)
    port = bound.getsockname()[1]
    app = application(lab, settings)
    config = uvicorn.Config(
        Guard(app, settings, port),
        log_level="warning",
        access_log=False,
        server_header=False,
        lifespan="on",
        ws_ping_interval=_PING,
        ws_ping_timeout=_PING,
        ws_max_size=2**20,
        timeout_graceful_shutdown=2,
        ssl_certfile=settings.certificate,
        ssl_keyfile=settings.key,
    )
    server = uvicorn.Server(config)
    logging.getLogger("uvicorn.error").addFilter(lambda record: not (server.should_exit and is_of_the_end(record)))
    scheme = "http" if settings.certificate is None else "https"
    name = bracketed(settings.host)
    address = settings.origin or f"{scheme}://{name}:{port}"

    async def run() -> None:
        serving = asyncio.create_task(server.serve(sockets=[bound]))
        while not server.started and not serving.done():
            await asyncio.sleep(0.02)
        if server.started:
            on_ready(address, settings.port == 0 and port != lab.port)
        await serving

    asyncio.run(run())


def is_of_the_end(record: logging.LogRecord) -> bool:
    """Whether a message of the server is that it gave up a request, as it does when it ends: that is no fault."""
    kind = record.exc_info[0] if record.exc_info else None
    return record.getMessage().startswith("Cancel ") if kind is None else issubclass(kind, asyncio.CancelledError)


def check_certificate(settings: Settings) -> None:
    """Look whether HTTPS can be spoken, where it is wanted.

    Raises
    ------
    InputError
        The files are no certificate and its key, or the key has a password.
    """
    if settings.certificate is None:
        return
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(settings.certificate, settings.key, password=lambda: "")  # never ask at the terminal
    except (OSError, ValueError) as error:  # SSLError is an OSError
        raise InputError(
            f"{settings.certificate} and {settings.key} are no certificate and its key",
            code="bad-certificate",
            where="--certificate",
            repair="give both as PEM, the key without a password",
        ) from error


def bind_own(settings: Settings, port: int) -> socket.socket:
    """The socket that the page listens at: where no port is asked for, the folder's own unless it is taken.

    Raises
    ------
    InputError
        What ``bind`` refuses.
    """
    if settings.port == 0:
        with contextlib.suppress(InputError):
            return bind(replace(settings, port=port))
    return bind(settings)


def bind(settings: Settings) -> socket.socket:
    """The socket that the page listens at.

    Raises
    ------
    InputError
        It is taken, or no address of this computer.
    """
    found: socket.socket | None = None
    try:
        family = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)[0][0]
        found = socket.socket(family)
        # Windows lets others bind it too unless this is asked; elsewhere a restart would have to wait.
        only_us = getattr(socket, "SO_EXCLUSIVEADDRUSE", None)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR if only_us is None else only_us, 1)
        found.bind((settings.host, settings.port))
        found.listen()  # now: two that are bound and not listening yet can have one port
    except (OSError, OverflowError) as error:
        if found is not None:
            found.close()
        raise InputError(
            f"port {settings.port} of {settings.host} cannot be used: {getattr(error, 'strerror', None) or error}",
            code="bad-address",
            where="--port",
            repair="give another port, or 0 for any that is free",
        ) from error
    return found


def application(lab: Lab, settings: Settings) -> FastAPI:
    """The application behind the guard."""
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(lab.laboratory_folder / ".page"))
    from fastapi import FastAPI
    from fastapi.staticfiles import StaticFiles
    from nicegui import ui

    from ipmclab.page import curves, routes
    from ipmclab.page.context import Context
    from ipmclab.page.live import routes as live
    from ipmclab.page.live.bench import Bench
    from ipmclab.page.workshop import Workshop

    lab.forget_halves()
    workshop = Workshop(lab)
    bench = Bench(lab, settings.recorder)
    app = FastAPI(title="ipmclab", docs_url=None, redoc_url=None, openapi_url=None)
    app.include_router(live.routes(bench))
    app.include_router(curves.routes(workshop.curves))
    app.include_router(routes.routes(workshop))
    app.mount("/static", StaticFiles(directory=_STATIC))
    app.mount("/vendor", StaticFiles(directory=vendored()))
    add_sections(Context(workshop, bench))
    add_faults(app)
    ui.run_with(app, title="ipmclab", tailwind=False, show_welcome_message=False, dark=None, reconnect_timeout=10.0)
    app.router.on_startup.append(bench.start)
    app.router.on_shutdown.append(bench.follower.close)
    app.router.on_shutdown.append(workshop.close)
    return app


def vendored() -> Path:
    """The folder of uPlot's script, as the installed distribution has it; its package is not imported.

    Raises
    ------
    IpmclabError
        It is not installed.
    """
    found = importlib.util.find_spec("uplot")
    for folder in (found.submodule_search_locations or []) if found is not None else []:
        static = Path(folder) / "static"
        if (static / "uPlot.iife.js").is_file():
            return static
    raise IpmclabError(
        "uPlot's script is not installed", code="no-uplot", where="uplot", repair="install ipmclab once more"
    )


def add_sections(context: Context) -> None:
    """The page of each section."""
    from nicegui import ui
    from starlette.responses import RedirectResponse

    from ipmclab.page.frame import SECTIONS

    for name in SECTIONS:
        module = importlib.import_module(f"ipmclab.page.sections.{name}")
        ui.page(f"/{name}")(_page(name, module.build, context))

    @ui.page("/")
    def home() -> RedirectResponse:
        return RedirectResponse("/run")


def _page(
    name: str, build: Callable[[Context], Awaitable[None] | None], context: Context
) -> Callable[[], Awaitable[None]]:
    """The function of a section's page, which NiceGUI calls without arguments."""
    from nicegui import ui

    from ipmclab.page.frame import frame

    async def page() -> None:
        frame(name)
        ui.on_exception(report_fault)
        try:
            built = build(context)
            if built is not None:
                await built
        except Exception as error:  # whatever it is: the header with STOP and ZERO stays usable
            traceback.print_exc()
            with ui.element("section").classes("lab-card").props("role=alert"):
                ui.label(fault(error)).classes("lab-bad")

    return page
