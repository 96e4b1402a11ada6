"""Another cut of a record of the fit is known again, in whole or in part; another record never is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Fit, Run, load_actuator, read_fit, simulate, validate, write_fit
from ipmclab.fit.fit_table import changed
from ipmclab.fit.row_marks import RowMarks
from ipmclab.prediction.verdict import verdict_of
from ipmclab.workflows.fitting import fit_of_runs

STRIP = load_actuator("friend-2")
RATE, ROWS = 25.0, 1500
QUANTUM = 2e-5  # A, of a coarse converter


def record(seed: int) -> Run:
    """A minute of a step, with noise of a few steps of the converter."""
    clean = simulate(STRIP, "step 1 V delay=5 s", duration=ROWS / RATE, rate=RATE)
    read = clean.current + 3e-5 * np.random.default_rng([20261121, seed]).standard_normal(ROWS)
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=QUANTUM * np.round(read / QUANTUM))


def cut(run: Run, first: int, stop: int) -> Run:
    """Some of its rows, as another program cuts a text file: the time begins again."""
    time = run.time[first:stop] - run.time[first]
    return Run.from_arrays(time=time, voltage=run.voltage[first:stop], current=run.current[first:stop])


@pytest.fixture(scope="module")
def whole() -> Run:
    return record(0)


def fitted(run: Run) -> Fit:
    return fit_of_runs(STRIP, [run], free=["circuit.dc_resistivity"], labels=["first.nc"])


@pytest.mark.parametrize(
    ("of_fit", "of_run", "shared"),
    [
        ((0, 750), (0, 1500), (0, 750)),  # a longer cut
        ((0, 1500), (0, 750), (0, 750)),  # a shorter one
        ((0, 1000), (500, 1500), (0, 500)),
        ((500, 1500), (0, 1000), (500, 1000)),
        ((400, 800), (0, 1500), (400, 800)),
        ((0, 750), (750, 1500), None),
    ],
)
def test_rows_are_known_again_in_another_cut(
    whole: Run, of_fit: tuple[int, int], of_run: tuple[int, int], shared: tuple[int, int] | None
) -> None:
    marks = RowMarks.of(cut(whole, *of_fit))
    assert marks is not None
    assert marks.rows_of(cut(whole, *of_run)) == shared


def test_another_record_under_the_same_voltage_shares_nothing(whole: Run) -> None:
    marks = RowMarks.of(whole)
    assert marks is not None
    assert all(marks.rows_of(record(seed)) is None for seed in range(1, 20))


def test_what_stands_still_marks_nothing() -> None:
    still = Run.from_arrays(time=np.arange(500) / RATE, voltage=np.zeros(500), current=np.zeros(500))
    assert RowMarks.of(still) is None
    short = Run.from_arrays(time=np.arange(30) / RATE, voltage=np.ones(30), current=np.arange(30.0))
    assert RowMarks.of(short) is None


def test_a_longer_cut_of_a_record_of_the_fit_is_told(whole: Run, tmp_path: Path) -> None:
    """The user's way: identify from the first half minute, write, read, validate on the whole minute."""
    write_fit(fitted(cut(whole, 0, 750)), tmp_path / "fitted.toml")
    told = validate(load_actuator(tmp_path / "fitted.toml"), whole)
    assert told.runs[0].rows_in_fit == (0, 750)
    assert told.as_dict()["runs"][0]["rows_in_fit"] == [0, 750]
    assert "rows-of-the-fit" in {one.code for one in told.findings}
    first, second = verdict_of(told).sentences
    assert "the model predicts 1 run that was not given to its fit as a whole: current with a fit of" in first
    assert second == (
        "The first 750 of the 1,500 rows of run 0 were given to its fit: there the scores show the fit, not a "
        "prediction."
    )


def test_a_part_of_a_run_of_the_fit_is_no_prediction_at_all(whole: Run) -> None:
    told = validate(fitted(whole), cut(whole, 100, 1400))
    assert verdict_of(told).sentences == (
        "All 1,300 rows of run 0 were given to its fit: there the scores show the fit, not a prediction.",
    )
    middle = validate(fitted(cut(whole, 400, 800)), whole)
    assert verdict_of(middle).sentences[-1].startswith("Rows 400 to 799 of the 1,500 rows of run 0 were given")


def test_other_records_and_the_very_run_are_told_as_before(whole: Run) -> None:
    fit = fitted(whole)
    other, same = validate(fit, record(1)), validate(fit, whole)
    assert (other.runs[0].rows_in_fit, other.runs[0].is_new) == (None, True)
    assert "1 run that was not given to its fit: current" in verdict_of(other).sentences[0]
    assert (same.runs[0].used_in_fit, same.runs[0].rows_in_fit, same.runs[0].is_new) == (True, None, False)


def test_a_fit_file_of_an_earlier_version_has_no_marks(whole: Run, tmp_path: Path) -> None:
    fit = fitted(whole)
    (one,) = fit.observations
    write_fit(changed(fit, observations=(replace(one, marks=None),)), tmp_path / "older.toml")
    assert "marks" not in (tmp_path / "older.toml").read_text("utf-8")
    older = read_fit(tmp_path / "older.toml")
    assert older.observations[0].marks is None
    assert validate(older, cut(whole, 0, 750)).runs[0].rows_in_fit is None


def test_marks_that_somebody_broke_are_a_bad_table(whole: Run, tmp_path: Path) -> None:
    fit = fitted(whole)
    (one,) = fit.observations
    assert one.marks is not None
    broken = changed(fit, observations=(replace(one, marks=replace(one.marks, at=one.marks.at[1:])),))
    write_fit(broken, tmp_path / "broken.toml")
    with pytest.raises(ValueError, match=r"rows and .* checks of them in 'marks'"):
        read_fit(tmp_path / "broken.toml")


@pytest.mark.parametrize("height", [-0.2, 0.2])
def test_a_longer_cut_of_a_record_of_the_fit_is_no_other_strip(whole: Run, height: float) -> None:
    """Its later rows leave the model, by a current that rises or falls: only what is seen is told."""
    fit = fitted(cut(whole, 0, 750))
    later = np.maximum(whole.time - whole.time[750], 0.0) / 30.0
    run = Run.from_arrays(time=whole.time, voltage=whole.voltage, current=whole.current + height * later)
    told = validate(fit, run)
    assert told.runs[0].rows_in_fit == (0, 750)
    said = " ".join(verdict_of(told).sentences)
    assert "It does not predict the current of run 0" in said
    assert "run 0 shares rows with the runs of the fit, so the strip is the same" in said
    assert ("The current of run 0 rises at constant voltage" in said) is (height > 0.0)
    assert "was another one" not in said
    stranger = validate(fit, Run.from_arrays(time=run.time, voltage=run.voltage, current=run.current * 1.001 + 1e-4))
    assert "strip or its state was another one" in " ".join(verdict_of(stranger).sentences)
