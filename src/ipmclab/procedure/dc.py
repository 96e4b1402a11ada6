"""Step 2: the dc resistance from the steady state (Friend, section 4.5)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.confidence import NORMAL_95
from ipmclab.errors import InputError
from ipmclab.measurement.uncertain import Uncertain, derived, exact, weighted_mean
from ipmclab.model.simulate import series_shunt
from ipmclab.procedure.step import Result, Step, advice_for, assumed_finding
from ipmclab.quality import check, measure
from ipmclab.quality.record import Record
from ipmclab.quality.steady import settle
from ipmclab.quality.usable import unmasked
from ipmclab.run import Finding, Run
from ipmclab.units import RESISTANCE, RESISTIVITY, significant

NAME: Final = "circuit.dc_resistivity"
TITLE: Final = "dc resistance from the steady state"

_STEADY: Final = 0.02
"""Part of the current that may still be on its way when the record ends."""

_TURNING: Final = 1.5
"""Times the half widths of both intervals by which two limits differ that are not the same: three standard errors."""

_FEWEST: Final = 20  # readings

_HALF: Final = 0.5
_TAIL: Final = 0.3
"""Parts of the stretch of constant voltage: the fast modes of a strip have gone in the last half."""

_SHORTEST: Final = 15.0
"""Time [s] below which nothing is believed: the slow mode of the thesis's strip has 15.8 s, and before that a faster
one looks as if it were the last."""

_SIGMAS: Final = 3.0  # of the voltage: a step within its noise is none (convention)
_NO_PART: Final = 0.01
"""Times the noise of a held voltage, and part of the step to it, within which it is none."""

_ELECTROLYSIS: Final = 1.23  # V, at which water decomposes (standard potential)


def dc_resistance(runs: Sequence[tuple[str, Run]], known: Mapping[str, Uncertain]) -> Step:
    """R_dc = V/I - 2 R_e - R_contact, and rho_dc = R_dc (L_f + L_c) w/h (Friend, eq. 4.2).

    In the circuit R_dc is behind both electrodes, so that what they take is subtracted. Table 4.1 does not:
    its 70.92 ohm are 1 V over 14.1 mA.

    The steady current is the limit of an exponential through the last half of the stretch of constant voltage, not the
    last reading.

    Parameters
    ----------
    runs : sequence of (label, Run)
        Each with a constant voltage for long.
    known : mapping of dotted name to Uncertain
        Dimensions, sheet and contact resistance.
    """
    how = (
        "R_dc = V/I - 2 R_e - R_contact at the current towards which a constant voltage settles; ρ_dc of it by Friend, "
        "eq. 4.2 (the V/I of Friend's Table 4.1 subtracts nothing)"
    )
    found = [_of_run(label, run, known) for label, run in runs]
    findings = tuple(finding for _, some in found for finding in some)
    good = [one for one, _ in found if one is not None]
    if not good:
        return Step(
            "dc_resistance",
            TITLE,
            how,
            findings=findings,
            advice="hold a constant voltage until the current no longer falls; until then the next step finds it, with "
            "the branches",
            done=False,
        )
    resistance = weighted_mean(good)
    findings += _scatter(good)
    resistivity = derived(
        lambda r, free, clamped, w, h: r * (free + clamped) * w / h,
        resistance,
        *(known[f"geometry.{name}"] for name in ("free_length", "clamped_length", "width", "thickness")),
    )
    return Step(
        "dc_resistance",
        TITLE,
        how,
        {NAME: Result(resistivity, RESISTIVITY, "ρ_dc")},
        {"R_dc": Result(resistance, RESISTANCE, "R_dc")},
        (*findings, *assumed_finding([resistivity])),
        advice_for(resistance) or advice_for(resistivity),
    )


def _of_run(label: str, run: Run, known: Mapping[str, Uncertain]) -> tuple[Uncertain | None, tuple[Finding, ...]]:
    run = _until_the_rest(run)
    findings_of_run = check(run)
    # A current of noise alone still says how large the resistance is at least.
    despite_noise = [finding for finding in findings_of_run if finding.code != "noise-only"]
    metrics = {metric.name: metric for metric in measure(run, despite_noise) if metric.channel == "current"}
    steady, last = metrics.get("steady_value"), metrics.get("mean_of_last_tenth")
    record = Record.of(run)
    if steady is None or last is None or steady.interval is None or not len(record.edges):
        raise InputError(
            "its current has no steady state: the voltage is not constant at its end for long enough",
            code="no-steady-state",
            where=label,
            repair="give a run with a step that is held, and with its current",
        )
    assert run.current is not None
    good = unmasked(run, findings_of_run)["current"]
    run = replace(run, current=np.where(good, run.current, np.nan))
    edge = int(record.edges[-1])
    volts = float(np.median(run.voltage[edge:]))
    if abs(volts) <= max(_SIGMAS * float(np.std(run.voltage[edge:])), _NO_PART * abs(float(record.heights[-1]))):
        raise InputError(
            f"its voltage ends at {volts:.2g} V, which is 0 V as far as its noise and its steps show: no current flows "
            "there",
            code="no-steady-state",
            where=label,
            repair="give a run whose voltage is held away from 0 V",
        )
    held = float(run.time[-1] - run.time[edge])
    limit, reach = _limit(run, edge, _HALF, last.value)
    if math.isfinite(reach) and limit / volts <= reach / abs(volts):
        return None, (_no_current(label, volts, limit, reach),)
    findings: list[Finding] = []
    others = [
        _limit(run, edge, _TAIL, last.value),
        (steady.value, float(np.abs(np.subtract(steady.interval, steady.value)).max())),
    ]
    away = [other for other, width in others if abs(other - limit) > _TURNING * math.hypot(reach, width)]
    if away or math.isinf(reach) or held < _SHORTEST:
        findings.append(_no_limit(label, held, limit, away))
        reach = math.inf
    elif abs(last.value - limit) > _STEADY * abs(limit):
        findings.append(_not_steady(label, run, edge, last.value, limit, known, volts))
    if abs(volts) > _ELECTROLYSIS:
        findings.append(
            Finding(
                "steady-above-electrolysis",
                "warning",
                f"{label}: at {volts:.3g} V water decomposes: the steady current is more than R_dc alone draws",
                "hold 1 V",
                "current",
            )
        )
    if math.isinf(reach):
        return None, tuple(findings)
    about = run.metadata.uncertainties
    assert last.interval is not None
    rest = last.interval[1] - last.value  # how well the zero of the current is known
    current = Uncertain(
        limit,
        {
            f"noise of {label}": math.hypot(reach, rest) / NORMAL_95,
            "calibration of the current": about.get("current", 0.0),
        },
    )
    voltage = Uncertain(volts, {"calibration of the voltage": about.get("voltage", 0.0)})
    shunt = exact(series_shunt(run, where=label))

    def resistance(
        v: float, i: float, s: float, contact: float, sheet: float, free: float, clamped: float, w: float
    ) -> float:
        return v / i - s - contact - 2.0 * sheet * (free + clamped) / w

    found = derived(
        resistance,
        voltage,
        current,
        shunt,
        known["circuit.contact_resistance"],
        known["circuit.sheet_resistance"],
        *(known[f"geometry.{name}"] for name in ("free_length", "clamped_length", "width")),
    )
    if not found.value > 0:
        raise InputError(
            f"{volts:g} V over {1e3 * steady.value:.4g} mA is less than the electrodes alone have: R_dc would be "
            f"{found.value:.3g} ohm",
            code="no-dc-resistance",
            where=label,
            repair="measure the sheet resistance again, and look at the shunt and the scale of the current",
        )
    return found, tuple(findings)


def _limit(run: Run, edge: int, share: float, end: float) -> tuple[float, float]:
    """Where the last part of what follows an edge settles, and the half width of its interval [A].

    A mode that is too slow to be distinguished from a constant shows in that another part settles elsewhere.
    """
    assert run.current is not None
    rows = np.arange(len(run) - round(share * (len(run) - edge)), len(run))
    rows = rows[np.isfinite(run.current[rows])]
    if len(rows) < _FEWEST:
        return end, math.inf
    tail = run.current[-max(1, len(run) // 10) :]
    limit, (low, high) = settle(run.time[rows], run.current[rows])
    # The metrics count from rest.
    return limit - float(np.nanmean(tail)) + end, max(limit - low, high - limit)


def _until_the_rest(run: Run) -> Run:
    """The run up to where its voltage goes to rest after a step that was held: a recording ends with such a rest."""
    edge, end = Record.of(run).held_last or (0, len(run))
    if end == len(run) or run.time[end] - run.time[edge] < run.time[-1] - run.time[end]:
        return run
    return Run.from_arrays(
        time=run.time[:end],
        voltage=run.voltage[:end],
        current=None if run.current is None else run.current[:end],
        hold=run.hold,
        quality={"current": run.quality["current"][:end]} if "current" in run.quality else None,
        metadata=run.metadata,
    )


def _no_limit(label: str, held: float, limit: float, away: Sequence[float]) -> Finding:
    """The record does not show towards what the current settles."""
    text = (
        f"its last half settles towards {1e3 * limit:.4g} mA, another part towards {1e3 * away[0]:.4g} mA: something "
        "slower follows"
        if away
        else "nothing shows towards what"
    )
    return Finding(
        "not-steady",
        "warning",
        f"{label}: the current still changes {held:.3g} s after the step, and {text}",
        f"hold the voltage for {significant(max(4.0 * held, 4.0 * _SHORTEST), 2)} s or longer",
        "current",
        values={"held": held},
    )


def _no_current(label: str, volts: float, limit: float, reach: float) -> Finding:
    """The steady current is zero as far as the record shows."""
    least = abs(volts) / (abs(limit) + reach)
    return Finding(
        "no-dc-current",
        "warning",
        f"{label}: at {volts:.3g} V the current settles towards {1e3 * limit:.3g} mA, within {1e3 * reach:.2g} mA: "
        "that is zero, or the zero of its sensor has moved",
        f"the dc resistance is above some {significant(least, 2)} ohm; look at the current at 0 V before and after the "
        "step",
        "current",
        values={"limit": limit, "least": least},
    )


def _not_steady(
    label: str, run: Run, edge: int, end: float, limit: float, known: Mapping[str, Uncertain], volts: float
) -> Finding:
    """The record ends before the current has settled: what the last reading would have given, how long to hold."""
    time, current = run.time, run.current
    assert current is not None
    held = float(time[-1] - time[edge])
    squares = (known["geometry.free_length"].value + known["geometry.clamped_length"].value) / known[
        "geometry.width"
    ].value
    series = series_shunt(run, where=label) + known["circuit.contact_resistance"].value
    series += 2.0 * known["circuit.sheet_resistance"].value * squares
    read_off, settled = volts / end - series, volts / limit - series
    quarter = edge + (len(time) - edge) // 4
    early = float(np.nanmean(current[quarter : quarter + max((len(time) - edge) // 20, 1)]))
    ratio = (early - limit) / (end - limit)
    # Between the first twentieth after the first quarter and the last tenth the current came nearer by that factor.
    speed = 0.675 * held / math.log(ratio) if ratio > 1.0 else held
    needed = held + speed * max(math.log(abs(end - limit) / (0.01 * abs(limit))), 0.0)
    return Finding(
        "not-steady",
        "warning",
        f"{label}: {held:.3g} s after the step the current is {1e3 * end:.4g} mA, on its way to {1e3 * limit:.4g} mA: "
        f"read off there, the dc resistance would be {read_off:.4g} ohm and not {settled:.4g} ohm",
        f"hold the voltage for {significant(needed, 2)} s; the limit of an exponential was taken, which is right if "
        "nothing slower follows",
        "current",
        values={"held": held, "end": end, "limit": limit, "read_off": read_off, "needed": needed},
    )


def _scatter(good: Sequence[Uncertain]) -> tuple[Finding, ...]:
    """Runs that disagree by more than their own noise show a strip in two states."""
    if len(good) < 2:
        return ()
    values = np.array([one.value for one in good])
    common = set.intersection(*(set(one.parts) for one in good))
    own = np.array([one.without(common).uncertainty for one in good])
    sigmas = float(np.ptp(values)) / max(float(np.hypot(own[values.argmax()], own[values.argmin()])), 1e-300)
    if sigmas <= 3.0:
        return ()
    return (
        Finding(
            "states-differ",
            "warning",
            f"the runs give dc resistances from {values.min():.4g} to {values.max():.4g} ohm. They differ by "
            f"{sigmas:.2g} standard uncertainties: the strip was not the same in them",
            "record the runs of one procedure one after the other, in one mounting, at one humidity",
        ),
    )
