"""Fits of made records whose truth is known: coverage, starts, delays, bounds, what is not determined, and messages."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.wrong_model import circuit_current, spread_circuit
from ipmclab import Fit, InputError, Run, RunMetadata, identify, load_actuator, simulate
from ipmclab.fit.answer import answer_of
from ipmclab.fit.first_answer import first_answer
from ipmclab.identification import identify as identify_module
from ipmclab.model import Actuator, simulate_outputs
from ipmclab.progress import aside, first_answer_to, tick
from tests.identification.brief import brief
from tests.independent.bounds import ELECTRICAL, noisy_current, relative_errors, step_and_sine, strip_of

SEED = 20261121
FRIEND = load_actuator("friend-2")
NOISE = {"current": 1e-4, "force": 1e-4, "displacement": 1e-5}
RHO_1 = "circuit.branches.0.resistivity"
GAINS = (("high", 1.02), ("higher", 1.02 * 1.002))


def record(
    signal: str = "step 1 V",
    *,
    actuator: Actuator = FRIEND,
    keep: tuple[str, ...] = ("current",),
    rate: float = 50.0,
    duration: float = 40.0,
    hold: str = "zero",
    seed: int = 0,
    **about: object,
) -> Run:
    """A noisy measured run of an actuator."""
    generator = np.random.default_rng([SEED, seed, len(signal)])
    clean = simulate(actuator, signal, duration=duration, rate=rate, hold=hold)  # type: ignore[arg-type]
    channels = {name: getattr(clean, name) + NOISE[name] * generator.standard_normal(len(clean)) for name in keep}
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        hold=hold,  # type: ignore[arg-type]
        metadata=RunMetadata(**about),  # type: ignore[arg-type]
        **channels,
    )


def worst(fit: object, truth: Actuator = FRIEND) -> float:
    """Largest distance from the truth in standard errors, over actuator parameters that are determined."""
    return max(
        abs(parameter.value - truth[name]) / parameter.standard_error
        for name, parameter in fit.parameters.items()  # type: ignore[attr-defined]
        if parameter.determined and name in truth.parameter_values
    )


def test_intervals_hold_the_truth_of_strips_around_friend_2() -> None:
    # The full count is benchmarks/coverage.py.
    generator = np.random.default_rng(SEED)
    centre = np.log([FRIEND[name] for name in ELECTRICAL])
    inside = total = sharp = sharp_determined = 0
    widths = []
    for _ in range(60):
        drawn = centre + np.log(10.0) * generator.uniform(-0.5, 0.5, 5)
        first, second = sorted([tuple(drawn[:2]), tuple(drawn[2:4])], key=sum)
        strip = strip_of(np.array([*first, *second, drawn[4]]))
        runs = [
            Run.from_arrays(
                time=time,
                voltage=voltage,
                current=noisy_current(strip, voltage, 50.0, 1e-4, generator),
                metadata=RunMetadata(starts_from_rest=True),
            )
            for time, voltage in step_and_sine()
        ]
        fit = brief(FRIEND, runs)
        left = sum(float(np.sum((run["current"] / 1e-4) ** 2)) for run in fit.residuals)
        assert left < 4000 + 4 * 89, "not at the noise floor"
        bound = relative_errors(strip, step_and_sine(), 1e-4)
        for name in ELECTRICAL:
            parameter = fit.parameters[name]
            low, high = parameter.interval
            inside += low <= strip.dotted()[name] <= high
            total += 1
            if bound[name] < 0.4:
                sharp += 1
                sharp_determined += parameter.determined
                widths.append((high - low) / (2 * 1.96 * bound[name] * strip.dotted()[name]))
    # 300 intervals of 95 %: three and a half standard deviations of a binomial are 4.4 %.
    assert 0.906 <= inside / total <= 0.994
    assert sharp_determined / sharp >= 0.95
    assert 0.9 < np.median(widths) < 1.3


def test_the_file_values_of_free_parameters_do_not_matter() -> None:
    runs = [record(), record("sine 1 V 0.1 Hz")]
    wrong = FRIEND.replace(
        **{name: FRIEND[name] * factor for name, factor in zip(ELECTRICAL, (90, 0.02, 0.01, 30, 50), strict=True)}
    )
    here, there = identify(FRIEND, runs), identify(wrong, runs)
    for name in ELECTRICAL:
        assert there.parameters[name].value == pytest.approx(here.parameters[name].value, rel=1e-6)


@pytest.mark.parametrize("branches", [1, 3])
def test_any_number_of_branches(branches: int) -> None:
    values = {n: v for n, v in FRIEND.parameter_values.items() if not n.startswith("circuit.branches.")}
    for number in range(branches):
        values[f"circuit.branches.{number}.resistivity"] = 0.36 * 30.0**number
        values[f"circuit.branches.{number}.permittivity"] = 0.12 * 2.0**number
    strip = Actuator("strip", values)
    signals = [("step 1 V", 300.0), ("sine 1 V 0.1 Hz", 100.0)]
    runs = [record(signal, actuator=strip, duration=duration) for signal, duration in signals]
    fit = identify(strip, runs)
    assert fit.rank == 1 + 2 * branches
    assert all(parameter.determined for parameter in fit.parameters.values())
    assert worst(fit, strip) < 3.5


def test_branches_come_fastest_first_with_their_errors() -> None:
    swapped = {
        f"circuit.branches.{i}.{what}": FRIEND[f"circuit.branches.{1 - i}.{what}"]
        for i in (0, 1)
        for what in ("resistivity", "permittivity")
    }
    fit = identify(FRIEND.replace(**swapped), [record(actuator=FRIEND), record("sine 1 V 0.1 Hz")])
    assert fit.parameters[RHO_1].value == pytest.approx(FRIEND[RHO_1], rel=0.05)
    assert fit.actuator[RHO_1] == fit.parameters[RHO_1].value
    # Only the slow branch is free, and it stands first in the file: it comes back as the second.
    slow = identify(
        FRIEND.replace(**swapped), [record()], free="circuit.branches.0.resistivity,circuit.branches.0.permittivity"
    )
    assert set(slow.parameters) == {"circuit.branches.1.resistivity", "circuit.branches.1.permittivity"}
    assert worst(slow) < 3.5


def test_runs_of_different_rates_holds_and_lengths() -> None:
    runs = [
        record(hold="zero-before"),
        record("sine 1 V 0.1 Hz", hold="first", rate=20.0, duration=55.0),
        record("square 1 V 0.3 Hz", rate=200.0, duration=10.0),
    ]
    assert worst(identify(FRIEND, runs)) < 3.5


def test_irregular_rows_and_missing_readings() -> None:
    whole = record()
    assert whole.current is not None
    rows = np.sort(np.random.default_rng(SEED).choice(np.arange(1, 2000), 1500, replace=False))
    rows[0] = 0
    irregular = Run.from_arrays(time=whole.time[rows], voltage=whole.voltage[rows], current=whole.current[rows])
    assert not irregular.is_uniform
    assert worst(identify(FRIEND, [irregular])) < 3.5
    gaps = replace(whole, current=np.where(np.arange(2000) % 7 == 3, np.nan, whole.current))
    fit = identify(FRIEND, [gaps, record("sine 1 V 0.1 Hz")])
    assert worst(fit) < 3.5
    assert fit.observations[0].samples["current"] <= 2000 - 285


def test_a_run_cut_from_the_middle_of_a_longer_one() -> None:
    long = record("square 1 V 0.11 Hz", duration=80.0)
    assert long.current is not None
    cut = Run.from_arrays(time=long.time[1717:3717], voltage=long.voltage[1717:3717], current=long.current[1717:3717])
    fit = identify(FRIEND, [cut, record()])
    assert worst(fit) < 3.5
    assert [observation.start for observation in fit.observations] == [
        "free",
        "rest, which the readings do not contradict",
    ]
    assert [finding.code for finding in fit.findings].count("start-not-at-rest") == 1
    # The voltages of the capacitors there are those of the whole simulation.
    stepping = FRIEND.simulator(50.0, "zero")
    stepping.block(long.voltage[:1717])
    truth = dict(zip(FRIEND.state_names, stepping.state.values(), strict=True))
    for name, value in fit.observations[0].initial_state.items():
        assert value == pytest.approx(truth[name], abs=0.02)


@pytest.mark.parametrize("part", [0.37, -0.4])
def test_edges_between_rows_are_found_from_a_step_and_a_sine(part: float) -> None:
    # The strip sees each voltage a part of a row later than its row says.
    runs = []
    for place, signal in enumerate(("step 1 V delay=1 s", "sine 1 V 0.1 Hz")):
        plain = simulate(FRIEND, signal, duration=40.0, rate=50.0)
        shifted = simulate_outputs(FRIEND, plain.time, plain.voltage, "zero", outputs=["current"], delay=part / 50.0)[0]
        noise = 1e-4 * np.random.default_rng([SEED, place]).standard_normal(2000)
        runs.append(Run.from_arrays(time=plain.time, voltage=plain.voltage, current=shifted + noise, hold="unknown"))
    fit = identify(FRIEND, runs)
    assert worst(fit) < 3.5
    for place in (0, 1):
        delay = fit.parameters[f"observation.delay[{place}]"]
        assert abs(delay.value - part / 50.0) < 3.5 * delay.standard_error
    taken = identify(FRIEND, [replace(run, hold="zero") for run in runs])
    assert abs(taken.parameters[RHO_1].value / FRIEND[RHO_1] - 1.0) > 0.15, "the edges matter"


def test_a_shunt_inside_the_sensed_voltage_is_added() -> None:
    burdened = FRIEND.replace(**{"circuit.contact_resistance": 1.0})
    run = record(actuator=burdened, voltage_sensed="upstream of shunt", shunt_resistance=1.0)
    fit = identify(FRIEND, [run, record("sine 1 V 0.1 Hz")])
    assert worst(fit) < 3.5
    assert [observation.series_resistance for observation in fit.observations] == [1.0, 0.0]


def test_clipped_readings_are_bounds() -> None:
    run = record()
    assert run.current is not None
    clipped = replace(
        run, current=np.minimum(run.current, 0.05), metadata=RunMetadata(ranges={"current": (-0.05, 0.05)})
    )
    fit = identify(FRIEND, [clipped, record("sine 1 V 0.1 Hz")])
    assert worst(fit) < 3.5


def test_a_voltage_at_the_end_of_its_range_is_told_beside_the_fit() -> None:
    run = record(duration=10.0)
    cut = replace(run, metadata=replace(run.metadata, ranges={"voltage": (-1.0, 1.0)}))
    (told,) = [
        one for one in identify(FRIEND, [cut], free="circuit.dc_resistivity").findings if one.channel == "voltage"
    ]
    assert (told.code, told.severity, told.message[:7]) == ("range-limit", "warning", "run 0: ")


def test_offset_of_the_sensors_and_drift() -> None:
    run = record("step 1 V delay=4 s", keep=("force", "displacement"))
    assert run.force is not None
    assert run.displacement is not None
    moved = replace(run, force=run.force + 2e-3, displacement=run.displacement + 9e-3)
    here, there = identify(FRIEND, [run], free="coupling"), identify(FRIEND, [moved], free="coupling")
    offset = there.observations[0].offset
    assert offset["force"] == pytest.approx(2e-3, abs=2e-5)
    assert offset["displacement"] == pytest.approx(9e-3, abs=1e-5)
    static = [
        f.actuator["coupling.gain"] * f.actuator["coupling.zero"] / f.actuator["coupling.p2"] for f in (here, there)
    ]
    assert static[1] == pytest.approx(static[0], rel=0.01)
    assert {"sensor-zero"} <= {finding.code for finding in there.findings}
    assert "sensor-zero" not in {finding.code for finding in here.findings}


def test_complex_poles_of_the_coupling() -> None:
    ringing = FRIEND.replace(**{"coupling.p1": 2.0, "coupling.p2": 30.0, "coupling.zero": 20.0, "coupling.gain": 5e-8})
    runs = [record(signal, actuator=ringing, keep=("force",)) for signal in ("step 1 V", "square 1 V 0.3 Hz")]
    fit = identify(FRIEND, runs, free="coupling")
    assert worst(fit, ringing) < 3.5
    assert fit.actuator["coupling.p1"] ** 2 < 4 * fit.actuator["coupling.p2"]


def test_force_alone_shows_only_the_product_of_d_and_modulus() -> None:
    runs = [record(signal, keep=("force",)) for signal in ("step 1 V", "square 1 V 0.3 Hz")]
    fit = identify(FRIEND, runs, free="coupling,beam.modulus")
    product = next(d for d in fit.undetermined if abs(d.coefficients["beam.modulus"]) > 0.5)
    assert product.coefficients["beam.modulus"] == pytest.approx(-product.coefficients["coupling.gain"], rel=1e-3)
    assert "displacement" in product.sentence
    assert not fit.parameters["beam.modulus"].determined
    assert fit.parameters["beam.modulus"].standard_error == np.inf
    assert fit.parameters["beam.modulus"].interval == (0.0, np.inf)


def test_one_parameter_alone_that_is_hardly_known_has_an_interval() -> None:
    """Its profile holds it, and then nothing is left to fit."""
    run = record("sine 1 V 7 Hz", duration=1.25, rate=200.0)
    fit = identify(FRIEND, [run], free="circuit.dc_resistivity")
    one = fit.parameters["circuit.dc_resistivity"]
    assert one.standard_error > 0.05 * one.value
    assert one.interval[0] < FRIEND["circuit.dc_resistivity"] < one.interval[1]


def test_a_free_direction_ends_where_the_file_is() -> None:
    runs = [record(), record("sine 1 V 0.1 Hz")]
    fit = identify(FRIEND, runs, free=["electrical", "circuit.sheet_resistance"])
    assert fit.rank == 5
    published = {
        "circuit.branches.0.resistivity": 0.998,
        "circuit.branches.1.resistivity": 0.023,
        "circuit.branches.0.permittivity": -0.044,
        "circuit.branches.1.permittivity": -0.009,
        "circuit.dc_resistivity": 0.008,
        "circuit.sheet_resistance": -0.035,
    }
    assert len(fit.undetermined) == 1
    for name, value in published.items():
        assert fit.undetermined[0].coefficients[name] == pytest.approx(value, abs=2e-3)
        assert not fit.parameters[name].determined
    assert "measure the sheet resistance" in fit.undetermined[0].sentence


def test_force_with_known_coupling_cures_it() -> None:
    runs = [record(signal, keep=("current", "force")) for signal in ("step 1 V", "sine 1 V 0.1 Hz")]
    fit = identify(FRIEND, runs, free=["electrical", "circuit.sheet_resistance"])
    assert fit.undetermined == ()
    assert worst(fit) < 3.5


def test_an_electrical_fit_does_not_lean_on_a_foreign_coupling() -> None:
    runs = [record(signal, keep=("current", "force")) for signal in ("step 1 V", "sine 1 V 0.1 Hz")]
    foreign = FRIEND.replace(**{"coupling.gain": 1e-7, "beam.modulus": 1e8})
    assert worst(identify(foreign, runs)) < 3.5


def test_what_a_fit_leans_on_is_said() -> None:
    fit = identify(FRIEND, [record(), record("sine 1 V 0.1 Hz")])
    said = next(finding for finding in fit.findings if finding.code == "exact-fixed-value")
    assert said.values["leverage"] == pytest.approx(0.29, abs=0.015)
    assert "circuit.sheet_resistance" in said.message
    assert RHO_1 in said.message


def test_a_circuit_that_rests_on_motion_leans_on_the_coupling_and_says_so() -> None:
    every = ("current", "displacement", "force")
    runs = [record(signal, keep=every, rate=25.0, duration=30.0) for signal in ("step 1 V", "sine 1 V 0.1 Hz")]
    given = {name: FRIEND.replace(**{"coupling.gain": factor * FRIEND["coupling.gain"]}) for name, factor in GAINS}
    six = ["electrical", "circuit.sheet_resistance"]
    fits = {name: identify(actuator, runs, free=six) for name, actuator in given.items()}
    said = {
        finding.message.split()[0]: finding for finding in fits["high"].findings if finding.code == "exact-fixed-value"
    }
    assert {"coupling.gain", "coupling.zero", "coupling.p2", "geometry.thickness"} <= set(said)
    assert said["coupling.gain"].severity == "warning"
    # One more fit, to a gain that is 0.2 % higher, moves the answer as far as the finding says of 1 %.
    moved = 5.0 * np.log(fits["higher"].parameters[RHO_1].value / fits["high"].parameters[RHO_1].value)
    assert f"{RHO_1} by" in said["coupling.gain"].message
    assert said["coupling.gain"].values["leverage"] == pytest.approx(abs(moved), rel=0.1)
    for finding in fits["high"].findings:
        if finding.code in ("stage-missing", "model-incomplete"):
            assert "A wrong fixed value (coupling.*) can look the same" in finding.message


def test_a_fit_of_the_current_says_nothing_of_the_coupling() -> None:
    fit = identify(FRIEND, [record(), record("sine 1 V 0.1 Hz")])
    leaning = [finding for finding in fit.findings if finding.code == "exact-fixed-value"]
    assert [finding.message.split()[0] for finding in leaning] == ["circuit.sheet_resistance"]
    assert leaning[0].severity == "warning"  # 1 % of it moves the first branch by 29 %


def test_coloured_residuals_widen_the_errors() -> None:
    runs = [record(), record("sine 1 V 0.1 Hz")]
    white = identify(FRIEND, runs)
    generator = np.random.default_rng(SEED)
    coloured = []
    for run in runs:
        walk = np.zeros(len(run))
        for row in range(1, len(run)):
            walk[row] = 0.9 * walk[row - 1] + generator.standard_normal()
        assert run.current is not None
        coloured.append(replace(run, current=run.current + 1e-4 * walk))
    fit = brief(FRIEND, coloured)
    assert "coloured-residuals" in {finding.code for finding in fit.findings}
    # A pole of 0.9 makes the long-run variance 19 times that of white noise of the same size: errors 4.4 times.
    slow = "circuit.dc_resistivity"
    naive = white.parameters[slow].standard_error * fit.noise[0]["current"] / white.noise[0]["current"]
    assert 2.5 < fit.parameters[slow].standard_error / naive < 6.0


@pytest.fixture(scope="module")
def behind_thin_electrodes() -> Fit:
    """A fit with a sheet resistance that does not allow the current of the first instant."""
    return brief(FRIEND.replace(**{"circuit.sheet_resistance": 3.0}), record())


def test_a_current_that_the_electrodes_do_not_allow_is_named(behind_thin_electrodes: Fit) -> None:
    said = next(finding for finding in behind_thin_electrodes.findings if finding.code == "impossible-current")
    assert "36 ohm" in said.message
    assert said.severity == "error"


def test_a_series_resistance_that_was_free_is_no_fault_of_the_record() -> None:
    """Of a charge that spreads over all times two branches miss the first reading, by a series resistance of their own.

    The curve is followed to 1 % of its range: such a fit was refused, with the advice to free what was free.
    """
    run = record("step 1 V delay=5 s", duration=60.0, rate=25.0)
    spread = circuit_current(spread_circuit(60.0, 3000.0, 0.5, 0.02), run.voltage, 0.04)
    read = spread + 3e-6 * np.random.default_rng(SEED).standard_normal(len(run))
    fit = brief(FRIEND, replace(run, current=read), free="electrical,circuit.sheet_resistance")
    most = 1.0 / (12.0 * fit.parameters["circuit.sheet_resistance"].value)
    assert float(read.max()) > 1.1 * most
    assert fit.noise[0]["current"] < 0.01 * float(np.ptp(read))
    codes = {finding.code for finding in fit.findings}
    assert "model-error" in codes
    assert "impossible-current" not in codes
    assert not answer_of(fit).is_refused


def test_a_series_resistance_that_is_known_beforehand_is_none_of_the_readings() -> None:
    name = "circuit.sheet_resistance"
    thin = replace(FRIEND.replace(**{name: 3.0}), standard_uncertainties={name: 1e-5})
    fit = brief(thin, record(), free=f"electrical,{name}", prior=name)
    assert "impossible-current" in {finding.code for finding in fit.findings}


@pytest.mark.parametrize(
    ("runs", "free", "code", "words"),
    [
        ([], "electrical", "no-runs", "at least one"),
        (["step.nc"], "electrical", "not-a-run", "read_run"),
        ([record(keep=("force",))], "electrical", "no-readings", "current"),
        ([record()], "coupling", "no-readings", "displacement or force"),
        ([record(keep=("force",))], "coupling,beam.density", "no-readings", "displacement"),
        ([record(), record()], "electrical", "same-run-twice", "give each record once"),
        (
            [Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[0.0, 0.0, 0.0], current=[0.0, 1e-4, 0.0])],
            "electrical",
            "no-excitation",
            "zero throughout",
        ),
        (
            [replace(record(), voltage=1e-3 * np.random.default_rng(20261121).standard_normal(2000))],
            "electrical",
            "no-excitation",
            "as its noise is",
        ),
        # It was said that the voltage is zero.
        (
            [replace(record("step 1 V delay=1 s"), current=np.full(2000, 1e-3))],
            "electrical",
            "no-contact",
            "tighten the clamp",
        ),
    ],
)
def test_requests_that_cannot_be_met(runs: list[Run], free: str, code: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        identify(FRIEND, runs, free=free)
    assert caught.value.code == code
    assert caught.value.repair


def test_every_parameter_that_is_not_determined_is_named_by_a_direction(behind_thin_electrodes: Fit) -> None:
    force = [record("step 1 V", keep=("force",)), record("sine 1 V 0.1 Hz", keep=("force",))]
    reversed_step = replace(record(), current=-record().current)  # type: ignore[operator]
    fits = [
        brief(FRIEND, force, "coupling"),
        brief(FRIEND, record(), "electrical,circuit.contact_resistance,circuit.sheet_resistance"),
        brief(FRIEND, reversed_step),
        behind_thin_electrodes,
        brief(FRIEND, record(duration=3.0)),
    ]
    assert not fits[0].parameters["coupling.zero"].determined  # so fast that only gain times zero shows
    for fit in fits:
        for name, parameter in fit.parameters.items():
            named = any(
                abs(direction.coefficients[name]) > (1e-3 if np.isinf(direction.error) else 0.1)
                for direction in fit.undetermined
            )
            assert parameter.determined or named, name
        for direction in fit.undetermined:
            factor = re.search(r"to a factor of (\S+) only", direction.sentence)
            assert factor is None or float(factor[1]) < 1100


def test_who_interrupts_the_search_for_missing_stages_keeps_the_fit() -> None:
    strip = load_actuator("friend-2+clamp").replace(**{"clamp.direct_share": 0.5})
    run = record(actuator=strip, rate=20.0, duration=20.0)
    told: list[str] = []

    def interrupt(sentence: str, _: float) -> None:
        told.append(sentence)
        if sentence == "asking what the model lacks":
            raise KeyboardInterrupt

    fit = identify(FRIEND, run, progress=interrupt)
    assert told[-1] == "errors and intervals"
    assert "stages-not-tried" in {one.code for one in fit.findings}
    assert not fit.diagnoses
    whole = identify(FRIEND, run)
    assert whole.diagnoses
    assert {name: one.value for name, one in fit.parameters.items()} == {
        name: one.value for name, one in whole.parameters.items()
    }


def test_the_first_answer_comes_before_what_the_model_lacks() -> None:
    """Parameters and what is left are those of the whole fit."""
    run = record(rate=20.0, duration=5.0)
    came: list[str] = []
    first: list[Fit] = []

    def show(fit: Fit) -> None:
        came.append("the first answer")
        first.append(fit)

    with first_answer_to(show):
        fit = identify(FRIEND, run, progress=lambda sentence, _: came.append(sentence))
    assert came.index("the first answer") < came.index("asking what the model lacks")
    assert came.count("the first answer") == 1
    assert {name: one.value for name, one in first[0].parameters.items()} == {
        name: one.value for name, one in fit.parameters.items()
    }
    np.testing.assert_array_equal(first[0].residuals[0]["current"], fit.residuals[0]["current"])
    said = first_answer(first[0])
    assert all(name in said for name in fit.parameters)
    assert "residual of the current in " in said


def test_who_interrupts_the_intervals_keeps_the_fit() -> None:
    """With those of the standard errors, which a record that says little bends."""
    run = record(rate=20.0, duration=5.0)
    profiles: list[str] = []

    def interrupt(sentence: str, _: float) -> None:
        if sentence == "errors and intervals":
            profiles.append(sentence)
            if len(profiles) == 1:
                raise KeyboardInterrupt

    fit = identify(FRIEND, run, progress=interrupt)
    assert "intervals-not-followed" in {one.code for one in fit.findings}
    whole = identify(FRIEND, run)
    assert "intervals-not-followed" not in {one.code for one in whole.findings}
    for name, one in whole.parameters.items():
        assert fit.parameters[name].value == one.value
    bent = [name for name, one in whole.parameters.items() if fit.parameters[name].interval != one.interval]
    assert bent


def test_who_keeps_a_fit_does_so_whatever_is_compiled_for_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cross-checks simulate: on a machine where that was never compiled a report came in the midst of them."""
    completed = identify_module.with_cross_checks
    reports: list[str] = []

    def compiling(fit: Fit, runs: Sequence[Run]) -> Fit:
        aside("compiling the model")
        tick()
        return completed(fit, runs)

    def keep(sentence: str, _: float) -> None:
        reports.append(sentence)
        if "asking what the model lacks" in reports:
            raise KeyboardInterrupt

    monkeypatch.setattr(identify_module, "with_cross_checks", compiling)
    fit = identify(FRIEND, record(rate=20.0, duration=5.0), progress=keep)
    assert "stages-not-tried" in {one.code for one in fit.findings}
    assert reports[-1] == "compiling the model"


def test_a_sensor_that_drifts_is_no_model_that_explains_nothing() -> None:
    clean = simulate(FRIEND, "step 1 V delay=5 s", duration=60.0, rate=25.0)
    assert clean.current is not None
    noise = 1e-3 * np.random.default_rng(5).standard_normal(len(clean))
    read = clean.current + noise + 2e-4 * clean.time
    fit = identify(FRIEND, Run.from_arrays(time=clean.time, voltage=clean.voltage, hold=clean.hold, current=read))
    assert fit.observations[0].drift["current"] == pytest.approx(2e-4, rel=0.2)
    assert "model-explains-nothing" not in {one.code for one in fit.findings}
