"""A stage that is defined in one file goes everywhere: simulation, fit, diagnosis, choice, report, command and page."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, choose, identify, load_actuator, read_fit, report, simulate, write_fit, write_run
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.model.kinds import VARIABLE, load_stages, optional_kinds, register, unregister
from ipmclab.model.stages.kind import StageKind
from ipmclab.page.jobs.tasks import find_task
from tests.page.browser.conftest import LONG, launched, open_page, served  # noqa: F401  # a fixture

STAGE = Path(__file__).parent / "second_zero.py"
TRUE = {"coupling.gain": 6.79e-9, "coupling.zero": 210.5, "second_zero.share": 0.15}
MODEL = "friend-2+second_zero"


@pytest.fixture(scope="module")
def chromium(require: Callable[[str, object], None]) -> Iterator[object]:
    """A browser for the page."""
    with launched(require) as browser:
        yield browser


@pytest.fixture(scope="module", autouse=True)
def stage() -> Iterator[None]:
    load_stages(STAGE)
    yield
    unregister("second_zero")


def recorded(signal: str, *, duration: float, rate: float, noise: float, seed: int, share: float = 0.15) -> Run:
    """A run of a strip with the stage, the displacement read with noise [m]."""
    clean = simulate(load_actuator(MODEL).replace(**{"second_zero.share": share}), signal, duration=duration, rate=rate)
    assert clean.displacement is not None
    read = clean.displacement + np.random.default_rng(seed).normal(0.0, noise, len(clean))
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, displacement=read)


@pytest.fixture(scope="module")
def run() -> Run:
    return recorded("square 1 V 0.5 Hz", duration=6.0, rate=200.0, noise=1e-6, seed=1)


@pytest.fixture(scope="module")
def fit(run: Run) -> Fit:
    far = {"coupling.gain": 1e-6, "coupling.zero": 3.0, "second_zero.share": -3.0}
    return identify(load_actuator(MODEL).replace(**far), [run], free="coupling,second_zero")


def test_the_manual_walks_through_this_very_file() -> None:
    page = (Path(__file__).parents[2] / "docs" / "extending.md").read_text("utf-8")
    assert page.partition("```python name=second_zero.py\n")[2].partition("```\n")[0] == STAGE.read_text("utf-8")


def test_it_is_simulated_as_its_formula_says() -> None:
    """The numerator of d(s) has beta d(0) s^2 more."""
    plain, richer = load_actuator("friend-2"), load_actuator(MODEL)
    share = richer["second_zero.share"]
    frequency = np.geomspace(1e-3, 1e3, 30)
    s = 2j * np.pi * frequency
    numerator = plain["coupling.gain"] * (s + plain["coupling.zero"])
    static = plain["coupling.gain"] * plain["coupling.zero"] / plain["coupling.p2"]
    for output in ("displacement", "force"):
        found = richer.frequency_response(frequency, [output]) / plain.frequency_response(frequency, [output])
        np.testing.assert_allclose(found[0], (numerator + share * static * s**2) / numerator, rtol=1e-9)


def test_at_nothing_of_it_there_is_the_actuator_without_it() -> None:
    plain, off = load_actuator("friend-2"), load_actuator(MODEL).replace(**{"second_zero.share": 0.0})
    one, other = (simulate(strip, "step 1 V", duration=2.0, rate=200.0).displacement for strip in (plain, off))
    np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-12 * np.abs(one).max())


def test_it_is_identified_from_no_start(fit: Fit) -> None:
    for name, true in TRUE.items():
        low, high = fit.parameters[name].interval
        assert low <= true <= high
        assert fit.parameters[name].determined
    assert [diagnosis.verdict for diagnosis in fit.diagnoses] == ["white"]


def test_a_fit_without_it_says_that_it_is_missing(run: Run) -> None:
    found = {finding.code: finding for finding in identify(load_actuator("friend-2"), [run], free="coupling").findings}
    assert found["stage-missing"].values["stage"] == "second_zero"
    assert "a motion that follows the edges of the voltage at once" in found["stage-missing"].message
    assert found["stage-missing"].repair.startswith(f"identify {MODEL} with second_zero free")


def test_a_slow_record_leaves_it_open_and_the_cure_is_told() -> None:
    slow = recorded("sine 1 V 0.05 Hz", duration=40.0, rate=5.0, noise=2e-5, seed=2)
    fit = identify(load_actuator(MODEL), [slow], free="second_zero")
    assert not fit.parameters["second_zero.share"].determined
    (direction,) = fit.undetermined
    assert direction.sentence.startswith("second_zero.share is not determined")
    assert direction.sentence.endswith("record displacement or force at a higher rate, with steps")


def test_a_choice_takes_it_where_it_is_and_not_where_it_is_not() -> None:
    for share, best in ((0.15, MODEL), (0.0, "friend-2")):
        runs = [
            recorded(f"square 1 V {pace} Hz", duration=4.0, rate=100.0, noise=5e-6, seed=seed, share=share)
            for seed, pace in enumerate((0.5, 0.8))
        ]
        chosen = choose(runs, ["friend-2", MODEL], free=["coupling.gain", "second_zero"])
        assert chosen.best == best


def test_its_fit_is_written_read_and_reported(run: Run, fit: Fit, tmp_path: Path) -> None:
    write_fit(fit, tmp_path / "fit.toml")
    again = read_fit(tmp_path / "fit.toml").parameters["second_zero.share"]
    assert again.value == fit.parameters["second_zero.share"].value
    page = report(fit, runs=[run], path=tmp_path / "fit.html").read_text("utf-8")
    assert "second_zero.share" in page


def test_the_command_line_knows_it_by_the_environment(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(STAGE))
    write_run(run, tmp_path / "run.nc")
    command = [sys.executable, "-m", "ipmclab", "identify", MODEL, "run.nc", "--free", "second_zero", "--json"]
    command += ["--out", "fit.toml", "--force"]
    answer = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "second_zero.share" in json.dumps(json.loads(answer.stdout))
    monkeypatch.setenv(VARIABLE, "")
    without = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert without.returncode == 2
    assert "no stage is called 'second_zero'" in without.stdout


def test_the_page_offers_it(run: Run, tmp_path: Path, monkeypatch, open_page) -> None:  # noqa: F811
    monkeypatch.setenv(VARIABLE, str(STAGE))
    write_run(run, tmp_path / "run.nc")
    with served(tmp_path) as address:
        page = open_page(f"{address}/identify?run=run.nc")
        page.get_by_label("Actuator, also").and_(page.locator("input")).first.fill(MODEL)
        page.get_by_label("second_zero", exact=True).check()
        page.get_by_label("electrical", exact=True).uncheck()
        page.get_by_text("--free second_zero").first.wait_for()


def test_what_a_worker_of_the_page_makes_of_a_fit_shows_it(run: Run, tmp_path: Path) -> None:
    """The rows of the table that the page draws."""
    write_run(run, tmp_path / "run.nc")
    asked = {"actuator": MODEL, "runs": [str(tmp_path / "run.nc")], "labels": ["run"], "free": ["second_zero"]}
    frame = find_task("identify")({**asked, "out": str(tmp_path / "fit.toml")}, lambda *_, **__: None)
    assert "second_zero.share" in {row["name"] for row in frame.document["parameters"]}


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        (StageKind("own", "own."), "it says nothing of how it is built"),
        (StageKind("own", "coupling.own.", build=lambda _count: None), "its parameters begin with 'coupling.own.'"),
        (StageKind("laser", "own.", build=lambda _count: None), "a stage of that name comes with ipmclab"),
    ],
)
def test_a_stage_that_cannot_be_is_refused(kind: StageKind, why: str) -> None:
    before = optional_kinds()
    with pytest.raises(InputError, match=why):
        register(kind)
    assert optional_kinds() == before


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no file"):
        load_stages(tmp_path / "gone.py")
