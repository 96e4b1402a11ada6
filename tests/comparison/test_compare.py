"""Runs side by side: read once, whatever is wrong with one of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ipmclab
from ipmclab.comparison.compare import compare
from ipmclab.errors import InputError
from ipmclab.run import Run, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.run_file import write_run

MAPS = Path(__file__).resolve().parents[2] / "docs" / "import_maps"


@pytest.fixture(scope="module")
def sines() -> list[Run]:
    strip = ipmclab.load_actuator("friend-4-measured")
    return [ipmclab.simulate(strip, f"sine 1 V {one} Hz", duration=20.0, rate=20.0) for one in (0.1, 0.2, 0.5)]


def test_files_are_read_once_and_what_is_no_run_is_named(tmp_path: Path, sines: list[Run]) -> None:
    paths = [tmp_path / f"{place}.nc" for place in range(3)]
    for run, path in zip(sines, paths, strict=True):
        write_run(run, path)
    (tmp_path / "broken.nc").write_bytes(b"no run")
    seen: list[tuple[int, int]] = []
    found = compare([*paths, tmp_path / "broken.nc"], on_progress=lambda *done: seen.append(done))
    assert [row.run for row in found.rows] == ["0.nc", "1.nc", "2.nc"]
    assert [one.run for one in found.unread] == ["broken.nc"]
    assert seen[-1] == (4, 4)
    assert found.samples == ("friend-4",)
    assert len(found.sine_responses) == 3


def test_a_run_counts_once_whatever_files_hold_it(tmp_path: Path, sines: list[Run]) -> None:
    """A file that is named twice, or was copied, is no repeat: it would make the scatter of repeats too small."""
    (tmp_path / "copies").mkdir()
    first, copy, again = tmp_path / "first.nc", tmp_path / "copies" / "copy.nc", tmp_path / "again.nc"
    write_run(sines[0], first)
    write_run(sines[0], copy)
    write_run(replace(sines[0], metadata=replace(sines[0].metadata, recorded_at="2026-11-24T01:00:00+00:00")), again)
    found = compare([first, again, first, copy])
    assert [row.run for row in found.rows] == [first.as_posix(), "again.nc"]
    told = f"{first.as_posix()} holds the same run, and each run counts once"
    assert [(one.run, one.message) for one in found.unread] == [(first.as_posix(), told), ("copy.nc", told)]
    assert len(compare([sines[0], sines[0]]).rows) == 2  # of what is no file, who asks knows what it is
    # A record that was imported twice, from two files, is one; a simulated run of another day is another one.
    for path, source in ((first, "a.csv"), (copy, "a.xlsx")):
        about = replace(sines[0].metadata, origin="measured", source_file=source)
        write_run(replace(sines[0], metadata=about), path, overwrite=True)
    assert [row.run for row in compare([first, copy]).rows] == ["first.nc"]
    # Two that the recorder named are two: a coarse sensor at rest reads one number all the time.
    for path, name in ((first, "a"), (copy, "b")):
        about = replace(sines[0].metadata, origin="measured", uuid=name)
        write_run(replace(sines[0], metadata=about), path, overwrite=True)
    assert [row.run for row in compare([first, copy]).rows] == ["first.nc", "copy.nc"]


def test_runs_of_one_name_keep_apart(sines: list[Run]) -> None:
    nameless = [replace(run, metadata=replace(run.metadata, signal=None)) for run in sines]
    assert [row.run for row in compare([*nameless]).rows] == ["(1)", "(2)", "(3)"]


def test_a_baseline_counts_for_runs_before_it_in_the_list() -> None:
    time = np.arange(0.0, 20.0, 0.1)
    about = RunMetadata(sample=Sample("s1"), mounting_id="m1")
    moved = 1e-5 * time
    still = Run.from_arrays(time=time, voltage=0.0 * time, displacement=moved, metadata=about)
    driven = Run.from_arrays(
        time=time, voltage=(time > 1.0) * 1.0, displacement=moved + (time > 1.0) * 1e-3, metadata=about
    )
    rows = [
        compare([replace(one, file=name) for one, name in order]).rows
        for order in ([(driven, "d"), (still, "s")], [(still, "s"), (driven, "d")])
    ]
    for one in rows:
        (row,) = [row for row in one if row.run == "d"]
        assert row.baseline == "s"
        assert row.metrics["displacement.largest"].value == pytest.approx(1e-3, rel=0.02)


def test_a_baseline_in_another_air_takes_nothing(tmp_path: Path) -> None:
    """A strip that curls in the room does not at 80 %RH; rows stand as they were given, whatever is read first."""
    time = np.arange(0.0, 20.0, 0.1)

    def recorded(name: str, humidity: float, volts: float, signal: str) -> Path:
        about = RunMetadata(sample=Sample("s1"), relative_humidity=humidity, temperature=20.0, signal=signal)
        moved = (1e-5 * time if humidity < 60.0 else 0.0 * time) + volts * (time > 1.0) * 1e-3
        run = Run.from_arrays(time=time, voltage=volts * (time > 1.0), displacement=moved, metadata=about)
        write_run(run, tmp_path / f"{name}.nc")
        return tmp_path / f"{name}.nc"

    paths = [
        recorded("wet", 80.0, 1.0, "step 1 V"),
        recorded("dry", 48.0, 1.0, "step 1 V"),
        recorded("still", 46.0, 0.0, "step 0 V"),
    ]
    rows = compare(paths).rows
    assert [(row.run, row.baseline) for row in rows] == [("wet.nc", ""), ("dry.nc", "still.nc"), ("still.nc", "")]
    for row in rows[:2]:
        assert row.metrics["displacement.largest"].value == pytest.approx(1e-3, rel=0.02)


def test_what_was_not_asked_for_stays_in_the_model() -> None:
    """A factor that varies unasked would otherwise be taken for scatter."""
    from tests.comparison.campaigns import campaign

    rows = tuple(campaign(np.random.default_rng(7)))
    found = replace(compare([Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0])], by=["humidity"]), rows=rows)
    (model,) = found.models
    assert [factor.name for factor in model.factors] == ["humidity", "thickness", "loading"]
    assert [trend.factor.name for trend in found.trends] == ["humidity"]


def test_nothing_stops_at_a_record_that_says_little(tmp_path: Path) -> None:
    """No voltage, no reading, two rows, a period of four rows, a multisine that was never given out."""
    time = np.arange(40) / 2.0
    text = "multisine 1 V 0.1 Hz 0.8 Hz harmonics=odd phases=random left_out=4"
    still, wave = np.zeros(40), np.sin(2.0 * np.pi * 0.5 * time)
    runs = [
        Run.from_arrays(time=time, voltage=still, displacement=still, metadata=RunMetadata(signal=text)),
        Run.from_arrays(time=time, voltage=wave, current=still, metadata=RunMetadata(signal=text)),
        Run.from_arrays(time=time, voltage=wave, current=np.full(40, np.nan), displacement=wave),
        Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 1.0], force=[0.0, 1.0]),
        Run.from_arrays(time=time, voltage=wave),
    ]
    found = compare(runs)
    assert len(found.rows) == 5
    assert ipmclab.write_comparison(found, tmp_path / "c.html").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"by": ["tickness"]}, "unknown factor 'tickness'; did you mean 'thickness'"),
        ({"metrics": ["displacement.larges"]}, "did you mean 'displacement.largest'"),
    ],
)
def test_what_nobody_knows_is_refused(sines: list[Run], arguments: dict[str, list[str]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        compare(sines, **arguments)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no runs are given"):
        compare([])


def test_real_records_are_compared(real_runs: Path) -> None:
    """Lost lasers, bad contact, glitches: doubtful runs are named, nothing stops, and four runs decide no law."""
    names = ("step_1V", "step_2V", "step_2V_poor", "step_3V")
    runs = [
        replace(ipmclab.import_run(real_runs / f"{name}.csv.gz", MAPS / f"{name}.toml"), file=name) for name in names
    ]
    found = compare(runs, by=["voltage"])
    largest = {row.run: abs(row.metrics["displacement.largest"].value) for row in found.rows}
    assert largest["step_2V_poor"] == pytest.approx(0.43e-3, rel=0.1)
    assert "contact-missing" in found.doubtful["step_3V"]
    assert not [key for row in found.rows for key in row.metrics if key.startswith("force")]  # nothing was pushed
    assert found.performances == ()
    assert found.only_noise == (f"the force holds nothing but noise in {', '.join(names)}: it has no metrics there",)
    assert all(len(trend.not_excluded) == 5 for trend in found.trends)
    (model,) = [model for model in found.models if model.key == "displacement.largest"]
    (voltage,) = model.effects()
    assert voltage.interval is not None
    assert voltage.interval[0] < 0.1
    assert voltage.interval[1] > 10.0


def test_why_no_effect_is_told() -> None:
    """Repeats differ in nothing; two levels in two runs leave no scatter, and four runs do."""
    strip = ipmclab.load_actuator("friend-4-measured")

    def run(volts: float, place: int) -> Run:
        return replace(ipmclab.simulate(strip, f"step {volts} V", duration=10.0, rate=10.0), file=f"{place}.nc")

    repeats = compare([run(1.0, 1), run(1.0, 2)])
    assert repeats.why_no_effects.startswith("no effect: as far as is known the runs do not differ in membrane")
    two = compare([run(1.0, 1), run(2.0, 2)])
    assert two.why_no_effects.startswith("no effect: the runs differ in voltage, which takes 4 runs of one waveform")
    four = compare([run(volts, place) for place, volts in enumerate((1.0, 2.0, 3.0, 4.0))])
    assert four.why_no_effects == ""
