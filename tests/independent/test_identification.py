"""What a fit says, against bounds and directions computed without the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ipmclab
from tests.independent.bounds import ELECTRICAL, noisy_current, relative_errors, step_and_sine
from tests.independent.thesis import FRIEND_2, Strip, null_direction, respond, respond_between_rows

SEED = 20261121
RATE = 50.0
NOISE = 1e-4
RHO_1 = "circuit.branches.0.resistivity"
REST = ipmclab.RunMetadata(starts_from_rest=True)


def actuator_far_from(strip: Strip, folder: Path) -> ipmclab.Actuator:
    """The strip with electrical parameters that are no use as a start."""
    wrong = strip.changed(resistivities=(3.0, 3.0), permittivities=(0.01, 0.02), dc_resistance=700.0)
    path = folder / "unknown.toml"
    path.write_text(wrong.toml("unknown"), encoding="utf-8")
    return ipmclab.load_actuator(path)


def electrical_runs(strip: Strip = FRIEND_2, noise: float = NOISE, seed: int = SEED) -> list[ipmclab.Run]:
    generator = np.random.default_rng(seed)
    return [
        ipmclab.Run.from_arrays(
            time=time,
            voltage=voltage,
            current=noisy_current(strip, voltage, RATE, noise, generator),
            hold="zero",
            metadata=REST,
        )
        for time, voltage in step_and_sine()
    ]


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> ipmclab.Fit:
    folder = tmp_path_factory.mktemp("fit")
    return ipmclab.identify(actuator_far_from(FRIEND_2, folder), electrical_runs(), free=["electrical"])


def test_standard_errors_are_the_cramer_rao_bound(fit: ipmclab.Fit) -> None:
    bound = relative_errors(FRIEND_2, step_and_sine(), NOISE)
    truth = FRIEND_2.dotted()
    for name in ELECTRICAL:
        parameter = fit.parameters[name]
        assert parameter.standard_error / parameter.value == pytest.approx(bound[name], rel=0.1), name
        assert abs(parameter.value - truth[name]) < 3.5 * bound[name] * truth[name], name
        low, high = parameter.interval
        assert high - low == pytest.approx(2 * 1.96 * parameter.standard_error, rel=0.1)
        assert parameter.determined
        assert not parameter.at_bound
    assert fit.converged
    assert fit.undetermined == ()


def test_interval_covers_the_truth_over_many_noises(tmp_path: Path) -> None:
    start = actuator_far_from(FRIEND_2, tmp_path)
    truth = FRIEND_2.dotted()
    inside = total = 0
    for seed in range(40):
        found = ipmclab.identify(start, electrical_runs(seed=SEED + seed), free=["electrical"])
        for name in ELECTRICAL:
            low, high = found.parameters[name].interval
            inside += low <= truth[name] <= high
            total += 1
    # 200 intervals of 95 %: four standard deviations of a binomial are 6 %.
    assert 0.88 <= inside / total <= 1.0


def test_the_fitted_actuator_is_the_strip(fit: ipmclab.Fit) -> None:
    time, voltage = step_and_sine()[1]
    predicted = ipmclab.simulate(fit.actuator, voltage, duration=len(time) / RATE, rate=RATE)
    truth = respond(FRIEND_2, voltage, RATE, "zero")["current"]
    assert np.sqrt(np.mean((predicted.current - truth) ** 2)) < 0.1 * NOISE


def test_noise_free_simulated_runs_give_the_parameters_back(tmp_path: Path) -> None:
    library = ipmclab.load_actuator("friend-2")
    runs = [
        ipmclab.simulate(library, "step 1 V", duration=40.0, rate=RATE),
        ipmclab.simulate(library, "sine 1 V 0.1 Hz", duration=40.0, rate=RATE),
    ]
    found = ipmclab.identify(actuator_far_from(FRIEND_2, tmp_path), runs, free=["electrical"])
    for name in ELECTRICAL:
        assert found.parameters[name].value == pytest.approx(FRIEND_2.dotted()[name], rel=1e-2), name


def test_six_parameters_leave_the_analytic_direction_free(tmp_path: Path) -> None:
    found = ipmclab.identify(
        ipmclab.load_actuator("friend-2"), electrical_runs(), free=["electrical", "circuit.sheet_resistance"]
    )
    assert found.rank == 5
    assert len(found.undetermined) == 1
    direction = found.undetermined[0]
    expected = null_direction_at(found)
    ours = np.array([direction.coefficients.get(name, 0.0) for name in expected])
    analytic = np.array(list(expected.values()))
    assert set(direction.coefficients) <= set(expected)
    assert abs(ours @ analytic) / np.linalg.norm(ours) / np.linalg.norm(analytic) > 0.999
    assert "resistivity" in direction.sentence
    assert not found.parameters[RHO_1].determined
    low, high = found.parameters[RHO_1].interval
    assert low == 0.0 or high == np.inf or high / low > 3.0, "rho_1 could be anything, and the interval must say so"


def null_direction_at(found: ipmclab.Fit) -> dict[str, float]:
    """The analytic direction at the point where the fit stands (any point of the curve is as good)."""
    values = {name: parameter.value for name, parameter in found.actuator.parameters().items()}
    strip = FRIEND_2.changed(
        resistivities=tuple(values[f"circuit.branches.{i}.resistivity"] for i in range(2)),
        permittivities=tuple(values[f"circuit.branches.{i}.permittivity"] for i in range(2)),
        electrode_resistance=values["circuit.sheet_resistance"] * FRIEND_2.total_length / FRIEND_2.width,
        dc_resistance=values["circuit.dc_resistivity"] * FRIEND_2.thickness / (FRIEND_2.total_length * FRIEND_2.width),
    )
    return null_direction(strip)


def test_the_direction_published_for_friend_2() -> None:
    published = (0.998, 0.023, -0.044, -0.009, 0.008, -0.035)
    np.testing.assert_allclose(list(null_direction().values()), published, atol=6e-4)


def test_a_stated_uncertainty_of_the_sheet_resistance_is_propagated(tmp_path: Path, fit: ipmclab.Fit) -> None:
    path = tmp_path / "uncertain.toml"
    sheet = FRIEND_2.sheet_resistance
    path.write_text(
        FRIEND_2.toml().replace(
            f'sheet_resistance = "{sheet!r} ohm"',
            f'sheet_resistance = {{ value = "{sheet!r} ohm", standard_uncertainty = "{0.01 * sheet!r} ohm" }}',
        ),
        encoding="utf-8",
    )
    found = ipmclab.identify(ipmclab.load_actuator(path), electrical_runs(), free=["electrical"])
    direction = null_direction()
    for name in ELECTRICAL:
        # Along the free direction the current stays as it is: the parameters move with R_e like this.
        slope = direction[name] / direction["circuit.sheet_resistance"]
        alone = fit.parameters[name].standard_error / fit.parameters[name].value
        expected = np.hypot(alone, 0.01 * slope)
        measured = found.parameters[name].standard_error / found.parameters[name].value
        assert measured == pytest.approx(expected, rel=0.15), name
    with_it, without = found.parameters[RHO_1], fit.parameters[RHO_1]
    extra = np.sqrt(with_it.standard_error**2 - without.standard_error**2) / with_it.value
    assert extra == pytest.approx(0.29, rel=0.1)


def test_an_unmodelled_ohm_in_series_hides_in_rho_1(tmp_path: Path) -> None:
    burdened = FRIEND_2.changed(contact_resistance=1.0)
    runs = electrical_runs(burdened)
    blind = ipmclab.identify(actuator_far_from(FRIEND_2, tmp_path), runs, free=["electrical"])
    assert blind.parameters[RHO_1].value / FRIEND_2.resistivities[0] - 1.0 == pytest.approx(1.86, abs=0.12)
    aware = ipmclab.identify(actuator_far_from(burdened, tmp_path), runs, free=["electrical"])
    error = aware.parameters[RHO_1].standard_error
    assert abs(aware.parameters[RHO_1].value - FRIEND_2.resistivities[0]) < 3.5 * error


FOREIGN_RATE, FOREIGN_EDGE = 25.0, 40


def foreign_step(delay: float, hold: str = "unknown") -> ipmclab.Run:
    """A 1 V step whose edge reached the strip that part of a sample after its row (before it, if negative)."""
    rows = 1500
    time = np.arange(rows) / FOREIGN_RATE
    voltage = np.where(np.arange(rows) >= FOREIGN_EDGE, 1.0, 0.0)
    current = respond_between_rows(FRIEND_2, voltage, time, delay / FOREIGN_RATE)
    current += NOISE * np.random.default_rng(SEED).standard_normal(rows)
    return ipmclab.Run.from_arrays(time=time, voltage=voltage, current=current, hold=hold)


@pytest.mark.parametrize("delay", [0.37, -0.37, -0.01])
def test_a_foreign_step_alone_does_not_pretend_to_know_rho_1(delay: float, tmp_path: Path) -> None:
    # After an edge at an unknown instant G0 + a1 exp(-l1 t) + a2 exp(-l2 t) is seen: five numbers for five
    # parameters and the instant. Only that the instant lies within one sample bounds rho_1.
    found = ipmclab.identify(actuator_far_from(FRIEND_2, tmp_path), [foreign_step(delay)], free=["electrical"])
    rho = found.parameters[RHO_1]
    low, high = rho.interval
    assert low < FRIEND_2.resistivities[0] < high
    assert high - low > 0.4 * FRIEND_2.resistivities[0], "half a sample moves rho_1 by tens of per cent"
    for name in ELECTRICAL:
        if name != RHO_1:
            assert found.parameters[name].value == pytest.approx(FRIEND_2.dotted()[name], rel=0.06), name
    predicted = ipmclab.validate(found.actuator, electrical_runs(seed=7))
    assert predicted.scores["current"].fit_percent > 95.0


@pytest.mark.parametrize("delay", [0.37, -0.37, -0.01])
def test_a_foreign_step_beside_a_run_of_known_hold_recovers_rho_1_and_the_delay(delay: float, tmp_path: Path) -> None:
    runs = [foreign_step(delay), electrical_runs()[1]]
    found = ipmclab.identify(actuator_far_from(FRIEND_2, tmp_path), runs, free=["electrical"])
    rho, edge = found.parameters[RHO_1], found.parameters["observation.delay[0]"]
    assert rho.determined
    assert rho.standard_error < 0.05 * rho.value
    assert abs(rho.value - FRIEND_2.resistivities[0]) < 3.5 * rho.standard_error
    assert edge.standard_error < 0.1 / FOREIGN_RATE
    assert abs(edge.value - delay / FOREIGN_RATE) < 3.5 * edge.standard_error


def test_taking_the_rows_for_edges_would_have_been_wrong(tmp_path: Path) -> None:
    # The reason for the delay: the same record read as hold "zero" bends rho_1, with no residual to show for it.
    run = foreign_step(-0.37, hold="zero")
    found = ipmclab.identify(actuator_far_from(FRIEND_2, tmp_path), [run], free=["electrical"])
    assert abs(found.parameters[RHO_1].value / FRIEND_2.resistivities[0] - 1.0) > 0.2
    assert found.noise[0]["current"] < 1.1 * NOISE


def coupled_runs(*, cut: bool) -> list[ipmclab.Run]:
    """Current, force and displacement at once, from a signal that keeps moving."""
    generator = np.random.default_rng(SEED)
    time = np.arange(4000) / RATE
    voltage = 0.6 * np.sign(np.sin(2 * np.pi * 0.11 * time)) + 0.4 * np.sin(2 * np.pi * 0.53 * time)
    voltage[0] = 0.0
    clean = respond(FRIEND_2, voltage, RATE, "zero")
    noise = {"current": 1e-4, "force": 2e-5, "displacement": 2e-6}
    noisy = {name: clean[name] + level * generator.standard_normal(len(time)) for name, level in noise.items()}
    rows = slice(1717, 3717) if cut else slice(None)
    return [
        ipmclab.Run.from_arrays(
            time=time[rows] - time[rows][0],
            voltage=voltage[rows],
            hold="zero",
            **{name: values[rows] for name, values in noisy.items()},
        )
    ]


@pytest.mark.parametrize("cut", [False, True], ids=["whole", "cut from the middle"])
def test_coupling_from_several_outputs_at_once(cut: bool, tmp_path: Path) -> None:
    path = tmp_path / "unknown.toml"
    path.write_text(
        FRIEND_2.changed(
            resistivities=(3.0, 3.0),
            permittivities=(0.01, 0.02),
            dc_resistance=700.0,
            gain=1e-7,
            zero=20.0,
            p1=3.0,
            p2=2.0,
        ).toml(),
        encoding="utf-8",
    )
    found = ipmclab.identify(ipmclab.load_actuator(path), coupled_runs(cut=cut), free=["electrical", "coupling"])
    values = {name: parameter.value for name, parameter in found.actuator.parameters().items()}
    static = values["coupling.gain"] * values["coupling.zero"] / values["coupling.p2"]
    truth = FRIEND_2.gain * FRIEND_2.zero / FRIEND_2.p2
    assert static == pytest.approx(truth, rel=0.01)
    for name in ELECTRICAL:
        parameter = found.parameters[name]
        assert abs(parameter.value - FRIEND_2.dotted()[name]) < 4.0 * parameter.standard_error, name
    # At the noise floor in every output: a free run of the same record says so.
    validation = ipmclab.validate(found.actuator, coupled_runs(cut=False))
    for output, level in (("current", 1e-4), ("force", 2e-5), ("displacement", 2e-6)):
        assert validation.scores[output].rmse == pytest.approx(level, rel=0.05), output


def test_gain_and_zero_of_slow_force_data_are_not_reported_as_known(tmp_path: Path) -> None:
    # K_d (s + Z_d) with Z_d = 210 1/s: at 50 S/s with 0.1 mN of noise only the product can be seen.
    generator = np.random.default_rng(SEED)
    runs = []
    for time, voltage in step_and_sine():
        clean = respond(FRIEND_2, voltage, RATE, "zero")
        runs.append(
            ipmclab.Run.from_arrays(
                time=time,
                voltage=voltage,
                force=clean["force"] + 1e-4 * generator.standard_normal(len(time)),
                hold="zero",
                metadata=REST,
            )
        )
    found = ipmclab.identify(ipmclab.load_actuator("friend-2"), runs, free=["coupling"])
    assert not found.parameters["coupling.gain"].determined
    assert not found.parameters["coupling.zero"].determined
    assert found.undetermined
    assert any({"coupling.gain", "coupling.zero"} <= set(direction.coefficients) for direction in found.undetermined)
    values = {name: parameter.value for name, parameter in found.actuator.parameters().items()}
    static = values["coupling.gain"] * values["coupling.zero"] / values["coupling.p2"]
    assert static == pytest.approx(FRIEND_2.gain * FRIEND_2.zero / FRIEND_2.p2, rel=0.03)


def test_what_a_short_record_cannot_tell_is_not_told(tmp_path: Path) -> None:
    # 8 s of fast switching: the slow branch and the dc resistance hardly show in it.
    generator = np.random.default_rng(SEED)
    rate, rows = 500.0, 4000
    time, voltage = np.arange(rows) / rate, generator.choice([-1.0, 1.0], rows)
    clean = respond(FRIEND_2, voltage, rate, "zero")["current"]
    bound = relative_errors(FRIEND_2, [(time, voltage)], NOISE)
    hidden = [name for name, error in bound.items() if error > 0.5]
    plain = [name for name, error in bound.items() if error < 0.1]
    assert len(hidden) == 3
    assert len(plain) == 2
    truth = FRIEND_2.dotted()
    start = actuator_far_from(FRIEND_2, tmp_path)
    boasts, misses, shown, trials = [], [], 0, 12
    for trial in range(trials):
        run = ipmclab.Run.from_arrays(
            time=time, voltage=voltage, current=clean + NOISE * generator.standard_normal(rows), metadata=REST
        )
        found = ipmclab.identify(start, [run], free=["electrical"])
        shown += sum(found.parameters[name].determined for name in plain)
        boasts += [(trial, name) for name in hidden if found.parameters[name].determined]
        for name in ELECTRICAL:
            low, high = found.parameters[name].interval
            if found.parameters[name].determined and not low <= truth[name] <= high:
                misses.append((trial, name, found.parameters[name].value, found.parameters[name].standard_error))
    assert shown >= 0.95 * 2 * trials
    assert len(boasts) <= 2, "an error above 50 % means undetermined"
    assert len(misses) <= 4, misses


def test_a_contact_resistance_of_its_own_for_each_run(tmp_path: Path) -> None:
    burdened = FRIEND_2.changed(contact_resistance=2.0)
    runs = [electrical_runs()[0], electrical_runs(burdened)[0]]
    found = ipmclab.identify(
        ipmclab.load_actuator("friend-2"), runs, free=["electrical"], per_run=["circuit.contact_resistance"]
    )
    # Each record leaves one combination of contact and branch free; the difference between the two is known.
    difference = (
        found.parameters["circuit.contact_resistance[1]"].value
        - found.parameters["circuit.contact_resistance[0]"].value
    )
    assert difference == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize(
    ("free", "word"),
    [
        (["electric"], "electrical"),
        (["circuit.dc_resistivty"], "dc_resistivity"),
        (["coupling"], "force"),
        ([], "free"),
    ],
)
def test_requests_that_cannot_be_met_are_refused(free: list[str], word: str) -> None:
    with pytest.raises(ipmclab.InputError) as caught:
        ipmclab.identify(ipmclab.load_actuator("friend-2"), electrical_runs()[:1], free=free)
    assert word in str(caught.value)


def test_nothing_applied_is_refused() -> None:
    run = ipmclab.Run.from_arrays(
        time=np.arange(500) / RATE,
        voltage=np.zeros(500),
        current=NOISE * np.random.default_rng(SEED).standard_normal(500),
    )
    with pytest.raises(ipmclab.InputError, match="voltage"):
        ipmclab.identify(ipmclab.load_actuator("friend-2"), [run], free=["electrical"])


def late_step_and_sine(channel: str, level: float) -> list[dict[str, np.ndarray]]:
    """A step after 2 s of rest and a sine, one noisy channel."""
    generator = np.random.default_rng(SEED)
    time = np.arange(2000) / RATE
    records = []
    for voltage in ((time >= 2.0).astype(float), np.sin(2 * np.pi * 0.1 * time)):
        clean = respond(FRIEND_2, voltage, RATE, "zero")[channel]
        records.append({"time": time, "voltage": voltage, channel: clean + level * generator.standard_normal(2000)})
    return records


def test_an_offset_of_the_current_is_an_unknown_of_its_run(tmp_path: Path) -> None:
    records = late_step_and_sine("current", NOISE)
    records[0]["current"] = records[0]["current"] + 0.5e-3
    runs = [ipmclab.Run.from_arrays(**record, metadata=REST) for record in records]
    found = ipmclab.identify(actuator_far_from(FRIEND_2, tmp_path), runs, free=["electrical"])
    for name in ELECTRICAL:
        parameter = found.parameters[name]
        assert abs(parameter.value - FRIEND_2.dotted()[name]) < 4.0 * parameter.standard_error, name
        assert parameter.standard_error < 0.1 * parameter.value


def test_a_drifting_laser_is_not_taken_for_coupling() -> None:
    # The strip curls by 2 um/s: 100 rows of rest before the step show it.
    records = late_step_and_sine("displacement", 2e-6)
    records[0]["displacement"] = records[0]["displacement"] + 1e-4 + 2e-6 * records[0]["time"]
    runs = [ipmclab.Run.from_arrays(**record, metadata=REST) for record in records]
    found = ipmclab.identify(ipmclab.load_actuator("friend-2"), runs, free=["coupling"])
    values = {name: parameter.value for name, parameter in found.actuator.parameters().items()}
    static = values["coupling.gain"] * values["coupling.zero"] / values["coupling.p2"]
    assert static == pytest.approx(FRIEND_2.gain * FRIEND_2.zero / FRIEND_2.p2, rel=0.05)
    for name in ("coupling.p1", "coupling.p2"):
        low, high = found.parameters[name].interval
        assert low <= FRIEND_2.dotted()[name] <= high, name


def test_more_unknowns_than_rows_is_refused() -> None:
    time = np.arange(4) / RATE
    run = ipmclab.Run.from_arrays(time=time, voltage=np.ones(4), current=[0.06, 0.059, 0.058, 0.057])
    with pytest.raises(ipmclab.InputError):
        ipmclab.identify(ipmclab.load_actuator("friend-2"), [run], free=["electrical"])
