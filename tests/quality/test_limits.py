"""What is known of readings at the end of a range, where there is none and where it is the voltage's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ipmclab.quality import check, usable
from ipmclab.run import QUALITY_FLAGS, Run

Read = Callable[..., Run]
STEP = "step 1 V delay=4 s"
EDGE = 200


def test_a_row_without_a_reading_bounds_nothing(read: Read) -> None:
    """It was told as cut at nan mA."""
    current = read(STEP).channels["current"].copy()
    current[EDGE + 1] = np.nan
    bits = np.zeros(2000, dtype=np.uint8)
    bits[EDGE : EDGE + 2] = QUALITY_FLAGS["clipped"]
    run = replace(read(STEP), current=current, quality={"current": bits})
    found = {finding.code: finding for finding in check(run)}
    assert found.keys() == {"reading-missing", "clipped"}
    assert (found["clipped"].samples, found["clipped"].effect) == (((EDGE, EDGE + 1),), "lower_bound")


@pytest.mark.parametrize(("level", "effect"), [(0.02, "lower_bound"), (-0.02, "upper_bound")])
def test_a_channel_that_is_at_its_end_all_the_time_is_at_that_end(read: Read, level: float, effect: str) -> None:
    bits = np.full(2000, QUALITY_FLAGS["clipped"], dtype=np.uint8)
    run = replace(read("step 1 V"), current=np.full(2000, level), quality={"current": bits})
    (finding,) = [finding for finding in check(run) if finding.code == "clipped"]
    assert (finding.samples, finding.effect) == (((0, 2000),), effect)


@pytest.mark.parametrize("stated", [True, False])
def test_a_voltage_at_the_end_of_its_range_is_told(read: Read, stated: bool) -> None:
    """Nothing was said of it; no bound can drive a model, so its rows are used as they are."""
    run = read(STEP)
    if stated:
        run = replace(run, metadata=replace(run.metadata, ranges={"voltage": (-1.01, 1.01)}))
    else:
        run = replace(run, quality={"voltage": (run.voltage > 0.5) * np.uint8(QUALITY_FLAGS["clipped"])})
    (finding,) = check(run)
    assert finding.code == ("range-limit" if stated else "clipped")
    assert (finding.channel, finding.samples, finding.effect) == ("voltage", ((EDGE, 2000),), "none")
    assert all(mask.all() for mask in usable(run, [finding]).values())


def test_a_voltage_that_the_recorder_could_not_read_is_told(read: Read) -> None:
    """What was commanded stood there, and nothing was said."""
    bits = np.zeros(2000, dtype=np.uint8)
    bits[[500, 501, 900]] = QUALITY_FLAGS["missing"]
    run = replace(read(STEP), quality={"voltage": bits})
    (finding,) = check(run)
    assert (finding.code, finding.channel, finding.samples) == ("reading-missing", "voltage", ((500, 502), (900, 901)))
    assert all(mask.all() for mask in usable(run, [finding]).values())


def test_rows_whose_voltage_the_operator_masked_are_used_in_no_channel(read: Read) -> None:
    """The message said that they are left out, and they were not."""
    bits = np.zeros(2000, dtype=np.uint8)
    bits[300:310] = QUALITY_FLAGS["masked_by_operator"]
    run = replace(read(STEP), quality={"voltage": bits})
    masks = usable(run, check(run))
    assert masks.keys() == {"current", "displacement", "force"}
    assert all(np.flatnonzero(~mask).tolist() == list(range(300, 310)) for mask in masks.values())
