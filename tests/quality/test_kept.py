"""What was found of a run is found again without work, and anew where its readings have changed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ipmclab import Run, check, measure
from ipmclab.errors import InputError
from ipmclab.quality import check_together
from ipmclab.quality.kept import kept


def test_it_is_found_once_and_anew_when_a_reading_changes() -> None:
    run = Run.from_arrays(time=np.arange(50) / 50.0, voltage=np.ones(50), current=np.ones(50))
    asked = []

    def find() -> int:
        asked.append(1)
        return len(asked)

    assert (kept(run, "one", find), kept(run, "one", find)) == (1, 1)
    assert kept(run, "another", find) == 2
    current = run.current
    assert current is not None
    if not current.flags.writeable:
        current = np.array(current)
        object.__setattr__(run, "current", current)
    current[7] = 2.0
    assert kept(run, "one", find) == 3


def test_two_runs_share_nothing() -> None:
    time = np.arange(500) / 50.0
    current = 0.05 * np.exp(-time) + np.random.default_rng(20261121).normal(0.0, 1e-4, 500)
    clean = Run.from_arrays(time=time, voltage=np.ones(500), current=current)
    assert check(clean) == ()
    spiked = current.copy()
    spiked[200] = 0.15
    assert [one.code for one in check(Run.from_arrays(time=time, voltage=np.ones(500), current=spiked))] == ["spike"]


@pytest.mark.parametrize("ask", [check, measure, lambda path: measure(path, ()), lambda path: check_together([path])])
def test_a_path_is_no_run_and_who_reads_it_is_named(ask: Callable[[str], object]) -> None:
    """It was an AttributeError."""
    with pytest.raises(InputError, match=r"give read_run\('step\.nc'\)"):
        ask("step.nc")
