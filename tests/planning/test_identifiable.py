"""What could be identified at all, against directions found with pencil and paper, and what fits say of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import InputError, Run, RunMetadata, identifiability, identify, load_actuator, simulate
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_file import read_fit, write_fit
from ipmclab.fit.practical import Practical
from ipmclab.identification.undetermined.closed_form import null_space
from ipmclab.identification.undetermined.exchange import series_against_branches
from ipmclab.identification.undetermined.practical import practical_from
from ipmclab.model import Actuator
from ipmclab.model.variants import with_stages
from tests.identification.brief import brief
from tests.independent.thesis import FRIEND_2, Strip, respond

SEED = 20261121
FRIEND = load_actuator("friend-2")
SHEET = "circuit.sheet_resistance"
SIX = ["electrical", SHEET]
RHO_1 = "circuit.branches.0.resistivity"
SIGNALS = ("step 1 V", "sine 1 V 0.1 Hz")


def by_hand(values: dict[str, float], branches: int) -> dict[str, float]:
    """The direction along which the current of a lumped circuit stays as it is, as relative changes of unit length.

    Behind the series resistance S is the admittance P = G + sum of g_i s/(s + r_i), g_i = 1/R_i, r_i = 1/(R_i C_i).
    Taking dt from S and putting it behind gives P/(1 + P dt), so dP = -P^2 dt. With q_i = s/(s + r_i)

        q_i^2 = q_i - r_i s/(s + r_i)^2   and   q_i q_j = (r_i q_i - r_j q_j)/(r_i - r_j),

    and each term is one of the same form again: dG = -G^2, dg_i = -(2 G g_i + g_i^2 + sum over j of
    2 g_i g_j r_i/(r_i - r_j)), dr_i = -g_i r_i.
    """
    length = values["geometry.free_length"] + values["geometry.clamped_length"]
    scale = length * values["geometry.width"] / values["geometry.thickness"]
    series = 2.0 * values[SHEET] * length / values["geometry.width"] + values["circuit.contact_resistance"]
    g = [scale / values[f"circuit.branches.{i}.resistivity"] for i in range(branches)]
    c = [scale * values[f"circuit.branches.{i}.permittivity"] for i in range(branches)]
    r = [one / other for one, other in zip(g, c, strict=True)]
    leak = scale / values["circuit.dc_resistivity"]
    found = {"circuit.dc_resistivity": leak}
    for i in range(branches):
        beside = sum(2.0 * g[j] * r[i] / (r[i] - r[j]) for j in range(branches) if j != i)
        found[f"circuit.branches.{i}.resistivity"] = 2.0 * leak + g[i] + beside
        found[f"circuit.branches.{i}.permittivity"] = -2.0 * leak - beside
    of_sheet = series - values["circuit.contact_resistance"]
    found[SHEET] = -1.0 / of_sheet
    size = float(np.linalg.norm(list(found.values())))
    sign = float(np.sign(found[RHO_1]))
    return {name: sign * value / size for name, value in found.items()}


def strip_with(branches: int, seed: int) -> Actuator:
    """A strip of any size, its branches well apart."""
    generator = np.random.default_rng([SEED, seed])
    values = {n: v for n, v in FRIEND.parameter_values.items() if not n.startswith("circuit.branches.")}
    for name in (SHEET, "circuit.dc_resistivity", "geometry.width", "geometry.thickness"):
        values[name] *= float(np.exp(generator.uniform(-1.0, 1.0)))
    values["circuit.contact_resistance"] = float(generator.uniform(0.0, 3.0))
    for i in range(branches):
        values[f"circuit.branches.{i}.resistivity"] = 0.36 * 20.0**i * float(np.exp(generator.uniform(-0.5, 0.5)))
        values[f"circuit.branches.{i}.permittivity"] = 0.12 * 2.0**i * float(np.exp(generator.uniform(-0.5, 0.5)))
    return Actuator("strip", values)


def noisy(strip: Actuator, signal: str, keep: tuple[str, ...], seed: int = 0) -> Run:
    """2,000 rows; 0.1 mA on the current, a hundredth of the largest on the others."""
    clean = simulate(strip, signal, duration=40.0, rate=50.0)
    generator = np.random.default_rng([SEED, seed, len(signal)])
    channels = {}
    for name in keep:
        values = getattr(clean, name)
        sigma = 1e-4 if name == "current" else 0.01 * float(np.abs(values).max())
        channels[name] = values + sigma * generator.standard_normal(len(values))
    rest = RunMetadata(starts_from_rest=True)
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, hold="zero", metadata=rest, **channels)


@pytest.mark.parametrize(("branches", "seed"), [(1, 0), (2, 1), (2, 2), (2, 3), (3, 4), (4, 5)])
def test_current_alone_leaves_the_direction_found_by_hand(branches: int, seed: int) -> None:
    strip = strip_with(branches, seed)
    found = identifiability(strip, free=SIX, outputs="current")
    assert found.rank == len(found.free) - 1 == 1 + 2 * branches
    expected = by_hand(dict(strip.parameter_values), branches)
    (direction,) = found.directions
    sign = np.sign(direction.coefficients[RHO_1])
    for name, value in expected.items():
        assert sign * direction.coefficients[name] == pytest.approx(value, abs=1e-6), name


@pytest.fixture(scope="module")
def six() -> Fit:
    """All six electrical parameters from current alone."""
    return identify(FRIEND, [noisy(FRIEND, signal, ("current",)) for signal in SIGNALS], free=SIX)


def test_a_fit_finds_the_same_rank_and_direction(six: Fit, tmp_path: Path) -> None:
    assert six.rank == 5
    (direction,) = six.undetermined
    for name, value in by_hand(dict(six.actuator.parameter_values), 2).items():
        assert direction.coefficients[name] == pytest.approx(value, abs=1e-6), name
    assert direction.cures == (f"measure {SHEET}", "record force", "record displacement")
    assert "measure the sheet resistance" in direction.sentence
    assert "add a force run" in direction.sentence
    write_fit(six, tmp_path / "six.toml")
    assert read_fit(tmp_path / "six.toml").undetermined == six.undetermined


def test_no_finite_standard_error_is_given_for_what_is_free(six: Fit) -> None:
    for parameter in six.parameters.values():
        assert parameter.standard_error == np.inf
        assert parameter.interval == (0.0, np.inf)
        assert not parameter.determined


def test_force_with_known_coupling_gives_rank_six_and_errors_at_the_bound() -> None:
    """Every interval is as wide as the Cramer-Rao bound allows, which central differences of another model give."""
    runs = [noisy(FRIEND, signal, ("current", "force")) for signal in SIGNALS]
    fit = identify(FRIEND, runs, free=SIX)
    assert fit.rank == 6
    assert fit.undetermined == ()
    assert identifiability(FRIEND, free=SIX, outputs=["current", "force"]).is_complete
    bound = bound_of_six(runs)
    for name, parameter in fit.parameters.items():
        low, high = parameter.interval
        assert np.log(high / low) / (2.0 * 1.96) == pytest.approx(bound[name], rel=0.1), name


def bound_of_six(runs: list[Run]) -> dict[str, float]:
    """Smallest standard errors of the logarithms of all six, from current and force."""
    names = [f"circuit.branches.{i}.{what}" for i in range(2) for what in ("resistivity", "permittivity")]
    names += ["circuit.dc_resistivity", SHEET]

    def strip_at(theta: npt.NDArray[np.float64]) -> Strip:
        rho1, eps1, rho2, eps2, dc, sheet = np.exp(theta)
        return FRIEND_2.changed(
            resistivities=(float(rho1), float(rho2)),
            permittivities=(float(eps1), float(eps2)),
            dc_resistance=float(dc) * FRIEND_2.thickness / (FRIEND_2.total_length * FRIEND_2.width),
            electrode_resistance=float(sheet) * FRIEND_2.total_length / FRIEND_2.width,
        )

    point = np.log([FRIEND_2.dotted()[name] for name in names])
    columns = []
    for place in range(len(names)):
        sides = []
        for sign in (1.0, -1.0):
            theta = point.copy()
            theta[place] += sign * 1e-5
            rows = []
            for run in runs:
                answer = respond(strip_at(theta), run.voltage, 50.0, "zero")
                clean = respond(FRIEND_2, run.voltage, 50.0, "zero")
                rows += [answer["current"] / 1e-4, answer["force"] / (0.01 * np.abs(clean["force"]).max())]
            sides.append(np.concatenate(rows))
        columns.append((sides[0] - sides[1]) / 2e-5)
    jacobian = np.stack(columns, axis=1)
    errors = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return dict(zip(names, map(float, errors), strict=True))


def test_with_the_coupling_free_and_a_slow_mode_the_series_resistance_is_named() -> None:
    slow = with_stages(FRIEND, "relaxation.force")
    # The zero lies beyond what 50 S/s show, and takes seconds to search for.
    free = [*SIX, "coupling.gain", "coupling.p1", "coupling.p2", "relaxation"]
    # Perfect readings would do: nothing is open by structure.
    assert identifiability(slow, free=free, outputs=["current", "force"]).is_complete
    runs = [noisy(slow, signal, ("current", "force")) for signal in SIGNALS]
    fit = brief(slow, runs, free, followed=False)
    assert not fit.parameters[RHO_1].determined
    named = next(direction for direction in fit.undetermined if RHO_1 in direction.sentence)
    assert named.sentence.startswith(f"{SHEET} is practically not determined")
    assert named.cures == (f"measure {SHEET}",)
    assert "measure the sheet resistance (four probes)" in named.sentence
    assert "more force or displacement does not help" in named.sentence
    assert not any("add a force run" in direction.sentence for direction in fit.undetermined)


CASES = [
    ("friend-2", "electrical,circuit.sheet_resistance,circuit.contact_resistance", ("current",)),
    ("friend-2", "coupling,beam.modulus", ("force",)),
    ("friend-2", "coupling,beam.modulus,beam.density,beam.damping_ratio", ("displacement",)),
    ("friend-2+relaxation.force", "electrical,coupling,relaxation,circuit.sheet_resistance", ("force",)),
    ("friend-2", "electrical,geometry.width,geometry.thickness", ("current",)),
    ("friend-2+leak.cubic", "electrical,leak,leak.cubic.linear", ("current",)),
]


@pytest.mark.parametrize(("name", "free", "outputs"), CASES)
def test_every_cure_that_is_named_cures(name: str, free: str, outputs: tuple[str, ...]) -> None:
    """With what it says measured, or recorded too, one more combination can be identified."""
    strip = load_actuator(name)
    found = identifiability(strip, free=free, outputs=outputs)
    assert found.directions
    for direction in found.directions:
        for cure in direction.cures:
            verb, what = cure.split()
            if verb == "measure":
                left = [one for one in found.free if one != what]
                assert identifiability(strip, free=left, outputs=outputs).rank == found.rank, cure
            else:
                assert identifiability(strip, free=free, outputs=[*outputs, what]).rank > found.rank, cure


def test_a_leak_below_its_threshold_says_nothing_of_itself() -> None:
    leaking = with_stages(FRIEND, "leak.exponential")
    below = identifiability(leaking, free="electrical,leak", voltage=1.0)
    assert below.rank == 5
    told = {name for one in below.directions for name, part in one.coefficients.items() if abs(part) > 0.5}
    assert told == {f"leak.exponential.{name}" for name in ("current_density", "threshold", "voltage_scale")}
    assert all("above the threshold" in direction.sentence for direction in below.directions)
    assert identifiability(leaking, free="electrical,leak", voltage=3.0).is_complete


def test_no_more_than_the_largest_voltage_counts_as_applied() -> None:
    """Behind hardly any resistance a leak shows from its threshold on, and not below it."""
    near = {SHEET: 1e-3, "leak.exponential.threshold": 1.0}
    leaking = with_stages(FRIEND, "leak.exponential").replace(**near)
    assert [identifiability(leaking, free="leak", voltage=one).rank for one in (0.99, 1.01)] == [0, 3]


@pytest.mark.parametrize("own", ["observation.offset.current", "observation.drift.current"])
@pytest.mark.parametrize("free", ["", "electrical"])
def test_what_a_sensor_adds_counts_as_it_does_in_a_fit(own: str, free: str) -> None:
    names = [own, *([free] if free else [])]
    clean = simulate(FRIEND, "step 1 V delay=5 s", duration=30.0, rate=20.0)
    assert clean.current is not None
    noise = 1e-5 * np.random.default_rng(SEED).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold=clean.hold)
    found = identifiability(FRIEND, free=names, outputs="current")
    assert own in found.free
    assert found.is_complete
    assert found.rank == identify(FRIEND, run, free=names).rank


def test_an_output_that_is_not_read_says_nothing_of_its_sensor() -> None:
    names = ["electrical", SHEET, "observation.offset.force", "observation.drift.current"]
    found = identifiability(FRIEND, free=names, outputs="current")
    assert (found.rank, len(found.free)) == (6, 8)
    series, sensor = sorted(found.directions, key=lambda one: abs(one.coefficients["observation.offset.force"]))
    assert sensor.cures == ("record force",)
    assert series.cures == identifiability(FRIEND, free=["electrical", SHEET]).directions[0].cures
    assert identifiability(FRIEND, free="observation.offset.force", outputs=["current", "force"]).is_complete
    nothing = identifiability(FRIEND, free="observation.drift.displacement", outputs="current")
    assert (nothing.rank, len(nothing.directions)) == (0, 1)
    assert "current says nothing of observation.drift.displacement" in str(nothing)


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({"outputs": "voltage"}, "unknown-output"),
        ({"outputs": ()}, "no-outputs"),
        ({"voltage": 0.0}, "out-of-range"),
        ({"voltage": float("nan")}, "out-of-range"),
        ({"free": "circuit.resistance"}, "unknown-parameter"),
    ],
)
def test_what_cannot_be_asked(given: dict[str, object], code: str) -> None:
    with pytest.raises(InputError) as caught:
        identifiability(FRIEND, **given)  # type: ignore[arg-type]
    assert caught.value.code == code
    assert caught.value.repair


def test_several_open_combinations_share_no_parameter_that_they_are_told_by() -> None:
    """Any matrix with a known null space gives it back, each vector with as few entries as can be."""
    generator = np.random.default_rng(SEED)
    known = np.array([[1.0, -2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0, 3.0]])
    square = np.eye(5) - np.linalg.pinv(known) @ known
    _, null = null_space(generator.standard_normal((40, 5)) @ square)
    assert null.shape == (2, 5)
    expected = known / np.linalg.norm(known, axis=1)[:, None]
    for row in expected:
        assert min(min(np.linalg.norm(one - row), np.linalg.norm(one + row)) for one in null) < 1e-9


def test_collinearity_is_that_of_brun() -> None:
    """Two columns at an angle have the index 1/sqrt(1 - |cos|), and an error 1/sin times that of each alone."""
    angle = 0.05
    sensitivity = np.array([[3.0, 7.0 * np.cos(angle), 0.0], [0.0, 7.0 * np.sin(angle), 0.0], [0.0, 0.0, 2.0]])
    found = practical_from(["a", "b", "c"], sensitivity)
    assert found.sets[0].names == ("a", "b")
    assert found.sets[0].index == pytest.approx(1.0 / np.sqrt(1.0 - np.cos(angle)), rel=1e-9)
    assert found.collinearity["a"] == pytest.approx(1.0 / np.sin(angle), rel=1e-9)
    assert found.collinearity["c"] == pytest.approx(1.0)
    covariance = np.linalg.inv(sensitivity.T @ sensitivity)
    worst = found.combinations[-1]
    row = np.array([worst.coefficients[name] for name in "abc"])
    assert worst.error == pytest.approx(np.sqrt(row @ covariance @ row), rel=1e-9)
    assert Practical.from_table(found.to_table()) == found


def test_the_accuracy_that_is_asked_for_is_enough() -> None:
    """Measured that well, the series resistance determines the branch; measured half as well, it does not."""
    names = [SHEET, RHO_1]
    slope, own = -30.0, 0.08
    covariance = np.array([[own**2, slope * own**2], [slope * own**2, slope**2 * own**2 + 0.01**2]])
    found = series_against_branches(names, covariance, np.zeros(2), 0.42, ["current", "force"])
    assert found is not None
    direction, known = found
    assert known[1, 1] == pytest.approx(0.01**2)
    assert f"to {100 * 0.42 / 30:.2g} % or better" in direction.sentence
    assert direction.coefficients[RHO_1] / direction.coefficients[SHEET] == pytest.approx(slope)
    # Where the branch is known, or would stay unknown, the series resistance is not the reason.
    assert series_against_branches(names, covariance / 1e4, np.zeros(2), 0.42, ["current"]) is None
    assert series_against_branches(names, np.diag([own**2, 4.0]), np.zeros(2), 0.42, ["current"]) is None
    assert series_against_branches(["coupling.gain", RHO_1], covariance, np.zeros(2), 0.42, ["current"]) is None
