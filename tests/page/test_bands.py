"""What a worker says of how sure a fitted actuator is: the areas that Simulate draws."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab import identify, write_fit, write_run
from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.tasks import bands, simulate
from tests.identification.many import FRIEND, noisy

DC = "circuit.dc_resistivity"


def told(**arguments: Any) -> tuple[Frame, Frame]:
    """The area, and the curve that it lies around."""
    return bands.run(arguments, lambda *_: None), simulate.run(arguments, lambda *_: None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One mounting of a strip fitted, and three; and a run of another one, behind a shunt."""
    folder = tmp_path_factory.mktemp("bands")
    generator = np.random.default_rng(20261121)
    runs = [noisy(generator, "square 1 V 0.05 Hz", mounting=name) for name in "abc"]
    write_fit(identify(FRIEND, runs[0], free=DC), folder / "one.toml")
    write_fit(identify(FRIEND, runs, free=DC), folder / "three.toml")
    other = noisy(generator, "sine 1 V 0.2 Hz", duration=10.0)
    about = replace(other.metadata, voltage_sensed="upstream of shunt", shunt_resistance=1.0)
    for name, mounting in (("seen", "a"), ("new", "d")):
        write_run(replace(other, metadata=replace(about, mounting_id=mounting)), folder / f"{name}.nc")
    return folder


@pytest.mark.parametrize(
    ("actuator", "run", "label", "held"),
    [
        ("one", "seen", "95 % of the answer", "mounting a"),
        ("one", "new", "95 % of the answer of mounting a", "mounting a"),
        ("three", "seen", "95 % of the answer", "the mountings of the fit, a, b and c"),
        ("three", "new", "95 % at the next mounting", "the next mounting alone: this run is of mounting d"),
    ],
)
def test_over_a_run_the_area_is_that_of_its_mounting(
    folder: Path, actuator: str, run: str, label: str, held: str
) -> None:
    area, curve = told(actuator=str(folder / f"{actuator}.toml"), run=str(folder / f"{run}.nc"))
    assert area.document["label"] == label
    assert area.document["sentences"][0] == f"The 95 % intervals hold for {held}."
    low, high = area.arrays["current.low"], area.arrays["current.high"]
    # Behind the shunt too, and changes of sliders do not move it.
    np.testing.assert_allclose(0.5 * (low + high), curve.arrays["current"], rtol=1e-9, atol=1e-12)
    changed = {"actuator": str(folder / f"{actuator}.toml"), "run": str(folder / f"{run}.nc"), "changes": {DC: 10.0}}
    np.testing.assert_array_equal(bands.run(changed, lambda *_: None).arrays["current.low"], low)


def test_a_long_area_is_thinned_as_its_curve_is(folder: Path) -> None:
    asked = {"signal": "sine 1 V 0.1 Hz", "duration": 40.0, "rate": 400.0}
    area, curve = told(actuator=str(folder / "one.toml"), **asked)
    assert "time" not in area.arrays
    assert len(area.arrays["current.low"]) == len(area.arrays["current.low.time"]) < 5000
    assert area.arrays["current.high"].max() >= curve.arrays["current"].max()


def test_both_answers_say_what_the_files_were(folder: Path, tmp_path: Path) -> None:
    fitted = tmp_path / "fitted.toml"
    fitted.write_bytes((folder / "one.toml").read_bytes())
    (tmp_path / "wave.csv").write_text("0,1\n1,0\n", encoding="utf-8")
    asked = {"signal": "file wave.csv", "folder": str(tmp_path), "duration": 1.0, "rate": 10.0}
    seen = []
    for file in (fitted, tmp_path / "wave.csv", fitted):
        area, curve = told(actuator=f"{fitted}+leak.cubic", **asked)
        assert area.document["stamps"] == curve.document["stamps"]
        seen.append(curve.document["stamps"])
        os.utime(file, ns=(0, 10**18 + len(seen)))
    assert [one[0] == other[0] for one, other in pairwise(seen)] == [False, True]
    assert [one[1] == other[1] for one, other in pairwise(seen)] == [True, False]


def test_nothing_is_said_of_an_actuator_without_a_fit() -> None:
    area, _ = told(actuator="friend-2", signal="step 1 V")
    assert area.document == {"label": "", "sentences": [], "stamps": ["0", ""]}
    assert not area.arrays
