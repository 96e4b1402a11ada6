"""Write a figure as a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from ipmclab.destination import replacing
from ipmclab.errors import InputError
from ipmclab.reporting.style import style

FORMATS: Final = (".svg", ".png", ".pdf")

# A date would make another file of the same runs.
_METADATA: Final[dict[str, dict[str, None]]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": {}}


def save_figure(figure: Figure | Callable[[], Figure], path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a figure; the suffix says how.

    Parameters
    ----------
    figure : Figure, or a function that draws one
        A function is only called when the file may be written.
    path : str or Path
        Ending in .svg, .png or .pdf.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        Another suffix, a folder that does not exist, or a file that does.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_figure(Figure(figsize=(1, 1)), Path(folder) / "empty.png").name
    'empty.png'
    """
    target = Path(path)
    kind = target.suffix.lower()
    if kind not in FORMATS:
        raise InputError(
            f"a figure cannot be written as {target.suffix!r}",
            code="bad-suffix",
            where=str(path),
            repair=f"end the name in one of {', '.join(FORMATS)}",
        )
    with replacing(target, overwrite=overwrite) as part, style():
        drawn = figure if isinstance(figure, Figure) else figure()
        drawn.savefig(part, format=kind[1:], metadata=_METADATA[kind])
    return target
