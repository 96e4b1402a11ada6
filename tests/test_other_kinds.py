"""What is given in the place of a fit, a sweep or a list of runs: said by name, as of an actuator and a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import ipmclab
from ipmclab.errors import InputError


@pytest.mark.parametrize("given", [ipmclab.load_actuator("friend-2"), "fitted.toml", None])
@pytest.mark.parametrize(
    "call",
    [
        lambda fit: ipmclab.write_fit(fit, "fitted.toml"),
        lambda fit: ipmclab.report(fit, runs=[], path="report.html"),
        lambda fit: ipmclab.refit(fit, []),
        ipmclab.leave_one_run_out,
        ipmclab.profile,
        ipmclab.bootstrap,
        ipmclab.sample_posterior,
        ipmclab.propose_runs,
    ],
)
def test_what_is_no_fit_is_told(
    call: Callable[[Any], Any], given: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was "'Actuator' object has no attribute 'observations'"."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"is no fit; give what identify returned, or read_fit\(path\)") as caught:
        call(given)
    assert caught.value.code == "not-a-fit"
    assert str(caught.value).startswith("fit: an Actuator" if isinstance(given, ipmclab.Actuator) else "fit: a ")


def test_a_path_is_no_sweep_and_no_list_of_runs(tmp_path: Path) -> None:
    """The letters of a path were taken for runs, of which none could be read."""
    with pytest.raises(InputError, match=r'give read_sweep\("stiffness\.toml"\)'):
        ipmclab.run_sweep("stiffness.toml", tmp_path / "new")  # type: ignore[arg-type]
    run = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=1.0, rate=50.0)
    for one in ("step.nc", Path("step.nc"), run):
        with pytest.raises(InputError, match=r"not a list of runs; give a list: compare\(\[run, \.\.\.\]\)"):
            ipmclab.compare(one)  # type: ignore[arg-type]
