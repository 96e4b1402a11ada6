"""What is said where something went wrong: what happened, what is safe to do, and a way back."""

from __future__ import annotations

import traceback
from http import HTTPStatus
from typing import TYPE_CHECKING, Final

from ipmclab.errors import IpmclabError
from ipmclab.page.frame import bare

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.requests import Request
    from starlette.responses import Response

_REPORT: Final = "if it comes again, report what the terminal of ipmclab page shows"
_SAFE: Final = "It touches no recording, and STOP and ZERO work."


def fault(error: Exception) -> str:
    """What is said of a fault of the page, and what is safe to do.

    The text of an error that is none of ours may hold paths of the server: it is shown at the terminal alone.
    """
    what = str(error) if isinstance(error, IpmclabError) else type(error).__name__
    return f"This went wrong: {what}. {_SAFE} Reload the page; {_REPORT}."


def report_fault(error: Exception) -> None:
    """Say at the page whose event failed what happened."""
    from nicegui import ui

    traceback.print_exception(error)
    ui.notify(fault(error), type="negative", timeout=0, close_button="Close", multi_line=True)


def add_faults(app: FastAPI) -> None:
    """Answer who opens an address that is none, or that fails, with a page of ours; programs get what they got."""
    from fastapi.exception_handlers import http_exception_handler
    from nicegui import app as forms
    from starlette.exceptions import HTTPException
    from starlette.responses import HTMLResponse, PlainTextResponse

    async def refused(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if not _is_opened(request):
            return await http_exception_handler(request, error)
        known = HTTPStatus(error.status_code).phrase
        what = error.detail if error.detail != known else ""
        if error.status_code == HTTPStatus.NOT_FOUND:
            lines = [f"There is no page {request.url.path}{f': {what}' if what else '.'}"]
        else:
            lines = [f"{request.url.path} was refused: {what or known.lower()}."]
        lines.append("Nothing was changed. A recording continues, and STOP and ZERO work.")
        return HTMLResponse(bare(known, lines), error.status_code, dict(error.headers or {}))

    async def failed(request: Request, error: Exception) -> Response:
        """Its traceback is printed at the terminal by the server, after this."""
        if not _is_opened(request):
            return PlainTextResponse("Internal Server Error", 500)
        return HTMLResponse(bare("Server error", [fault(error)]), 500)

    app.add_exception_handler(HTTPException, refused)
    for one in (app, forms):
        one.add_exception_handler(404, refused)
        one.add_exception_handler(Exception, failed)


def _is_opened(request: Request) -> bool:
    """Whether somebody opens it in a browser, so that there must be a page."""
    return request.method == "GET" and "text/html" in request.headers.get("accept", "")
