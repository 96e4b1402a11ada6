"""A run as a MATLAB file (version 5, which every MATLAB opens): one column vector for each array."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ipmclab.run import Run
from ipmclab.store.document import flat_attributes, from_document
from ipmclab.store.exports.table import unit_of
from ipmclab.store.importers.columns import open_error


def write(run: Run, document: str, path: Path) -> None:
    """Write the vectors, their units, the metadata as texts, and the whole of them as ``metadata_json``."""
    import scipy.io

    units = {name: unit_of(name) for name in run.arrays if not name.endswith("_quality")}
    scipy.io.savemat(
        path,
        {
            **run.arrays,
            "units": units,
            "metadata": flat_attributes(run),
            "metadata_json": document,
        },
        appendmat=False,
        long_field_names=True,
        do_compression=True,
        oned_as="column",
    )


def read_back(path: Path) -> Run | None:
    """The run of our own export; None for another MATLAB file."""
    import scipy.io

    with path.open("rb") as stream:
        if b"MATLAB 7.3" in stream.read(128):
            return None
    try:
        names = [name for name, _, _ in scipy.io.whosmat(str(path), appendmat=False)]
        if "metadata_json" not in names:
            return None
        content = scipy.io.loadmat(
            str(path), appendmat=False, variable_names=[n for n in names if n not in ("units", "metadata")]
        )
        document = str(content.pop("metadata_json").item())
        arrays = {name: np.ravel(values) for name, values in content.items() if not name.startswith("__")}
    except Exception as error:  # a damaged file raises whatever SciPy stumbles over
        raise open_error(path, error, "a MATLAB file") from error
    return from_document(document, arrays, where=str(path))
