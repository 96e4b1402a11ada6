"""Questions to the catalogue, and the rows that answer them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ipmclab.store.catalogue.range import Range

if TYPE_CHECKING:
    from sqlalchemy import ColumnElement, Select

STATES: Final = ("recording", "complete", "aborted", "recovered", "damaged", "missing")
"""What may have become of a run. One that no recorder made and whose file is well has none of them."""


@dataclass(frozen=True)
class RunQuery:
    """What to look for; everything given must hold.

    Parameters
    ----------
    sample, mounting : str, optional
    signal : str, optional
        A waveform such as ``"step"``, which may be one of several in sequence.
    amplitude, frequency : Range [V], [Hz], optional
        Of the commanded signal.
    humidity, temperature : Range [percent], [degC], optional
        The mean over the run, or what was noted.
    measured : tuple of str
        Channels, for example ``("force",)``.
    since, until : float [s since 1970], optional
    findings : tuple of str
        Codes.
    state : one of STATES, optional
    purpose : "signal", "baseline", "fingerprint" or "reference", optional
    laboratory : str, optional
        Only runs that have a file there or were last seen there; see ``Catalogue.laboratory``.
    """

    sample: str | None = None
    mounting: str | None = None
    signal: str | None = None
    amplitude: Range | None = None
    frequency: Range | None = None
    humidity: Range | None = None
    temperature: Range | None = None
    measured: tuple[str, ...] = ()
    since: float | None = None
    until: float | None = None
    findings: tuple[str, ...] = ()
    state: str | None = None
    purpose: str | None = None
    laboratory: str | None = None


class CatalogueRow(NamedTuple):
    """One run of the catalogue; numbers in SI units, None where something is not known.

    ``version`` counts the versions of a run, which have its uuid and other metadata, from 1 in the order in which they
    were found; ``state`` is one of STATES or None; ``recorded`` is in s since 1970; ``drive`` is the signal
    without its rests; ``path`` is below ``laboratory``; ``codes`` is None until the run was inspected.
    """

    id: int
    version: int
    uuid: str | None
    content_sha256: str | None
    state: str | None
    state_reason: str | None
    recorded_at: str | None
    recorded: float | None
    rows: int | None
    duration: float | None
    rate: float | None
    origin: str | None
    sample: str | None
    mounting: str | None
    run_number: int | None
    purpose: str | None
    signal: str | None
    drive: str | None
    amplitude: float | None
    frequency: float | None
    channels: str | None
    temperature: float | None
    relative_humidity: float | None
    minutes_out_of_water: float | None
    minutes_in_environment: float | None
    operator: str | None
    rig: str | None
    series_resistance: float | None
    capacitance: float | None
    finding_codes: str | None
    laboratory: str | None
    path: str | None
    problem: str | None

    @property
    def measured(self) -> tuple[str, ...]:
        """The channels of the run, without the voltage."""
        return tuple(name for name in (self.channels or "").split() if name != "voltage")

    @property
    def codes(self) -> tuple[str, ...] | None:
        """The codes of its findings; None when it was not inspected yet."""
        return None if self.finding_codes is None else tuple(self.finding_codes.split())


def select_rows(query: RunQuery) -> Select[Any]:
    """The statement that answers a query, oldest run first."""
    from sqlalchemy import and_, case, func, or_, select

    from ipmclab.store.catalogue.tables import file, run

    state = case(
        (file.c.problem_code.is_not(None), "damaged"),
        (and_(file.c.id.is_(None), func.coalesce(run.c.state, "") != "recording"), "missing"),
        else_=run.c.state,
    )
    columns: dict[str, ColumnElement[Any]] = {name: run.c[name] for name in CatalogueRow._fields if name in run.c}
    columns |= {name: file.c[name] for name in ("laboratory", "path", "problem")}
    columns["state"] = state.label("shown_state")
    earlier = run.alias("earlier")
    before = select(func.count()).where(earlier.c.uuid == run.c.uuid, earlier.c.id < run.c.id).correlate(run)
    columns["version"] = (1 + before.scalar_subquery()).label("version")
    statement = select(*(columns[name] for name in CatalogueRow._fields)).select_from(
        run.outerjoin(file, and_(file.c.run_id == run.c.id, file.c.shown))
    )
    conditions: list[ColumnElement[bool]] = []
    equal = {"sample": query.sample, "mounting": query.mounting, "purpose": query.purpose}
    conditions += [run.c[name] == value for name, value in equal.items() if value is not None]
    between = {
        "amplitude": query.amplitude,
        "frequency": query.frequency,
        "relative_humidity": query.humidity,
        "temperature": query.temperature,
    }
    for name, wanted in between.items():
        if wanted is not None:
            low, high = wanted.bounds
            conditions += [run.c[name] >= low, run.c[name] <= high]
    words = [("signal_words", query.signal)] if query.signal is not None else []
    words += [("channels", channel) for channel in query.measured]
    words += [("finding_codes", code) for code in query.findings]
    conditions += [run.c[name].contains(f" {word} ", autoescape=True) for name, word in words]
    if query.since is not None:
        conditions.append(run.c.recorded >= query.since)
    if query.until is not None:
        conditions.append(run.c.recorded <= query.until)
    if query.state is not None:
        conditions.append(state == query.state)
    if query.laboratory is not None:
        there = file.alias("there")
        here = select(there.c.run_id).where(there.c.laboratory == query.laboratory)
        conditions.append(or_(run.c.home == query.laboratory, run.c.id.in_(here)))
    return statement.where(*conditions).order_by(run.c.recorded.asc().nulls_first(), run.c.id)
