"""What the tests of chambers share."""

from __future__ import annotations

import pytest

from ipmclab.rig.chambers import driver, watch


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorter deadlines, where a test would only wait for them to end."""
    for name, seconds in (("READ_TIME", 1.0), ("SET_TIME", 1.0), ("SAFE_TIME", 0.7)):
        monkeypatch.setattr(driver, name, seconds)


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """A chamber that is read more often than once a second."""
    monkeypatch.setattr(watch, "PERIOD", 0.2)


@pytest.fixture
def quicker(monkeypatch: pytest.MonkeyPatch) -> None:
    """So short that a busy machine misses some: for tests that hold whether a call succeeds or not."""
    for name, seconds in (("READ_TIME", 0.6), ("SET_TIME", 0.7), ("SAFE_TIME", 0.6), ("AGAIN_TIME", 0.4)):
        monkeypatch.setattr(driver, name, seconds)
