"""What an earlier fit of a run says of it: its zeros, its delay, and the parameters that it had for itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ipmclab.errors import InputError
from ipmclab.identification.problem.record import PreparedRun, own_endings, own_values


def fitted_runs(table: Mapping[str, Any] | None) -> dict[str, Mapping[str, Any]]:
    """What a fit table says of each run of its fit, by content hash, with the run's own ``parameters``."""
    found: dict[str, Mapping[str, Any]] = {}
    # The table may have been written by hand.
    for place, entry in enumerate((table or {}).get("runs", ())):
        if not isinstance(entry, Mapping) or "content_sha256" not in entry:
            continue
        values = _values_of_fit(table or {})
        for key in ("noise", "offset", "drift"):
            if not isinstance(entry.get(key, {}), Mapping):
                raise _bad_fit_table(f"runs.{place}.{key}", "a table of outputs")
        own = own_values(values, own_endings(place, str(entry.get("mounting", ""))))
        found[str(entry["content_sha256"])] = {**entry, "parameters": own}
    return found


def _values_of_fit(table: Mapping[str, Any]) -> dict[str, float]:
    """The free parameters of a fit table, which somebody may have edited."""
    values: dict[str, float] = {}
    for place, one in enumerate(table.get("parameters", ())):
        try:
            values[str(one["name"])] = float(one["value"])
        except (KeyError, TypeError, ValueError) as error:
            raise _bad_fit_table(f"parameters.{place}", "a table with a name and a value") from error
    return values


def _bad_fit_table(key: str, wanted: str) -> InputError:
    return InputError(
        f"this is not {wanted}, which the fit wrote there",
        code="bad-fit-table",
        where=f"fit.{key}",
        repair="write the file again with ipmclab identify, or take the whole [fit] table out",
    )


def zeros_of_fit(entry: Mapping[str, Any]) -> dict[str, float]:
    """The sensors' zeros of a run as its fit took them: 0 for an output that the fit read without one."""
    return {**dict.fromkeys(entry.get("noise", {}), 0.0), **entry.get("offset", {})}


def as_read_before(record: PreparedRun, entry: Mapping[str, Any], *, circuit_is_free: bool) -> PreparedRun:
    """A run of an earlier fit, read as that fit read it.

    Its delay belongs to the circuit that was found with it, so a fit that frees the circuit looks for it anew.
    """
    others = {name: zero for name, zero in zeros_of_fit(entry).items() if name not in record.readings}
    drifts = {name: slope for name, slope in entry.get("drift", {}).items() if name not in record.readings}
    delay = None if circuit_is_free or record.run.hold != "unknown" else entry.get("delay")
    return replace(record, known_delay=delay, known_offset=others, known_drift=drifts)
