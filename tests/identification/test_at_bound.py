"""A parameter that ends at its bound is not found: table, verdict, file and report say so alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ipmclab import Fit, Run, identify, load_actuator, read_fit, simulate, write_fit
from ipmclab.fit.answer import answer_of
from ipmclab.fit.rows import NOT_DETERMINED
from ipmclab.reporting.tables import parameter_rows

FRIEND = load_actuator("friend-2")
SHEET, CONTACT, DC = (f"circuit.{name}" for name in ("sheet_resistance", "contact_resistance", "dc_resistivity"))


@pytest.fixture(scope="module")
def fit() -> Fit:
    """Of a strip whose electrodes conduct a little better than its file says, so that the contact ends at nothing."""
    clean = simulate(FRIEND.replace(**{SHEET: 0.99 * FRIEND[SHEET]}), "step 1 V delay=2 s", duration=40, rate=20)
    assert clean.current is not None
    noise = 5e-4 * np.random.default_rng(20261127).standard_normal(len(clean))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold="zero")
    return identify(FRIEND, run, free=[CONTACT, DC])


def test_what_ends_at_its_bound_is_not_determined_anywhere(fit: Fit, tmp_path: Path) -> None:
    """However narrow its interval is: the readings ask for a value beyond it."""
    assert fit.parameters[CONTACT].at_bound
    assert fit.parameters[CONTACT].interval[1] < 1.0
    assert {name for name, one in fit.parameters.items() if one.determined} == {DC}
    told = answer_of(fit)
    (row,) = (row for row in told.parameters if row.name == CONTACT)
    assert (row.value, row.remark) == (NOT_DETERMINED, "at its bound")
    assert "1 of its 2 parameters is not determined" in told.verdict
    assert [f"{CONTACT} is not determined: it went to its bound" in one.sentence for one in fit.undetermined] == [True]
    assert {row.name: row.determined for row in parameter_rows(fit)} == {CONTACT: False, DC: True}
    write_fit(fit, tmp_path / "fit.toml")
    again = read_fit(tmp_path / "fit.toml")
    assert {name: one.determined for name, one in again.parameters.items()} == {CONTACT: False, DC: True}
    assert CONTACT not in fit.actuator.standard_uncertainties
