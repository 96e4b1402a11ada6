"""A small twin of ``benchmarks/fuzz.py``: drawn records are answered or refused with what to do instead."""

from __future__ import annotations

import warnings

import pytest

from benchmarks.fuzz import calls, draw, fault, nan_in
from ipmclab import InputError


@pytest.mark.parametrize("number", [2, 4, 7, 11])
def test_a_drawn_record_is_answered_or_refused(number: int) -> None:
    run, done = draw(number)
    found = {name: fault(call) for name, call in calls(run, number) if name in ("check", "measure", "identify")}
    assert found == {"check": None, "measure": None, "identify": None}, done


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
