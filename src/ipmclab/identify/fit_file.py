"""A fit on disk: an actuator's file with a ``[fit]`` table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ipmclab.errors import InputError
from ipmclab.identify.fit import Direction, Fit, FittedParameter
from ipmclab.identify.noise.model import NoiseModel
from ipmclab.identify.observation import Observation
from ipmclab.model import load_actuator, write_actuator
from ipmclab.run import Finding


def write_fit(fit: Fit, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a fit as an actuator's file with a ``[fit]`` table, which ``simulate`` accepts.

    Parameters
    ----------
    fit : Fit
    path : str or Path
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        The file exists, or cannot be written.
    """
    write_actuator(fit.actuator, path, overwrite=overwrite)


def read_fit(path: str | Path) -> Fit:
    """Read a fit that ``write_fit`` wrote. Residuals are not kept: they follow from the runs.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    fit : Fit

    Raises
    ------
    InputError
        No such file, no actuator, or an actuator without a fit.

    Examples
    --------
    >>> read_fit("friend-2")
    Traceback (most recent call last):
    ipmclab.errors.InputError: friend-2: this actuator was not fitted: it has no [fit] table; ...
    """
    actuator = load_actuator(path)
    table = actuator.fit_table
    if table is None:
        raise InputError(
            "this actuator was not fitted: it has no [fit] table",
            code="not-a-fit",
            where=str(path),
            repair="give a file that identify wrote",
        )
    try:
        return Fit(
            actuator=actuator,
            parameters={entry["name"]: _parameter(entry) for entry in table["parameters"]},
            undetermined=tuple(_direction(entry) for entry in table["undetermined"]),
            correlations=_correlations(table),
            rank=table["rank"],
            singular_values=tuple(table["singular_values"]),
            observations=tuple(_observation(entry) for entry in table["runs"]),
            findings=tuple(_finding(entry) for entry in table["findings"]),
            converged=table["converged"],
            message=table["message"],
            evaluations=table["evaluations"],
            software_version=table["software_version"],
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"the [fit] table is not one that identify writes ({type(error).__name__}: {error})",
            code="bad-fit",
            where=str(path),
            repair="identify again, or delete the table to use the file as a plain actuator",
        ) from error


def _direction(entry: Mapping[str, Any]) -> Direction:
    return Direction(**{**entry, "cures": tuple(entry.get("cures", ()))})


def _parameter(entry: Mapping[str, Any]) -> FittedParameter:
    given = {key: entry[key] for key in ("interval", "prior") if key in entry}
    pairs = {key: (float(first), float(second)) for key, (first, second) in given.items()}
    return FittedParameter(**{**entry, **pairs})


def _observation(entry: Mapping[str, Any]) -> Observation:
    noise = {output: NoiseModel.from_table(table) for output, table in entry.get("noise_model", {}).items()}
    return Observation(**{**entry, "noise_model": noise})


def _correlations(table: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    names = [entry["name"] for entry in table["parameters"]]
    rows = table["correlations"]
    if len(rows) != len(names) or any(len(row) != len(names) for row in rows):
        raise ValueError("the correlations are not one row and column for each parameter")
    if not all(math.isnan(value) or -1.0 <= value <= 1.0 for row in rows for value in row):
        raise ValueError("a correlation lies outside -1 to 1")
    return {a: dict(zip(names, map(float, row), strict=True)) for a, row in zip(names, rows, strict=True)}


def _finding(entry: Mapping[str, Any]) -> Finding:
    samples = tuple((int(first), int(stop)) for first, stop in entry["samples"])
    return Finding(**{**entry, "channel": entry["channel"] or None, "samples": samples})
