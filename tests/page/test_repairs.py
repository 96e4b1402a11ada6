"""What the form of an import says to do about a mistake can be done in that form."""

from __future__ import annotations

import pytest

from ipmclab.errors import InputError
from ipmclab.page.elements.column_map import channel_tables
from ipmclab.page.sections.importing import repair_in_a_form
from ipmclab.store.import_map import ImportMap

BLANK = {"unit": "", "factor": "", "sign": "1", "zero_at": "", "sentinels": ""}


def read(period: str) -> ImportMap:
    channels = {"voltage": {"column": "U", "unit": "V"}}
    return ImportMap.from_table(
        {"file": {"format": "csv"}, "channels": channels, "sampling_period": period}, where="map"
    )


@pytest.mark.parametrize("is_text", [True, False])
@pytest.mark.parametrize("field", [{"factor": "1,5"}, {"sentinels": "x,5"}])
def test_a_comma_in_a_field_is_corrected_there(field: dict[str, str], is_text: bool) -> None:
    with pytest.raises(InputError) as refused:
        channel_tables(["U"], [{**BLANK, **field, "channel": "voltage"}])
    repair = repair_in_a_form(refused.value, refused.value.where, is_text=is_text)
    assert repair == refused.value.repair
    assert "decimal mark" not in repair


def test_a_comma_in_a_file_is_told_of_by_what_there_is() -> None:
    error = InputError("'1,5' is not a number", code="decimal-comma", repair='write decimal = "," in the map')
    where = "rig.xlsx: row 2, column 1"
    assert repair_in_a_form(error, where, is_text=True) == "choose the comma as the decimal mark"
    assert repair_in_a_form(error, where, is_text=False).startswith("correct it in a copy of the file")


@pytest.mark.parametrize("text", ["0", "-5", "20", "0 s", "0,02 s"])
def test_what_is_said_of_a_sampling_period_leads_to_one_that_is_allowed(text: str) -> None:
    with pytest.raises(InputError) as refused:
        read(text)
    repair = repair_in_a_form(refused.value, refused.value.where, is_text=False)
    if text == "0 s":
        assert repair == "give a time above 0"
    else:
        read(repair.split("'")[1])
