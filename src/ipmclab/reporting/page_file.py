"""One self-contained HTML file from a template of this package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ipmclab.destination import replacing
from ipmclab.errors import InputError
from ipmclab.version import __version__


def write_page(page: Callable[[], str], path: str | Path, *, overwrite: bool = False) -> Path:
    """Write the text of a page.

    Parameters
    ----------
    page : function that makes the text
        Only called when the file may be written.
    path : str or Path
        Ending in .html.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        Another suffix, a folder that does not exist, or a file that does.
    """
    target = Path(path)
    if target.suffix.lower() not in (".html", ".htm") and not target.is_dir():
        raise InputError(
            f"a report cannot be written as {target.suffix!r}",
            code="bad-suffix",
            where=str(path),
            repair=f"write for example {target.with_suffix('.html').name}",
        )
    with replacing(target, overwrite=overwrite) as part:
        part.write_text(page(), encoding="utf-8", newline="\n")
    return target


def render(template: str, filters: Mapping[str, Callable[..., Any]] | None = None, **values: Any) -> str:
    """The text of a page: a template of this package with the style, the version and these values."""
    from jinja2 import Environment, StrictUndefined

    folder = files("ipmclab.reporting")
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    environment.filters.update(filters or {})
    css = Markup(folder.joinpath("style.css").read_text("utf-8"))
    text = folder.joinpath(template).read_text("utf-8")
    return environment.from_string(text).render(version=__version__, css=css, **values)
