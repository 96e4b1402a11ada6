"""The figure of a sweep as a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ipmclab.reporting.figures.sweep import sweep_figure
from ipmclab.reporting.save import save_figure

if TYPE_CHECKING:
    from ipmclab.sweep import Swept


def plot_sweep(swept: Swept, path: str | Path, *, overwrite: bool = False) -> Path:
    """Draw a sweep: indices or effects of its parameters, and its metrics against those that matter most.

    Parameters
    ----------
    swept : Swept
        What ``run_sweep`` returned.
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
    >>> from ipmclab.sweep import run_sweep
    >>> from ipmclab.sweep.sweep_file import sweep_from_text
    >>> from ipmclab.sweep.template import TEMPLATE
    >>> small = sweep_from_text(TEMPLATE.replace("base = 512", "base = 8"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     swept = run_sweep(small, Path(folder) / "stiffness")
    ...     plot_sweep(swept, Path(folder) / "stiffness.png").name
    'stiffness.png'
    """
    return save_figure(lambda: sweep_figure(swept), path, overwrite=overwrite)
