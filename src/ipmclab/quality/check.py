"""Every check on one record."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from ipmclab.kinds import tell_kinds
from ipmclab.quality.asked import asked_beyond
from ipmclab.quality.at_rest import not_at_rest
from ipmclab.quality.beginning import begins_under_voltage
from ipmclab.quality.contact import missing_contact
from ipmclab.quality.cut_off import cut_off
from ipmclab.quality.drift import before_step
from ipmclab.quality.kept import kept
from ipmclab.quality.kink import RATE_ROWS, rate_jumps
from ipmclab.quality.limits import clipping, possible_range_limit, range_limits
from ipmclab.quality.lost import flagged_rows, lost_readings
from ipmclab.quality.record import GUARD_ROWS, Record
from ipmclab.quality.response import no_excitation, nothing_but_noise, opposite_response
from ipmclab.quality.ringing import measured_ringing, predicted_ringing
from ipmclab.quality.rising import rising_current
from ipmclab.quality.sampling import sampling
from ipmclab.quality.scale import without_consequences, wrong_scales
from ipmclab.quality.skew import channel_skew, is_far_off
from ipmclab.quality.stale import stale_readings
from ipmclab.quality.sudden import sudden_changes
from ipmclab.quality.usable import noise_only
from ipmclab.run import Finding, Run

if TYPE_CHECKING:
    from ipmclab.model import Actuator

_CHECKS: Final[tuple[Callable[[Record], list[Finding]], ...]] = (
    cut_off,
    sampling,
    no_excitation,
    begins_under_voltage,
    missing_contact,
    lost_readings,
    flagged_rows,
    clipping,
    range_limits,
    possible_range_limit,
    sudden_changes,
    rate_jumps,
    channel_skew,
    stale_readings,
    opposite_response,
    nothing_but_noise,
    rising_current,
    before_step,
    not_at_rest,
    measured_ringing,
    asked_beyond,
)
_ORDER: Final = {"error": 0, "warning": 1, "info": 2}  # the order in which findings are listed (convention)


@tell_kinds
def check(run: Run, actuator: Actuator | None = None) -> tuple[Finding, ...]:
    """What is wrong with a record, the gravest first. The run is not changed.

    Parameters
    ----------
    run : Run
    actuator : Actuator, optional
        A model of the strip; with it, an aliased resonance is predicted.

    Returns
    -------
    findings : tuple of Finding

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab.run import Run
    >>> time = np.arange(500) / 50.0
    >>> current = 0.05 * np.exp(-time) + np.random.default_rng(20261121).normal(0.0, 1e-4, 500)
    >>> current[200] = 0.15
    >>> run = Run.from_arrays(time=time, voltage=np.ones(500), current=current)
    >>> [(finding.code, finding.samples) for finding in check(run)]
    [('spike', ((200, 201),))]
    """
    return check_record(Record.of(run), actuator)


def check_record(record: Record, actuator: Actuator | None = None) -> tuple[Finding, ...]:
    """``check``, for a caller that continues to use what it computes of the record."""
    found = list(kept(record.run, "check", lambda: _checked(record)))
    if actuator is not None:
        found += predicted_ringing(record, actuator)
    off = wrong_scales(record, noise_only(found), actuator)
    # A cause comes first, and what follows from it is not said.
    return (*off, *sorted(without_consequences(found, off), key=lambda finding: _ORDER[finding.severity]))


def _checked(record: Record) -> list[Finding]:
    return _without_echoes(_without_feigned([finding for one in _CHECKS for finding in one(record)]))


def _without_feigned(findings: list[Finding]) -> list[Finding]:
    """Without what a current only seems to show that was read far before or after the voltage.

    One that comes as many rows late at each edge has its contact, and its sign and whether it falls are judged by what
    it does within three rows of an edge.
    """
    rows = [
        abs(float(one.values["lead_rows"] or 0)) for one in findings if one.channel == "current" and is_far_off(one)
    ]
    feigned = {"contact-missing"} if rows else set()
    feigned |= {"response-opposite", "current-rises"} if max(rows, default=0.0) > GUARD_ROWS else set()
    return [one for one in findings if one.channel != "current" or one.code not in feigned]


def _without_echoes(findings: list[Finding]) -> list[Finding]:
    """Without findings that another one explains: one event, one finding."""
    late = {stop for finding in findings if finding.code == "contact-missing" for _, stop in finding.samples}
    lost = {stop: start for finding in findings if finding.code == "contact-lost" for start, stop in finding.samples}
    ends = late | lost.keys() | {start + shift for start in lost.values() for shift in range(-5, 6)}
    off = [row for finding in findings if is_far_off(finding) for piece in finding.samples for row in piece]
    ends |= {row + shift for row in off for shift in (-1, 0, 1)}
    clipped = {finding.channel for finding in findings if finding.code == "clipped"}
    opposite = {finding.channel for finding in findings if finding.code == "response-opposite"}

    moving = {finding.channel for finding in findings if finding.code == "not-at-rest"}
    unloaded = {finding.channel for finding in findings if finding.values.get("unloaded")}
    stated = [finding for finding in findings if finding.code == "range-limit"]
    jumped = _jumped(findings)

    def is_echo(finding: Finding) -> bool:
        starts = {start for start, _ in finding.samples}
        stops = {stop for _, stop in finding.samples}
        match finding.code:
            case "begins-under-voltage":
                return bool(late)  # the current came within the record: that is when the strip saw the voltage
            case "contact-changed":
                return starts <= ends
            case "clipped":
                return any(
                    finding.channel == other.channel and finding.effect == other.effect and _covers(other, finding)
                    for other in stated
                )
            case "contact-lost":
                return stops <= late
            case "rate-jump":
                ends_of_it = late | jumped.get(finding.channel, set())
                return any(abs(start - row) <= 2 * RATE_ROWS for start in starts for row in ends_of_it)
            case "current-rises":
                return "current" in opposite or any(min(starts) <= stop < max(stops) for stop in lost)
            case "drift-before-step" | "offset-before-step":
                return finding.channel in moving
            case "possible-range-limit":
                return finding.channel in clipped
            case "range-limit":
                return finding.channel in unloaded
        return False

    return [finding for finding in findings if not is_echo(finding)]


def _jumped(findings: list[Finding]) -> dict[str | None, set[int]]:
    """The ends of slips and spikes, by their channels."""
    found: dict[str | None, set[int]] = {}
    for finding in findings:
        if finding.code in ("slip", "spike"):
            found.setdefault(finding.channel, set()).update(row for pair in finding.samples for row in pair)
    return found


def _covers(one: Finding, other: Finding) -> bool:
    """Whether every row of the other finding is a row of this one."""
    return all(any(first <= start and stop <= last for first, last in one.samples) for start, stop in other.samples)
