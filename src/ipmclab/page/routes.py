"""Routes of the sections that no form needs: answers to sliders, files to download, reports to look at."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import APIRouter, HTTPException, Query, Request
from fastapi.responses import FileResponse, JSONResponse, Response
from starlette.background import BackgroundTask

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.curves import header_name
from ipmclab.page.elements.file_choice import MOST_BYTES
from ipmclab.page.jobs.jobs import JobCancelled
from ipmclab.page.lab import files_of
from ipmclab.page.lab_runs import MOST_COMPARED, labels
from ipmclab.page.wire import BAD_REQUEST, MEDIA, pack, read_object
from ipmclab.page.workshop import Workshop

if TYPE_CHECKING:
    from collections.abc import Mapping

_PATIENCE: Final = 120.0
"""How long [s] a download may be prepared."""

_ENDS: Final = "the server of the page is being ended"

_EXPORTS: Final = {"csv": "text/csv", "xlsx": "application/vnd.ms-excel", "mat": "application/octet-stream"}
_FIGURES: Final = {"svg": "image/svg+xml", "png": "image/png", "pdf": "application/pdf"}

# A report carries its style and pictures with it; nothing in it may run or reach anybody.
_REPORT_POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox allow-same-origin"


def routes(workshop: Workshop) -> APIRouter:
    """The routes of a workshop."""
    router = APIRouter()
    for add in (_add_simulate, _add_uploads, _add_runs, _add_reports, _add_fits):
        add(router, workshop)
    return router


def _add_simulate(router: APIRouter, workshop: Workshop) -> None:
    """Answers to sliders."""

    @router.post("/simulate", response_model=None)
    async def simulate(request: Request) -> Response:
        try:
            given = await read_object(request)
            arguments = _simulation(workshop, given)
            client = str(given.get("client", ""))[:40]
            task = "bands" if given.get("bands") is True else "simulate"
            job = workshop.jobs.submit(task, arguments, replaces=f"{client} {task}" if client else None)
            frame = await asyncio.wrap_future(job.future)
        except IpmclabError as error:
            return JSONResponse(error.as_dict(), 400 if error.code == BAD_REQUEST else 422)
        except JobCancelled:
            return Response(status_code=204)  # a newer position of the slider took its place
        except asyncio.CancelledError:
            return JSONResponse({"message": _ENDS, "where": "", "repair": ""}, 503)
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError):
            return JSONResponse({"message": "this is no question of the page", "where": "", "repair": "reload it"}, 400)
        return Response(pack(frame.document, frame.arrays), media_type=MEDIA)


def _add_uploads(router: APIRouter, workshop: Workshop) -> None:
    """Files that come from a browser."""

    @router.post("/uploads", response_model=None)
    async def upload(request: Request, name: str = "record") -> Response:
        stem, dot, ending = name.rpartition(".")
        kept = f"{header_name(stem)}.{header_name(ending)}" if dot else header_name(name)  # by its ending it is read
        size = 0
        try:
            with workshop.uploads.receive(kept) as path, path.open("wb") as stream:
                async for piece in request.stream():
                    size += len(piece)
                    if size > MOST_BYTES:
                        raise InputError(
                            f"the file has more than {MOST_BYTES // 2**20} MiB",
                            code="too-large",
                            repair="copy it into the folder of this page",
                        )
                    await asyncio.to_thread(stream.write, piece)
        except InputError as error:
            return JSONResponse({"message": str(error)}, 413 if error.code == "too-large" else 503)
        called = name.replace("\\", "/").rpartition("/")[2][:200]  # by its owner
        return JSONResponse({"key": path.name, "name": called or kept})


def _add_runs(router: APIRouter, workshop: Workshop) -> None:
    """Runs to download: the file, as another format, as a figure."""

    @router.get("/runs/file", response_model=None)
    def run_file(run: str) -> Response:
        return _sent(lambda: workshop.runs.path(run), "application/x-netcdf")

    @router.get("/runs/export", response_model=None)
    async def run_export(run: str, kind: str = "csv") -> Response:
        return await _made(workshop, "export", {"run": [run]}, kind, _EXPORTS)

    @router.get("/runs/figure", response_model=None)
    async def run_figure(run: Annotated[list[str], Query()], kind: str = "svg") -> Response:
        return await _made(workshop, "figure", {"runs": run}, kind, _FIGURES)


def _add_reports(router: APIRouter, workshop: Workshop) -> None:
    """Reports to look at and to download."""

    @router.get("/reports/{name}", response_model=None)
    def report(name: str, save: bool = False) -> Response:
        try:
            path = workshop.lab.path(name)
        except IpmclabError as error:
            raise HTTPException(404, str(error)) from error
        if path.suffix.lower() != ".html" or not path.is_file():
            raise HTTPException(404, "there is no report of this name")
        headers = {"Content-Security-Policy": _REPORT_POLICY, "X-Content-Type-Options": "nosniff"}
        how = "attachment" if save else "inline"
        return FileResponse(
            path, media_type="text/html", headers=headers, filename=path.name, content_disposition_type=how
        )


def _add_fits(router: APIRouter, workshop: Workshop) -> None:
    """Fits to download, and their profiles."""

    @router.get("/fits/{key}", response_model=None)
    def fit(key: str) -> Response:
        card = workshop.fit(key)
        if card is None or not card.file.is_file():
            raise HTTPException(404, "this fit is no longer kept")
        return FileResponse(card.file, media_type="application/toml", filename=f"{header_name(card.asked.name)}.toml")

    @router.get("/fits/{key}/profiles", response_model=None)
    def profiles(key: str, kind: str = "svg") -> Response:
        card = workshop.fit(key)
        part = card.frame.document["profiles"] if card is not None and card.frame is not None else None
        if card is None or part is None or kind not in part["files"]:
            raise HTTPException(404, "there is no such file of this fit")
        name = f"{header_name(card.asked.name)}-profiles.{kind}"
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        return Response(part["files"][kind], media_type={**_EXPORTS, **_FIGURES}[kind], headers=headers)


def _simulation(workshop: Workshop, given: Mapping[str, Any]) -> dict[str, Any]:
    """What a worker is asked for a position of the sliders."""
    arguments: dict[str, Any] = {
        "actuator": workshop.actuator_path(str(given["actuator"])),
        "changes": {str(name): float(value) for name, value in given["changes"].items()},
    }
    if given.get("run"):
        arguments["run"] = str(workshop.runs.path(str(given["run"])))
    else:
        signal = str(given["signal"])[:2000]
        try:
            for name in files_of(signal):
                workshop.lab.path(name)  # no samples from elsewhere
        except InputError as error:
            raise error.at("signal") from error
        arguments |= {
            "signal": signal,
            "folder": str(workshop.lab.root),
            "duration": float(given["duration"]),
            "rate": float(given["rate"]),
        }
    return arguments


async def _made(
    workshop: Workshop, task: str, runs: Mapping[str, list[str]], kind: str, kinds: Mapping[str, str]
) -> Response:
    """Let a worker write a file of some runs, and send it."""
    if kind not in kinds:
        raise HTTPException(404, f"there is no {kind!r} of a run: {', '.join(kinds)}")
    try:
        ((name, keys),) = runs.items()
        if len(keys) > MOST_COMPARED:
            raise HTTPException(422, f"{len(keys)} runs, at most {MOST_COMPARED} fit on a figure")
        paths = [str(workshop.runs.path(key)) for key in keys]
        out = workshop.new_scratch(f".{kind}")
        given: Any = paths[0] if name == "run" else paths
        asked = {name: given, "labels": labels(keys), "out": str(out)}
        job = workshop.jobs.submit(task, asked, title="preparing a download")
        await asyncio.wait_for(asyncio.wrap_future(job.future), _PATIENCE)
    except IpmclabError as error:
        raise HTTPException(404 if error.code == "no-such-file" else 422, str(error)) from error
    except (asyncio.CancelledError, JobCancelled) as error:
        raise HTTPException(503, _ENDS) from error
    except TimeoutError as error:
        workshop.jobs.cancel(job)
        raise HTTPException(503, "the workers are busy: try again when the fit is done") from error
    name = header_name("_".join(labels(keys[:4])))
    gone = BackgroundTask(out.unlink, missing_ok=True)
    return FileResponse(out, media_type=kinds[kind], filename=f"{name}.{kind}", background=gone)


def _sent(find: Any, media: str) -> Response:
    try:
        path: Path = find()
    except IpmclabError as error:
        raise HTTPException(404, str(error)) from error
    return FileResponse(path, media_type=media, filename=path.name)
