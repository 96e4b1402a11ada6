"""What a fit says of what it leaves: noise is called noise, and the stage that is missing is the one that is named."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from ipmclab import Fit, Run, identify, load_actuator, read_fit, report, simulate, write_actuator, write_fit
from ipmclab.errors import InputError
from ipmclab.fit.in_brief import in_brief
from ipmclab.fit.output_diagnosis import WORDS, OutputDiagnosis
from ipmclab.identification.diagnostics.diagnose import _incomplete, _missing
from ipmclab.identification.diagnostics.left import Left, of_voltage
from ipmclab.identification.diagnostics.residuals import _earlier
from ipmclab.identification.diagnostics.score_directions import along_directions, score_directions
from ipmclab.identification.diagnostics.stages import Tried
from ipmclab.identification.noise.pieces import Shape
from ipmclab.model import Actuator
from ipmclab.model.kinds import optional_kinds
from ipmclab.model.stages.kind import Excitation
from ipmclab.model.variants import with_stages
from ipmclab.statespace.terms import Terms
from tests.identification.brief import brief

SEED = 20261121
FRIEND = load_actuator("friend-2")
RATE = 50.0


def record(actuator: Actuator, signal: str, generator: np.random.Generator, *, duration: float = 20.0) -> Run:
    """The current of a strip that rested for a second, with 0.1 mA of white noise."""
    run = simulate(actuator, f"{signal} delay=1 s", duration=duration, rate=RATE)
    assert run.current is not None
    return with_current(run, run.current + 1e-4 * generator.standard_normal(len(run)))


def with_current(run: Run, current: np.ndarray) -> Run:
    return Run.from_arrays(time=run.time, voltage=run.voltage, current=current)


def codes(fit: Fit) -> set[str]:
    return {finding.code for finding in fit.findings}


@pytest.fixture(scope="module")
def white() -> Fit:
    generator = np.random.default_rng(SEED)
    return identify(FRIEND, [record(FRIEND, signal, generator) for signal in ("step 1 V", "sine 1 V 0.1 Hz")])


@pytest.fixture(scope="module")
def lacking() -> Fit:
    """Fitted without the third branch that the strip has."""
    strip = with_stages(FRIEND, "branches=3").replace(
        **{"circuit.branches.2.resistivity": 30.0, "circuit.branches.2.permittivity": 0.02}
    )
    generator = np.random.default_rng(SEED)
    return identify(FRIEND, [record(strip, signal, generator) for signal in ("step 1 V", "sine 1 V 0.1 Hz")])


# --- noise -----------------------------------------------------------------------------------------------------------


def test_white_noise_is_called_white_and_its_correlations_lie_within_the_band(white: Fit) -> None:
    assert [(one.output, one.verdict) for one in white.diagnoses] == [("current", "white")] * 2
    assert not codes(white) & {"stage-missing", "model-incomplete"}
    for one in white.diagnoses:
        assert one.band == pytest.approx(1.96 / math.sqrt(1000), rel=1e-4)
        assert one.rms == pytest.approx(1e-4, rel=0.06)
        inside = np.abs([*one.whitened, *one.autocorrelation, *one.with_voltage]) <= one.band
        assert inside.mean() > 0.85  # 95 % of correlations that are correlated themselves
        assert max(map(abs, (*one.whitened, *one.with_voltage))) < 3.0 * one.band
        assert one.lags[0] == pytest.approx(1.0 / RATE)
        assert one.lags[-1] == pytest.approx(0.25 * 20.0)


def test_noise_that_hangs_together_is_no_missing_stage() -> None:
    generator = np.random.default_rng(SEED)
    for kind in ("AR(1)", "walk", "drift"):
        runs = []
        for signal in ("step 1 V", "sine 1 V 0.1 Hz"):
            run = record(FRIEND, signal, generator)
            new = generator.standard_normal(len(run))
            added = {
                "AR(1)": lfilter([1.0], [1.0, -0.9], new),
                "walk": 0.2 * np.cumsum(new),
                "drift": 5.0 * np.linspace(-1.0, 1.0, len(run)),
            }[kind]
            assert run.current is not None
            runs.append(with_current(run, run.current + 1e-4 * added))
        fit = identify(FRIEND, runs)
        assert {one.verdict for one in fit.diagnoses} <= {"autocorrelated", "white"}, kind
        assert "autocorrelated" in {one.verdict for one in fit.diagnoses}, kind
        assert not codes(fit) & {"stage-missing", "model-incomplete"}, kind
        coloured = [one for one in fit.diagnoses if one.verdict == "autocorrelated"]
        for one in coloured:
            # What is new in each residual is white although the residuals are not.
            assert max(map(abs, one.whitened)) < 4.0 * one.band


def both_outputs(signal: str, generator: np.random.Generator, strip: Actuator = FRIEND, motion: float = 4e-6) -> Run:
    """Current and displacement of the strip, each under an autoregression of its own."""
    clean = simulate(strip, signal, duration=30.0, rate=25.0)
    noise = [lfilter([0.3], [1.0, -0.95], generator.standard_normal(len(clean) + 200))[200:] for _ in range(2)]
    assert clean.current is not None
    assert clean.displacement is not None
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + 1e-4 * noise[0],
        displacement=clean.displacement + motion * noise[1],
    )


@pytest.fixture(scope="module")
def of_both() -> Fit:
    return identify(
        FRIEND, both_outputs("square 1 V 0.1 Hz", np.random.default_rng(SEED)), free=["electrical", "coupling"]
    )


def test_the_noise_of_one_output_is_no_stage_that_the_other_misses(of_both: Fit) -> None:
    """Both share the circuit: a displacement whose noise counted as white would hold it where that noise has put it."""
    generator = np.random.default_rng(SEED)
    others = [both_outputs(signal, generator) for signal in ("step 1 V delay=1 s", "square 1 V 0.1 Hz")]
    for fit in (of_both, *(identify(FRIEND, run, free=["electrical", "coupling"]) for run in others)):
        assert [one.verdict for one in fit.diagnoses] == ["autocorrelated", "autocorrelated"]
        assert not codes(fit) & {"stage-missing", "model-incomplete"}


def test_what_one_output_shows_of_a_stage_counts_once() -> None:
    """A displacement that adds nothing about the current adds no evidence, autocorrelated though it is."""
    strip = with_stages(FRIEND, "branches=3").replace(
        **{"circuit.branches.2.resistivity": 30.0, "circuit.branches.2.permittivity": 0.04}
    )
    run = both_outputs("step 5 V delay=1 s", np.random.default_rng(SEED), strip, 2e-4)
    alone, both = (identify(FRIEND, run, free=free) for free in ("electrical", ["electrical", "coupling"]))
    evidence = [
        finding.values["evidence"]
        for fit in (alone, both)
        for finding in fit.findings
        if finding.code == "stage-missing"
    ]
    assert len(evidence) == 2
    assert evidence[1] == pytest.approx(evidence[0], rel=0.25)


def test_what_the_voltage_explains_is_weighed_by_the_noise_of_both_outputs(of_both: Fit) -> None:
    """Against generalised least squares by NumPy, with the covariances of both noises in full."""
    assert of_both.estimate is not None
    left = Left.of(of_both.estimate, "current")
    shapes = {**left.shapes, **{piece.key: shape for piece, shape in left.beside.items()}}
    assert {key[1] for key in shapes} == {"current", "displacement"}
    added = of_voltage(left.problem, left.theta, "current")
    rows = np.column_stack([left.here.jacobian, added.T])
    constants, root = [], np.eye(len(left.here.residual))
    for (place, output), shape in shapes.items():
        piece = left.problem.pieces[place, output]
        time = left.problem.records[place].run.time
        wandered = float(np.tanh(shape.entries[0])) ** np.abs(np.subtract.outer(range(len(time)), range(len(time))))
        root[piece, piece] = np.linalg.inv(
            np.linalg.cholesky(shape.variance / (1.0 - np.tanh(shape.entries[0]) ** 2) * wandered)
        )
        some = [np.ones(len(time))] * shape.terms.offset + [time - time.mean()] * shape.terms.trend
        constants += [np.bincount(np.arange(piece.start, piece.stop), one, len(root)) for one in some]
    squares = []
    for columns in (rows[:, : -len(added)], rows):
        wide = root @ np.column_stack([columns, *constants])
        wide = wide / np.maximum(np.linalg.norm(wide, axis=0), 1e-300)
        answer = np.linalg.lstsq(wide, root @ left.here.residual, rcond=1e-9)[0]
        squares.append(float(np.sum((root @ left.here.residual - wide @ answer) ** 2)))
    assert left.evidence(added).together(left.shapes) == pytest.approx(squares[0] - squares[1], rel=0.02, abs=0.05)


# --- the stage that is missing ---------------------------------------------------------------------------------------


def test_a_third_branch_is_missed_and_named(lacking: Fit) -> None:
    (said,) = (finding for finding in lacking.findings if finding.code == "stage-missing")
    assert "friend-2+branches=3" in said.repair
    assert "what is left of the current" in said.message
    assert float(said.values["explained"]) > 0.9  # type: ignore[arg-type]
    assert {one.verdict for one in lacking.diagnoses} == {"follows the voltage"}
    assert max(abs(value) for one in lacking.diagnoses for value in one.with_voltage) > lacking.diagnoses[0].band


def test_the_richer_model_is_named_as_it_is_loaded(tmp_path: Path) -> None:
    """The file that was fitted, not the name inside it; and each stage once, with its new count."""
    write_actuator(replace(FRIEND, name="nuaa"), tmp_path / "1V.toml")
    given = load_actuator(f"{tmp_path / '1V.toml'}+branches=2+line.modes")
    strip = with_stages(given, "branches=3").replace(
        **{"circuit.branches.2.resistivity": 30.0, "circuit.branches.2.permittivity": 0.02}
    )
    generator = np.random.default_rng(SEED)
    runs = [record(strip, signal, generator) for signal in ("step 1 V", "sine 1 V 0.1 Hz")]
    fit = brief(given, runs, diagnosed=True, followed=False)
    (said,) = (finding for finding in fit.findings if finding.code == "stage-missing")
    named = said.repair.split()[1]
    assert said.repair.startswith(f"identify {tmp_path / '1V.toml'}+line.modes+branches=3 ")
    assert set(load_actuator(named).parameter_values) == set(strip.parameter_values)


@pytest.mark.parametrize(
    ("stage", "change"),
    [("leak.cubic", {"leak.cubic.cubic": 5.0}), ("leak.exponential", {"leak.exponential.current_density": 15.0})],
)
def test_the_form_of_the_leak_that_is_missing_is_named(stage: str, change: dict[str, float]) -> None:
    strip = with_stages(FRIEND, stage).replace(**change)
    generator = np.random.default_rng(SEED)
    fit = identify(
        FRIEND, [record(strip, signal, generator, duration=40.0) for signal in ("step 2 V", "sine 2.5 V 0.1 Hz")]
    )
    (said,) = (finding for finding in fit.findings if finding.code == "stage-missing")
    assert said.values["stage"] == stage
    assert f"identify friend-2+{stage} with leak free" in said.repair


def test_a_line_that_is_missing_is_named_where_a_clamp_would_explain_most_of_it() -> None:
    """The fit without it is so far off that the line starts afresh, the zero of the current among its unknowns."""
    generator = np.random.default_rng(SEED)
    strip = with_stages(FRIEND, "line.modes")
    runs = []
    for signal in ("step 1 V delay=1 s", "sine 1 V 0.1 Hz"):  # the sine shows no zero of the current
        run = simulate(strip, signal, duration=20.0, rate=RATE)
        assert run.current is not None
        runs.append(with_current(run, run.current + 1e-4 * generator.standard_normal(len(run))))
    (said,) = [finding for finding in identify(FRIEND, runs).findings if finding.code == "stage-missing"]
    assert said.values["stage"] == "line.modes"


def test_what_follows_the_voltage_and_no_stage_explains_is_called_so() -> None:
    """An echo of the voltage half a second later: no part of a strip answers like that."""
    generator = np.random.default_rng(SEED)
    run = simulate(FRIEND, "prbs 1 V bit_time=0.4 s", duration=40.0, rate=RATE)
    rows = round(0.5 * RATE)
    echo = np.concatenate([np.zeros(rows), run.voltage[:-rows]])
    assert run.current is not None
    fit = identify(FRIEND, with_current(run, run.current + 4e-4 * echo + 1e-4 * generator.standard_normal(len(run))))
    (one,) = fit.diagnoses
    assert one.verdict == "follows the voltage"
    assert "model-incomplete" in codes(fit) or "stage-missing" in codes(fit)
    # It shows where it was put in.
    found = dict(zip(one.lags, one.with_voltage, strict=True))
    nearest = min(found, key=lambda lag: abs(lag - 0.5))
    assert abs(found[nearest]) > 3.0 * one.band


@pytest.mark.parametrize(
    ("evidence", "said"),
    [
        (
            {"branches=3": (30.0, 0.12), "clamp": (-3.0, 0.4)},
            "branches=3 explains most, 12 % of the power beyond noise",
        ),
        (
            {"branches=3": (30.0, 0.12), "clamp": (9.0, 1.0)},
            "clamp explains most, 100 % of the power beyond noise, which noise",
        ),
        # A share that a chance fit would give as well is none.
        ({"branches=3": (-1.0, 0.12), "clamp": (-3.0, 0.4)}, "none explains any of it (branches=3, clamp)"),
    ],
)
def test_what_was_tried_is_told_with_what_the_best_of_it_explains(
    evidence: dict[str, tuple[float, float]], said: str
) -> None:
    left: Any = SimpleNamespace(output="current", follows=True)
    told = _incomplete(left, [Tried(name, gain, {"current": share}) for name, (gain, share) in evidence.items()], "")
    (line,), _ = in_brief([told], ["current"])
    start = "what is left of the current follows the voltage; of the stages that were tried"
    assert line.text.startswith(f"{start} {said}")
    assert line.text.endswith("(branches=3, clamp)")


@pytest.mark.parametrize(
    ("shares", "output"),
    [
        ({"current": 0.01, "displacement": 0.5}, "displacement"),
        ({"current": 0.6, "displacement": 0.9}, "current"),
    ],
)
def test_a_stage_is_named_at_the_output_of_which_it_explains_something(shares: dict[str, float], output: str) -> None:
    """A leak shows in the current; where the motion alone asks for one, "1 % of the current" says nothing of why."""
    said = _missing(FRIEND, [Tried("leak.cubic", 100.0, shares)], "")
    assert said.channel == output
    assert f"what is left of the {output} shows" in said.message
    assert said.values["explained"] == shares[output]


def test_gains_of_additions_are_those_of_linear_regression(lacking: Fit) -> None:
    """Under white noise: what a regression with one column more leaves less, as NumPy finds it."""
    assert lacking.estimate is not None
    left = Left.of(lacking.estimate, "current")
    some = score_directions(FRIEND, [record.run for record in left.problem.records], ["current"])
    kept, rows = along_directions(left.problem, left.theta, FRIEND, some, "current")
    assert {one.stage for one in kept} >= {"branches=3", "clamp", "leak.cubic", "line.modes"}
    white = {piece.key: Shape(Terms(), np.zeros(0), 1.0) for piece in left.pieces}
    gains, sizes = left.evidence(rows).alone(white)
    jacobian, residual = left.here.jacobian, left.here.residual
    before = np.linalg.lstsq(jacobian, residual, rcond=1e-9)
    own = residual - jacobian @ before[0]
    for row, gain, size in zip(rows, gains, sizes, strict=True):
        scaled = row / np.linalg.norm(row)
        wide = np.column_stack([jacobian, scaled])
        answer = np.linalg.lstsq(wide, residual, rcond=1e-9)[0]
        rest = residual - wide @ answer
        beside = scaled - jacobian @ np.linalg.lstsq(jacobian, scaled, rcond=1e-9)[0]
        if beside @ beside < 1e-6:  # the fit can do the same to a thousandth
            assert gain == size == 0.0
            continue
        assert abs(gain) == pytest.approx(own @ own - rest @ rest, rel=1e-3, abs=1e-3)
        assert size * np.linalg.norm(row) == pytest.approx(-answer[-1], rel=1e-3, abs=1e-2)


def test_columns_of_the_voltage_are_its_exact_lags(white: Fit) -> None:
    """Against the closed form of a first-order lag of a step."""
    assert white.estimate is not None
    left = Left.of(white.estimate, "current")
    rows = of_voltage(left.problem, left.theta, "current")
    piece = left.problem.pieces[0, "current"]
    time = left.problem.records[0].run.time - 1.0
    noise = left.problem.noise[0, "current"]
    longest = 20.0 - 1.0 / RATE
    expected = np.where(time >= -1e-9, 1.0 - np.exp(-np.maximum(time, 0.0) / (0.02 * longest)), 0.0) * 0.02 * longest
    assert rows[3, piece] * noise == pytest.approx(expected, abs=1e-9)
    assert rows[0, piece] * noise == pytest.approx((time >= -1e-9).astype(float))


# --- where it is kept and shown --------------------------------------------------------------------------------------


def test_a_diagnosis_goes_into_the_file_and_back(lacking: Fit, tmp_path: Path) -> None:
    write_fit(lacking, tmp_path / "fitted.toml")
    again = read_fit(tmp_path / "fitted.toml")
    assert again.diagnoses == lacking.diagnoses
    text = (tmp_path / "fitted.toml").read_text(encoding="utf-8").replace("follows the voltage", "is a mystery")
    (tmp_path / "other.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="not one that identify writes"):
        read_fit(tmp_path / "other.toml")


numbers = st.floats(-1.0, 1.0)


@given(st.text(max_size=8), st.sampled_from(list(WORDS)), st.lists(st.tuples(numbers, numbers, numbers, numbers)))
def test_any_diagnosis_survives_its_table(label: str, verdict, rows) -> None:  # type: ignore[no-untyped-def]
    lags, *columns = [tuple(column) for column in zip(*rows, strict=True)] or [(), (), (), ()]
    one = OutputDiagnosis(label, "force", verdict, 1e-3, 2e-3, lags, *columns, 0.1)
    assert OutputDiagnosis.from_table(one.to_table()) == one


def test_the_report_shows_what_is_left(white: Fit, tmp_path: Path) -> None:
    assert white.estimate is not None
    runs = [one.run for one in white.estimate.problem.records]
    page = report(white, runs=runs, path=tmp_path / "report.html").read_text(encoding="utf-8")
    assert "What is left, and whether it follows the voltage" in page
    assert page.count("current: white noise") == 2


def left_of(voltage: np.ndarray) -> Left:
    """A current that is autocorrelated, under a voltage that nothing but the voltage's own shape is asked of."""
    record = SimpleNamespace(run=SimpleNamespace(voltage=voltage), readings={"current": None})
    problem: Any = SimpleNamespace(records=[record])
    nothing: Any = None
    return Left("current", problem, np.zeros(0), nothing, (), {}, frozenset({0}))


