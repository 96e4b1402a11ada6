"""A fit on disk: an actuator that simulate accepts, and everything a report needs."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Fit, InputError, Run, identify, load_actuator, read_fit, simulate, write_fit

FRIEND = load_actuator("friend-2")


@pytest.fixture(scope="module")
def fit() -> Fit:
    generator = np.random.default_rng(20261121)
    clean = simulate(FRIEND, "step 1 V", duration=40.0, rate=50.0)
    assert clean.current is not None
    noisy = clean.current + 1e-4 * generator.standard_normal(2000)
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=noisy)
    return identify(FRIEND, [run], free=["electrical", "circuit.sheet_resistance"], labels=["a step"])


def test_everything_but_the_residuals_comes_back(fit: Fit, tmp_path: Path) -> None:
    path = tmp_path / "fitted.toml"
    write_fit(fit, path)
    again = read_fit(path)
    assert again.parameters == fit.parameters
    assert again.undetermined == fit.undetermined
    assert again.observations == fit.observations
    assert again.findings == fit.findings
    for what in ("rank", "singular_values", "converged", "message", "evaluations", "software_version", "runs", "noise"):
        assert getattr(again, what) == getattr(fit, what)
    assert set(again.correlations) == set(fit.correlations)
    for name, row in fit.correlations.items():
        np.testing.assert_array_equal([*again.correlations[name].values()], [*row.values()])
    assert again.actuator.parameter_values == fit.actuator.parameter_values
    assert again.residuals == ()
    assert again.runs[0][0] == "a step"


def test_the_file_is_an_actuator(fit: Fit, tmp_path: Path) -> None:
    path = tmp_path / "fitted.toml"
    write_fit(fit, path)
    predicted = simulate(load_actuator(path), "step 1 V", duration=1.0, rate=50.0)
    straight = simulate(fit.actuator, "step 1 V", duration=1.0, rate=50.0)
    np.testing.assert_array_equal(predicted.current, straight.current)
    with pytest.raises(InputError, match="exists"):
        write_fit(fit, path)
    write_fit(fit, path, overwrite=True)


def test_an_open_direction_is_never_a_number_with_a_small_error(fit: Fit, tmp_path: Path) -> None:
    path = tmp_path / "fitted.toml"
    write_fit(fit, path)
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    open_ones = [entry for entry in table["fit"]["parameters"] if not entry["determined"]]
    assert len(open_ones) == 6
    assert all(math.isinf(entry["standard_error"]) for entry in open_ones)
    # A later fit must not take them for known either.
    assert not load_actuator(path).standard_uncertainties


def test_errors_of_a_first_fit_reach_the_second(tmp_path: Path) -> None:
    generator = np.random.default_rng(20261121)
    runs = []
    for signal in ("step 1 V", "square 1 V 0.3 Hz"):
        clean = simulate(FRIEND, signal, duration=40.0, rate=50.0)
        assert clean.current is not None
        assert clean.force is not None
        runs.append(
            Run.from_arrays(
                time=clean.time,
                voltage=clean.voltage,
                current=clean.current + 1e-4 * generator.standard_normal(2000),
                force=clean.force + 1e-5 * generator.standard_normal(2000),
            )
        )
    first = identify(FRIEND, runs, free="electrical")
    known = first.actuator.standard_uncertainties["circuit.dc_resistivity"]
    assert known == first.parameters["circuit.dc_resistivity"].standard_error
    second = identify(first.actuator, runs, free="coupling.p1,coupling.p2")
    assert "fixed-uncertainty" in {finding.code for finding in second.findings}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"no \[fit\] table"),
        ("[fit]\nrank = 5\n", r"not one that identify writes"),
        (
            '[fit]\nparameters = [{ name = "circuit.dc_resistivity", interval = [1] }]\n',
            r"not one that identify writes",
        ),
    ],
)
def test_what_is_not_a_fit_is_refused(text: str, words: str, tmp_path: Path) -> None:
    from ipmclab import write_actuator

    path = tmp_path / "strip.toml"
    write_actuator(FRIEND, path)
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")
    with pytest.raises(InputError, match=words) as caught:
        read_fit(path)
    assert str(path) in str(caught.value)
