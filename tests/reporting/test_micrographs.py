"""Which pictures a report reads: those below the folder of the program, on every system."""

from __future__ import annotations

from pathlib import PureWindowsPath

import pytest

from ipmclab import Sample
from ipmclab.reporting.micrographs import micrographs


@pytest.mark.parametrize("name", [r"\a.png", "C:a.png", r"C:\a.png", r"\\there\share\a.png", r"..\a.png"])
def test_no_name_leads_out_of_the_folder_on_windows(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that came from elsewhere: a path without a drive, or without a root, is not absolute there."""
    monkeypatch.setattr("ipmclab.reporting.micrographs.Path", PureWindowsPath)
    (told,) = micrographs(Sample(id="a", micrographs=(name,)))
    assert (told.source, told.remark) == ("", "only pictures below the folder of the program are shown")