def test_a_single_step_cannot_show_that_the_answer_bends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the likelihood says: the voltage and its square are the same signal there, which two heights are not."""
    monkeypatch.setattr(Left, "_chance", lambda _self, *, bent: 0.0 if bent else 1.0)
    step = np.repeat([0.0, 1.5], 50)
    assert not left_of(step).bends
    assert left_of(np.concatenate([step, 2.0 * step])).bends
    assert left_of(np.sin(0.1 * np.arange(100))).bends


@pytest.mark.parametrize(("start", "before"), [("free", 2.0), ("rest", 0.0)])
def test_before_its_first_row_a_strip_saw_nothing_or_the_first_voltage(start: str, before: float) -> None:
    """A record that starts anywhere is taken to have stood at its first voltage, one from rest at none."""
    record: Any = SimpleNamespace(run=SimpleNamespace(voltage=np.array([2.0, 3.0, 5.0, 7.0])), start=start)
    assert _earlier(record, (1, 2)).tolist() == [[before, 2.0, 3.0, 5.0], [before, before, 2.0, 3.0]]


@pytest.mark.parametrize("voltage", [1e-110, 200.0, 1e9])
def test_a_voltage_beyond_all_reason_asks_for_no_leak_that_is_no_number(voltage: float) -> None:
    excitation = Excitation(outputs=("current",), lags=(1.0,), voltage=voltage, current_density=1.0)
    trials = [trial for kind in optional_kinds() for trial in kind.trials(FRIEND.parameter_values, excitation)]
    assert np.isfinite([value for trial in trials for value in trial.values.values()]).all()


def test_a_leak_is_tried_above_electrolysis_at_a_thousandth_of_the_current() -> None:
    """By laws of which one is nearly a multiple of any whose scale is 0.15 to 2 V."""

    def tried(voltage: float, name: str = "leak.exponential", **more: float) -> list[dict[str, float]]:
        asked = Excitation(outputs=("current",), lags=(1.0,), voltage=voltage, current_density=7.0)
        (kind,) = (one for one in optional_kinds() if one.name == name)
        return [dict(trial.values) for trial in kind.trials({**FRIEND.parameter_values, **more}, asked)]

    voltage = np.linspace(0.0, 2.5, 200)

    def law(scale: float) -> np.ndarray:
        return np.expm1(np.maximum(voltage - 1.23, 0.0) / scale)

    shapes = []
    for values in tried(2.5):
        assert values["leak.exponential.threshold"] == 1.23
        shape = law(values["leak.exponential.voltage_scale"])
        assert values["leak.exponential.current_density"] * shape[-1] == pytest.approx(7.0e-3)
        shapes.append(shape / np.linalg.norm(shape))
    for scale in np.geomspace(0.15, 2.0, 10):
        found = law(scale)
        assert max(shape @ found for shape in shapes) > 0.96 * np.linalg.norm(found)
    assert tried(2.0, "leak.cubic") == [{"leak.cubic.cubic": pytest.approx(7.0e-3 / 8.0)}]
    assert not tried(2.0, "leak.cubic", **{"leak.exponential.current_density": 1.0})
    assert not tried(1.23)
    assert not tried(2.5, **{"leak.cubic.cubic": 1.0})
