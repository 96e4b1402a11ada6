"""An actuator in GNU Octave, held against ``simulate`` and the thesis's own formulas."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.signal

from ipmclab import InputError, load_actuator, simulate
from ipmclab.codegen import export_actuator

DRIVER = """
pkg load control
strip
load('drive.mat', 'u', 't');
y = lsim(ss(A, B, C, D), u, t);  % straight lines between rows
held = lsim(c2d(ss(A, B, C, D), t(2) - t(1), 'zoh'), u, t);
Lw = b * (Lt + Lc);
circuit = [pdc * h / Lw - R1, p1 * h / Lw - Rc1, p2 * h / Lw - Rc2, e1 * Lw / h - C1, e2 * Lw / h - C2];
parts = load('strip.mat');
same = [isequal(parts.A, A), isequal(parts.D, D), parts.Kd == Kd, parts.Re == Re];
save('-v6', 'out.mat', 'y', 'held', 'circuit', 'same', 'Re', 'pdc', 'Kd', 'gamma');
"""


@pytest.fixture
def octave(require: Callable[..., None]) -> str:
    program = shutil.which("octave-cli") or shutil.which("octave")
    require("octave", program)
    assert program is not None
    return program


def run_octave(program: str, folder: Path) -> None:
    (folder / "driver.m").write_text(DRIVER)
    command = [program, "--no-gui", "--no-init-file", "--norc", "driver.m"]
    done = subprocess.run(command, cwd=folder, capture_output=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.parametrize("name", ["friend-2", "friend-2+relaxation.displacement+viscoelastic"])
def test_one_lsim_equals_simulate(name: str, octave: str, tmp_path: Path) -> None:
    actuator = load_actuator(name)
    export_actuator(actuator, tmp_path / "strip.m")
    voltage = np.random.default_rng(20261121).standard_normal(500).cumsum() * 0.1
    voltage[0] = 0.0
    scipy.io.savemat(tmp_path / "drive.mat", {"u": voltage, "t": np.arange(500) / 50.0}, oned_as="column")
    run_octave(octave, tmp_path)
    found = scipy.io.loadmat(tmp_path / "out.mat")
    for hold, got in (("first", found["y"]), ("zero", found["held"])):
        run = simulate(actuator, voltage, duration=10.0, rate=50.0, hold=hold)
        for column, values in enumerate((run.current, run.applied_voltage, run.displacement, run.force)):
            assert values is not None
            assert np.abs(got[:, column] - values).max() < 1e-9 * np.abs(values).max()
    np.testing.assert_allclose(found["circuit"], 0.0, atol=1e-12)
    assert found["same"].all()
    assert found["Re"].item() == pytest.approx(8.0)  # Table 4.1: of one electrode
    assert found["gamma"].item() == 1.875


def test_a_changed_number_is_caught_by_the_check_of_the_script(octave: str, tmp_path: Path) -> None:
    export_actuator(load_actuator("friend-2"), tmp_path / "strip.m")
    scipy.io.savemat(tmp_path / "drive.mat", {"u": np.ones((5, 1)), "t": np.arange(5.0)[:, None]})
    script = tmp_path / "strip.m"
    script.write_text(script.read_text().replace("\n% Check", "\nA(1, 1) = 1.000001 * A(1, 1);\n% Check"))
    with pytest.raises(AssertionError, match="do not give what ipmclab gave"):
        run_octave(octave, tmp_path)


def test_the_mat_file_has_the_covariance_of_a_fit(tmp_path: Path) -> None:
    covariance = {"beam.modulus": {"beam.modulus": 4.0, "coupling.gain": 1.0}}
    covariance["coupling.gain"] = {"beam.modulus": 1.0, "coupling.gain": 9.0}
    export_actuator(load_actuator("friend-2"), tmp_path / "strip.m", covariance=covariance)
    found = scipy.io.loadmat(tmp_path / "strip.mat")
    assert [name.item() for name in found["names"].ravel()] == ["beam.modulus", "coupling.gain"]
    np.testing.assert_array_equal(found["covariance"], [[4.0, 1.0], [1.0, 9.0]])
    assert found["Lt"].item() == 0.025


def test_a_strip_before_a_laser_passes_its_own_check(octave: str, tmp_path: Path) -> None:
    """What the laser reads is not linear: the script said of itself that its numbers are wrong."""
    actuator = replace(load_actuator("friend-2+laser+environment.modulus"), name="mine\nerror('read as code')")
    export_actuator(actuator, tmp_path / f"{63 * 's'}.m")
    command = [octave, "--no-gui", "--no-init-file", "--norc", f"{63 * 's'}.m"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr.decode()
    told = [line for line in (tmp_path / f"{63 * 's'}.m").read_text().splitlines()[:5] if line]
    assert told[0].startswith("% mine error('read as code'): an IPMC strip")
    assert any("what a laser reads of one that bends far is another" in line for line in told)
    assert any("do not follow water and temperature" in line for line in told)


def test_states_are_of_order_1(tmp_path: Path) -> None:
    """Displacements in metres are far below the absolute tolerance of an ODE solver, 1e-6."""
    export_actuator(load_actuator("friend-2+relaxation.displacement+clamp"), tmp_path / "strip.m")
    found = scipy.io.loadmat(tmp_path / "strip.mat")
    time = np.arange(2000) * 2e-3
    _, _, states = scipy.signal.lsim((found["A"], found["B"], found["C"], found["D"]), np.ones(2000), time)
    largest = np.abs(states).max(axis=0)
    assert 0.05 < largest.min() < largest.max() < 20.0


def test_a_leak_is_there_with_its_slope_and_said_so(tmp_path: Path) -> None:
    for name, is_small in (("friend-2+leak.cubic", True), ("friend-2", False)):
        script, _ = export_actuator(load_actuator(name), tmp_path / "strip.m", overwrite=True)
        text = script.read_text()
        assert ("they hold for small voltages" in text) is is_small
        assert ("these numbers do not give what ipmclab gave" in text) is not is_small


def test_what_the_fit_left_open_stands_in_the_header(tmp_path: Path) -> None:
    entries = [{"name": "beam.modulus", "determined": False}, {"name": "beam.density", "determined": True}]
    for entry, told in zip(entries, (True, False), strict=True):
        script, _ = export_actuator(
            replace(load_actuator("friend-2"), fit_table={"parameters": [entry]}), tmp_path / "strip.m", overwrite=True
        )
        said = "% The fit does not determine beam.modulus: what depends on it is a guess.\n"
        assert (said in script.read_text()) is told


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    actuator = load_actuator("friend-2")
    for name, to, code in (
        ("a b.m", "matlab", "bad-suffix"),
        ("a.c", "matlab", "bad-suffix"),
        ("a.M", "matlab", "bad-suffix"),  # MATLAB does not find it
        ("\u00e9.m", "matlab", "bad-suffix"),
        ("_a.m", "matlab", "bad-suffix"),
        ("end.m", "matlab", "bad-suffix"),
        ("zeros.m", "matlab", "bad-suffix"),  # the script calls it, and would call itself
        ("A.m", "matlab", "bad-suffix"),  # from the second time on it would be the matrix
        ("R1.m", "matlab", "bad-suffix"),
        (f"{64 * 'a'}.m", "matlab", "bad-suffix"),
        ("a.m", "mathlab", "unknown-target"),
    ):
        with pytest.raises(InputError) as caught:
            export_actuator(actuator, tmp_path / name, to=to)
        assert caught.value.code == code
    (tmp_path / "strip.mat").touch()
    with pytest.raises(InputError, match="exists already"):
        export_actuator(actuator, tmp_path / "strip.m")
