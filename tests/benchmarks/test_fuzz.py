"""A small twin of ``benchmarks/fuzz.py``: drawn records are answered or refused with what to do instead."""

from __future__ import annotations

import warnings

import pytest

from benchmarks.fuzz import calls, draw, fault, nan_in
from ipmclab import InputError


@pytest.mark.parametrize("number", [2, 4, 7, 11, 112, 207, 208, 252, 309, 326, 415, 828, 894])
def test_a_drawn_record_is_answered_or_refused(number: int) -> None:
    run, done = draw(number)
    found = {name: fault(call) for name, call in calls(run, number) if name in ("check", "measure", "identify")}
    assert found == {"check": None, "measure": None, "identify": None}, done


@pytest.mark.parametrize(
    ("number", "function"),
    [
        (152, "choose"),
        (164, "leave_one_run_out"),
        (359, "leave_one_run_out"),
        (584, "leave_one_run_out"),
        (752, "choose"),
    ],
)
def test_a_drawn_record_goes_through_a_function_more(number: int, function: str) -> None:
    """Fewer readings than unknowns, no noise of its own, no output in common, readings that are met exactly."""
    run, done = draw(number)
    found = {name: fault(call) for name, call in calls(run, number) if name in ("identify", function)}
    assert found == {"identify": None, function: None}, done


def test_what_counts_as_a_fault() -> None:
    def warned() -> None:
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)

    def refused(repair: str) -> None:
        raise InputError("too short", code="too-short", where="time", repair=repair)

    assert fault(lambda: refused("record longer")) is None
    assert "RuntimeWarning: overflow" in str(fault(warned))
    assert "ZeroDivisionError" in str(fault(lambda: 1 / 0))
    assert nan_in({"a": (1.0, [float("nan")])}) == "answer[a][1][0]"
    assert nan_in({"a": (1.0, [2.0])}) is None
