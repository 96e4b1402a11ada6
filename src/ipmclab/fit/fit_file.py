"""A fit on disk: an actuator's file with a ``[fit]`` table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ipmclab.errors import InputError
from ipmclab.fit.fit import Direction, Fit, FittedParameter
from ipmclab.fit.fit_table_check import BadTable, check_fit_table
from ipmclab.fit.known import Known
from ipmclab.fit.left_out import LeftOut
from ipmclab.fit.mountings import Mountings
from ipmclab.fit.observation import Observation
from ipmclab.fit.output_diagnosis import OutputDiagnosis
from ipmclab.fit.practical import Practical
from ipmclab.fit.profile import Profile
from ipmclab.fit.row_marks import RowMarks
from ipmclab.fit.unmodelled import Unmodelled
from ipmclab.kinds import tell_kinds
from ipmclab.model import Actuator, load_actuator, write_actuator
from ipmclab.run import Finding
from ipmclab.statespace.noise_model import NoiseModel
from ipmclab.strip_state.run_state import RunState


@tell_kinds
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


@tell_kinds
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
    return fit_of(load_actuator(path), where=str(path))


def fit_of(actuator: Actuator, *, where: str) -> Fit:
    """The fit that an actuator carries; ``where`` is what messages name.

    Raises
    ------
    InputError
        An actuator without a fit, or with a table that no fit wrote.
    """
    table = actuator.fit_table
    if table is None:
        raise InputError(
            "this actuator was not fitted: it has no [fit] table",
            code="not-a-fit",
            where=where,
            repair="give a file that identify wrote",
        )
    try:
        check_fit_table(table, actuator)
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
            covariance=_covariance(table["covariance"]),
            mountings=Mountings.from_table(table["mountings"]) if "mountings" in table else None,
            left_out=tuple(LeftOut.from_table(entry) for entry in table.get("left_out", ())),
            diagnoses=tuple(OutputDiagnosis.from_table(entry) for entry in table.get("diagnoses", ())),
            known=tuple(Known.from_table(entry) for entry in table.get("known", ())),
            procedure=table.get("procedure"),
            practical=Practical.from_table(table["practical"]) if "practical" in table else None,
            profiles={name: Profile.from_table(entry) for name, entry in table.get("profiles", {}).items()},
            unmodelled={name: Unmodelled.from_table(entry) for name, entry in table.get("unmodelled", {}).items()},
        )
    except BadTable as error:
        raise _bad_fit(error.what, f"{where}: {error.key}") from error
    except KeyError as error:
        raise _bad_fit(f"{error} is missing", where) from error
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _bad_fit(str(error), where) from error


def _bad_fit(what: str, where: str) -> InputError:
    return InputError(
        f"the [fit] table is not one that identify writes: {what}",
        code="bad-fit",
        where=where,
        repair="identify again, or delete the table to use the file as a plain actuator",
    )


def _direction(entry: Mapping[str, Any]) -> Direction:
    return Direction(**{**entry, "cures": tuple(entry.get("cures", ()))})


def _parameter(entry: Mapping[str, Any]) -> FittedParameter:
    given = {key: entry[key] for key in ("interval", "interval_next_mounting", "prior") if key in entry}
    pairs = {key: (float(first), float(second)) for key, (first, second) in given.items()}
    return FittedParameter(**{**entry, **pairs})


def _observation(entry: Mapping[str, Any]) -> Observation:
    noise = {output: NoiseModel.from_table(table) for output, table in entry.get("noise_model", {}).items()}
    state = RunState.from_table(entry["state"]) if "state" in entry else None
    marks = RowMarks.from_table(entry["marks"]) if "marks" in entry else None
    return Observation(**{**entry, "noise_model": noise, "state": state, "marks": marks})


def _correlations(table: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    names = [entry["name"] for entry in table["parameters"]]
    rows = table["correlations"]
    return {a: dict(zip(names, map(float, row), strict=True)) for a, row in zip(names, rows, strict=True)}


def _covariance(table: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    names, rows = table["names"], table["rows"]
    return {one: dict(zip(names, map(float, row), strict=True)) for one, row in zip(names, rows, strict=True)}


def _finding(entry: Mapping[str, Any]) -> Finding:
    samples = tuple((int(first), int(stop)) for first, stop in entry["samples"])
    return Finding(**{**entry, "channel": entry["channel"] or None, "samples": samples})
