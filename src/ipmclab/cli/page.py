"""``ipmclab page``: the laboratory in a browser."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ipmclab.cli.options import Json
from ipmclab.cli.output import print_json
from ipmclab.cli.record import RECORDER
from ipmclab.errors import InputError

_ELSEWHERE = "port {} of this folder is taken, perhaps by another page of it, so this one is at another"


def page(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="The folder of your experiments, actuators and runs.")
    ] = Path(),
    port: Annotated[
        int, typer.Option(metavar="N", help="Where it listens; 0: the folder's own port, or any that is free.")
    ] = 0,
    open_: Annotated[bool, typer.Option("--open/--no-open", help="Show it in the browser at once.")] = True,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Let other computers reach it; needs the options below.")
    ] = "127.0.0.1",
    token_file: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A file with the token that a browser must know.")
    ] = None,
    origin: Annotated[
        str | None, typer.Option(metavar="URL", help="What browsers elsewhere show in their address line: https://...")
    ] = None,
    certificate: Annotated[Path | None, typer.Option(metavar="FILE", help="Certificate for HTTPS (PEM).")] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE", help="Its key (PEM).")] = None,
    proxy: Annotated[bool, typer.Option("--proxy", help="A proxy in front of it uses HTTPS.")] = False,
    as_json: Json = False,
) -> None:
    """Serve the page of a folder: record, look at runs, identify, simulate, report.

    Only this computer reaches it, unless --host says otherwise. It prints its address; Ctrl-C ends it, and a
    recording that runs continues.

    \b
    ipmclab page
    """
    from ipmclab.page.lab import Lab
    from ipmclab.page.server import serve
    from ipmclab.page.settings import Settings, checked

    for option, file in (("--token-file", token_file), ("--certificate", certificate), ("--key", key)):
        if file is not None and not file.is_file():
            raise InputError("no such file", code="no-such-file", where=f"{option} {file}", repair="check the path")
    if not 0 <= port <= 65535:
        raise InputError(
            f"there is no port {port}", code="out-of-range", where="--port", repair="give 0, or 1024 to 65535"
        )
    settings = Settings(
        host=host,
        port=port,
        origin=origin,
        token=_token(token_file) if token_file is not None else None,
        certificate=certificate,
        key=key,
        recorder=RECORDER,
    )
    lab = Lab.open(folder)

    def tell(address: str, is_elsewhere: bool) -> None:
        if is_elsewhere:
            print(_ELSEWHERE.format(lab.port), file=sys.stderr)
        if as_json:
            print_json({"address": address, "folder": str(lab.root)})
        else:
            print(address, flush=True)
        if open_:
            import webbrowser

            webbrowser.open(address)

    serve(lab, checked(settings, proxy=proxy), tell)


def _token(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig").strip()
    except (OSError, ValueError) as error:
        raise InputError(
            "the token cannot be read", code="bad-token", where=f"--token-file {file}", repair="write it as plain text"
        ) from error
