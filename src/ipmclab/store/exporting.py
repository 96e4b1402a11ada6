"""A run as a file of another program."""

from __future__ import annotations

import os
from pathlib import Path

from ipmclab.destination import replacing
from ipmclab.kinds import tell_kinds
from ipmclab.run import Run
from ipmclab.store.document import checked, to_document
from ipmclab.store.exports.formats import format_of


@tell_kinds
def export_run(run: Run, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write a run as a text table, an Excel workbook or a MATLAB file, by the ending of its name.

    All numbers are in SI units with all their digits; ``import_run`` without a map gives the same run back.

    Parameters
    ----------
    run : Run
    path : str or path
        A name that ends in ``.csv``, ``.xlsx`` or ``.mat``, in a folder that exists.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        Another ending, no such folder, an existing file, or more rows than a sheet holds.
    IpmclabError
        The system refuses to write there.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> run = Run.from_arrays(time=[0.0, 0.02, 0.04], voltage=[0.0, 1.0, 1.0], current=[0.0, 0.06, 0.05])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "step.csv"
    ...     export_run(run, file)
    ...     print(*file.read_text().splitlines()[-4:], sep="\\n")
    time (s),voltage (V),current (A)
    0.0,0.0,0.0
    0.02,1.0,0.06
    0.04,1.0,0.05
    """
    target = Path(path)
    chosen = format_of(target)
    run = checked(run)
    with replacing(target, overwrite=overwrite) as temporary:
        chosen.write(run, to_document(run), temporary)
