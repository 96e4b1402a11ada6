"""What all sections share: names that fits may have."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from ipmclab import load_actuator, write_actuator
from ipmclab.errors import InputError
from ipmclab.page.jobs.jobs import Job
from ipmclab.page.lab import Lab
from ipmclab.page.workshop import FitCard, FitRequest, Workshop


@pytest.fixture
def workshop(tmp_path: Path) -> Iterator[Workshop]:
    made = Workshop(Lab.open(tmp_path))
    yield made
    made.close()


def asked(name: str) -> FitRequest:
    return FitRequest(name=name, actuator="friend-2", runs=(), free=("electrical",))


@pytest.mark.parametrize("name", ["friend-2", "Friend-2", "friend-2.toml", "friend-2+leak.cubic"])
def test_a_fit_is_not_saved_in_front_of_an_actuator_that_comes_along(workshop: Workshop, name: str) -> None:
    card = FitCard(asked("fit 1"), workshop.new_scratch(".toml"), Job(1, "identify", {}, "fit 1", None), "key")
    write_actuator(load_actuator("friend-2"), card.file)
    with pytest.raises(InputError, match="another actuator's name") as told:
        workshop.save_fit(card, name)
    assert "my-" in told.value.repair
    assert not list(workshop.lab.root.iterdir())
    assert workshop.save_fit(card, "my-friend-2") == "my-friend-2.toml"


def test_a_fit_is_not_called_as_an_actuator_that_there_is(workshop: Workshop) -> None:
    write_actuator(load_actuator("friend-2"), workshop.lab.root / "mine.toml")
    for name in ("friend-2", "mine.toml"):
        with pytest.raises(InputError, match="another actuator's name"):
            workshop.identify(asked(name))
    assert not workshop.fits
