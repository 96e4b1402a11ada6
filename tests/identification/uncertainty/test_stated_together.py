"""What a fit passes on of values that it holds: against the same fit with those values moved by what is stated of them.

The resistance of the first branch and the series resistance are wrong together. A stage that is fitted on both at once,
and one that is fitted after the other, are wrong by as much.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Actuator, Run, RunMetadata, identify, load_actuator, simulate, write_actuator
from ipmclab.fit.as_fitted import why_changed
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.stated import stated_covariance
from tests.identification.brief import brief

SEED = 20261122
FRIEND = load_actuator("friend-2")
SLOW = FRIEND.replace(**{"coupling.zero": 30.0})
"""With a zero that 50 S/s shows: all four of the coupling are determined."""

SHEET = "circuit.sheet_resistance"
RHO_1 = "circuit.branches.0.resistivity"
PARTS = {"coupling.gain": 1.0, "coupling.zero": 1.0, "coupling.p2": -1.0}
"""Powers of the parameters in d(0)."""


def stating(strip: Actuator, part: float) -> Actuator:
    """With a standard uncertainty of the sheet resistance that is a part of it."""
    return replace(strip, standard_uncertainties={SHEET: part * strip[SHEET]})


@cache
def runs(strip: Actuator, quiet: float) -> tuple[Run, ...]:
    """Current and motion of a step and a sine, with noise of 0.1 mA, 2 um and 10 uN times a factor."""
    generator = np.random.default_rng(SEED)
    found = []
    for signal in ("step 1 V delay=5 s", "sine 1 V 0.1 Hz delay=5 s"):
        clean = simulate(strip, signal, duration=45.0, rate=50.0)
        noise = {"current": 1e-4, "displacement": 2e-6, "force": 1e-5}
        read = {
            channel: values + quiet * noise[channel] * generator.standard_normal(len(clean))
            for channel, values in clean.channels.items()
            if channel in noise
        }
        rest = RunMetadata(starts_from_rest=True)
        found.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, hold=clean.hold, metadata=rest, **read))
    return tuple(found)


@cache
def in_stages(stated: float, moved: float = 1.0) -> Fit:
    """The coupling after the circuit, with what is stated of the sheet resistance, or with that moved by a factor."""
    strip = SLOW.replace(**{SHEET: moved * SLOW[SHEET]})
    circuit = brief(stating(strip, stated) if stated else strip, runs(SLOW, 0.1), followed=False)
    exact = circuit.actuator if stated else replace(circuit.actuator, standard_uncertainties={})
    return brief(exact, runs(SLOW, 0.1), "coupling", followed=False)


@cache
def at_once() -> Fit:
    """Circuit and coupling of a strip whose sheet resistance is too little known for a pole of the coupling."""
    return brief(stating(FRIEND, 0.02), runs(FRIEND, 1.0), "electrical,coupling")


def d_0(strip: Actuator) -> float:
    return strip["coupling.gain"] * strip["coupling.zero"] / strip["coupling.p2"]


def error_of(fit: Fit, powers: Mapping[str, float]) -> float:
    """Standard error of a product of powers, as a part of it, from which bands follow too."""
    weights = {name: power / fit.actuator[name] for name, power in powers.items()}
    return math.sqrt(sum(weights[a] * weights[b] * fit.covariance[a][b] for a in weights for b in weights))


def said(fit: Fit) -> float:
    """Standard error of d(0) in the sentence of a fit, as a part of it."""
    (sentence,) = [one.sentence for one in fit.undetermined if "only d(0)" in one.sentence]
    found = re.search(r"standard error ([\d.e-]+) %", sentence)
    assert found is not None
    return 0.01 * float(found[1])


@pytest.mark.parametrize("powers", [PARTS, *({name: 1.0} for name in PARTS)], ids=["d(0)", *PARTS])
def test_after_a_circuit_the_errors_are_those_of_both_fits_with_the_sheet_moved(powers: dict[str, float]) -> None:
    stated, step = 5e-3, 1e-3  # a small step: farther off, what is left would be taken for a noise of its own
    up, down = in_stages(0.0, 1.0 + step).actuator, in_stages(0.0, 1.0 - step).actuator
    moved = sum(power * math.log(up[name] / down[name]) for name, power in powers.items()) / (2.0 * step) * stated
    # The noise of the circuit's own fit, which this lacks, is small beside the sheet resistance.
    truth = math.hypot(moved, error_of(in_stages(0.0), powers))
    assert error_of(in_stages(stated), powers) == pytest.approx(truth, rel=0.15)


def test_d_0_is_known_as_well_as_it_is_when_its_parts_are_not() -> None:
    fit = at_once()
    assert fit.parameters["coupling.p2"].determined
    assert fit.parameters["coupling.p2"].standard_error > 0.42 * fit.parameters["coupling.p2"].value
    found = []
    for part in (0.98, 1.02):
        moved = brief(FRIEND.replace(**{SHEET: part * FRIEND[SHEET]}), runs(FRIEND, 1.0), followed=False).actuator
        found.append(d_0(brief(moved, runs(FRIEND, 1.0), "coupling", followed=False).actuator))
    # At two per cent it is not straight any more; it was said to be known to 37 %.
    assert said(fit) == pytest.approx(0.5 * math.log(found[1] / found[0]), rel=0.5)


def test_the_sentence_is_what_the_covariance_of_the_fit_says() -> None:
    assert said(at_once()) == pytest.approx(error_of(at_once(), PARTS), rel=0.05)  # two digits are said


@cache
def circuit() -> Actuator:
    """With a fitted circuit, whose sheet resistance is known to a hundredth."""
    return brief(stating(FRIEND, 0.01), runs(FRIEND, 1.0)).actuator


def test_an_error_that_leans_on_what_is_taken_as_exact_says_so() -> None:
    """The displacement goes with 1/thickness: 1 % of it moves d(0) by 1 %, and noise moves it by less."""
    (told,) = [one.sentence for one in at_once().undetermined if "only d(0)" in one.sentence]
    assert "with geometry.thickness" in told
    assert "taken as exact" in told
    assert SHEET not in told.split("standard error")[1]  # its uncertainty is stated


def test_branch_and_sheet_resistance_are_wrong_together_also_from_a_file(tmp_path: Path) -> None:
    write_actuator(circuit(), tmp_path / "circuit.toml")
    names = [SHEET, RHO_1]
    for known in (circuit(), load_actuator(tmp_path / "circuit.toml")):
        table = stated_covariance(known, names)
        deviations = [math.sqrt(table[name][name]) for name in names]
        assert deviations == pytest.approx([known.standard_uncertainties[name] for name in names])
        # 1 % of the sheet resistance moves the branch by 29 % the other way, and hardly anything else does.
        assert -1.0 <= table[SHEET][RHO_1] / (deviations[0] * deviations[1]) < -0.99


@pytest.mark.parametrize("what", ["value", "sharper", "by hand", "not a covariance"])
def test_a_number_that_somebody_changed_since_stands_alone(what: str) -> None:
    fitted = circuit()
    assert fitted.fit_table is not None
    stated = dict(fitted.standard_uncertainties)
    known: Actuator
    if what == "value":
        known = replace(fitted, parameter_values={**fitted.parameter_values, SHEET: 1.1 * fitted[SHEET]})
    elif what == "sharper":
        known = replace(fitted, standard_uncertainties={**stated, SHEET: 0.5 * stated[SHEET]})
    else:
        table = {key: list(value) for key, value in fitted.fit_table["covariance"].items()}
        if what == "by hand":
            table = {"names": table["names"], "rows": []}
        else:
            places = [table["names"].index(name) for name in (SHEET, RHO_1)]
            rows = [list(row) for row in table["rows"]]
            rows[places[0]][places[1]] = rows[places[1]][places[0]] = 2.0 * rows[places[0]][places[1]]
            table = {"names": table["names"], "rows": rows}
        known = replace(fitted, fit_table={**fitted.fit_table, "covariance": table})
    found = stated_covariance(known, [SHEET, RHO_1])
    assert found[SHEET][RHO_1] == 0.0
    assert found[SHEET][SHEET] == pytest.approx(known.standard_uncertainties[SHEET] ** 2)


def test_what_is_stated_beyond_the_earlier_fit_is_each_parameters_own() -> None:
    fitted = circuit()
    wider = {**fitted.standard_uncertainties, RHO_1: 2.0 * fitted.standard_uncertainties[RHO_1]}
    before = stated_covariance(fitted, [SHEET, RHO_1])
    after = stated_covariance(replace(fitted, standard_uncertainties=wider), [SHEET, RHO_1])
    assert after[RHO_1][RHO_1] == pytest.approx(4.0 * before[RHO_1][RHO_1])
    assert after[SHEET] == pytest.approx(before[SHEET])


def test_a_value_of_zero_passes_on_what_is_stated_of_it_as_any_other_does() -> None:
    """Contacts of 0 ± 0.5 ohm: as those of a millionth of an ohm, for parameters, quantities and predictions alike."""
    contact = "circuit.contact_resistance"
    clean = simulate(FRIEND, "step 1 V delay=1 s", duration=20.0, rate=20.0)
    noise = 1e-4 * np.random.default_rng(SEED).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
    none, hardly = (
        identify(replace(FRIEND.replace(**{contact: value}), standard_uncertainties={contact: 0.5}), run)
        for value in (0.0, 1e-6)
    )
    assert none.covariance[contact] == pytest.approx(hardly.covariance[contact], rel=1e-3)
    assert [one.name for one in none.known] == [one.name for one in hardly.known]
    for one, other in zip(none.known, hardly.known, strict=True):
        assert one.interval == pytest.approx(other.interval, rel=1e-4), one.name
    (told,) = [finding.message for finding in none.findings if finding.code == "fixed-uncertainty"]
    assert "one standard uncertainty of circuit.contact_resistance moves circuit.branches.0.resistivity by" in told


def test_what_is_held_has_the_name_that_the_fit_gives_its_branch() -> None:
    """An actuator whose slow branch stands first: the fit of it calls it the second, and what it holds the first."""
    fast, slow = (f"circuit.branches.{k}.permittivity" for k in (0, 1))
    rho_1, rho_2 = (f"circuit.branches.{k}.resistivity" for k in (0, 1))
    swapped = {fast: FRIEND[slow], slow: FRIEND[fast], rho_1: FRIEND[rho_2], rho_2: FRIEND[rho_1]}
    slow_first = replace(FRIEND.replace(**swapped), standard_uncertainties={slow: 0.1 * FRIEND[fast]})
    straight = replace(FRIEND, standard_uncertainties={fast: 0.1 * FRIEND[fast]})
    clean = simulate(FRIEND, "step 1 V delay=1 s", duration=20.0, rate=10.0)
    noise = 1e-4 * np.random.default_rng(SEED).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
    one, other = identify(slow_first, run, free=fast), identify(straight, run, free=slow)
    assert list(one.parameters) == [slow]
    assert {name: dict(row) for name, row in one.covariance.items()} == {
        name: pytest.approx(dict(row), rel=1e-4) for name, row in other.covariance.items()
    }
    assert not why_changed(one)
    (told,) = [finding.message for finding in one.findings if finding.code == "fixed-uncertainty"]
    assert told.startswith(f"the stated uncertainty of {fast} is passed on")
