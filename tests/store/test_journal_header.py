"""The header of a journal: what it takes, and how it writes it."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from ipmclab.errors import InputError
from ipmclab.run import RunMetadata
from ipmclab.store.journal.header import JournalHeader

UUID = "3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee"
COLUMNS = ("voltage", "current", "current_quality", "output_raw")


@pytest.mark.parametrize("rate", [1e-3, 1.0, 60e3])
def test_a_header_keeps_what_it_was_given(rate: float) -> None:
    """The uuid as files have it, however it was spelled; columns also of a list; a row in a thousand seconds too."""
    spelled: Any = (f"{{{UUID.upper()}}}", rate, list(COLUMNS))
    header = JournalHeader(*spelled, hold="zero", metadata=RunMetadata(operator="Ada"), created_at="2026-11-21")
    assert (header.uuid, header.rate, header.columns) == (UUID, rate, COLUMNS)
    assert JournalHeader.from_json(header.to_json(), where="it") == header


@pytest.mark.parametrize("rate", [-50.0, 0.0, math.inf, math.nan])
def test_a_rate_that_gives_no_time_is_refused(rate: float) -> None:
    with pytest.raises(InputError, match=f"journal.rate: the rate is {rate!r}, it must be above 0; give it in Hz"):
        JournalHeader(UUID, rate, COLUMNS)


@pytest.mark.parametrize(
    ("changes", "code", "where"),
    [
        ({"rate": 0.0}, "bad-header", "journal.rate"),
        ({"rate": "fast"}, "not-a-journal", "it"),
        ({"columns": None}, "not-a-journal", "it"),
        ({"metadata": {"chambre": "on"}}, "unknown-key", "it: metadata"),
    ],
)
def test_a_header_that_cannot_be_read_says_why(changes: dict[str, Any], code: str, where: str) -> None:
    table = {**json.loads(JournalHeader(UUID, 50.0, COLUMNS).to_json()), **changes}
    with pytest.raises(InputError) as caught:
        JournalHeader.from_json(json.dumps(table).encode(), where="it")
    assert (caught.value.code, caught.value.where) == (code, where)
