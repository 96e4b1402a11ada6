"""What the tests of chambers share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from ipmclab.rig.chambers import driver, watch
from tests.rig.chambers.benches_of_chambers import Quick


@pytest.fixture
def quick() -> Quick:
    """Shorter deadlines while something is waited for that does not come: what comes has its time, on any machine."""

    @contextmanager
    def shorter() -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            for name, seconds in (("READ_TIME", 1.2), ("SET_TIME", 1.5), ("SAFE_TIME", 1.0)):
                patch.setattr(driver, name, seconds)
            yield

    return shorter


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """A chamber that is read more often than once a second."""
    monkeypatch.setattr(watch, "PERIOD", 0.2)


@pytest.fixture
def quicker(monkeypatch: pytest.MonkeyPatch) -> None:
    """So short that a busy machine misses some: for tests that hold whether a call succeeds or not."""
    for name, seconds in (("READ_TIME", 0.8), ("SET_TIME", 1.0), ("SAFE_TIME", 0.8), ("AGAIN_TIME", 0.6)):
        monkeypatch.setattr(driver, name, seconds)
