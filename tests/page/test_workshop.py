"""What all sections share: names that fits may have, and how a command names them."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from ipmclab import identify, load_actuator, simulate, write_actuator, write_fit, write_run
from ipmclab.campaign.state import MODELS
from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.commands import report_step, simulate_step
from ipmclab.page.fit_cards import FitCard, FitRequest, FittedFile
from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.jobs import Job, JobCancelled
from ipmclab.page.lab import Lab
from ipmclab.page.workshop import Workshop
from tests.waiting import HANGS


@pytest.fixture
def workshop(tmp_path: Path) -> Iterator[Workshop]:
    made = Workshop(Lab.open(tmp_path))
    yield made
    made.close()


@pytest.fixture
def jobs(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> list[Job]:
    """What the workers are asked for; nobody does it."""
    asked: list[Job] = []

    def submit(task: str, arguments: dict[str, object], *, title: str = "", **_: object) -> Job:
        asked.append(Job(len(asked), task, arguments, title, None))
        return asked[-1]

    monkeypatch.setattr(workshop.jobs, "submit", submit)
    return asked


def asked(name: str, actuator: str = "friend-2", runs: tuple[str, ...] = ()) -> FitRequest:
    return FitRequest(name=name, actuator=actuator, runs=runs, free=("circuit.dc_resistivity",))


def end(card: FitCard, contact_resistance: float = 1.0) -> FitCard:
    """A fit that came to something: to a strip that this resistance [ohm] tells from others."""
    known = {"circuit.contact_resistance": contact_resistance}
    write_actuator(load_actuator("friend-2").replace(**known), card.file)
    card.job._end("done", result=Frame({}, {}))
    return card


def cancel(card: FitCard) -> FitCard:
    card.job._end("cancelled", error=JobCancelled())
    return card


@pytest.mark.parametrize("name", ["friend-2", "Friend-2", "friend-2.toml", "friend-2+leak.cubic"])
def test_a_fit_is_not_saved_in_front_of_an_actuator_that_comes_along(workshop: Workshop, name: str) -> None:
    about = FittedFile(asked("fit 1"), workshop.new_scratch(".toml"), "key")
    card = FitCard(about, Job(1, "identify", {}, "fit 1", None))
    write_actuator(load_actuator("friend-2"), card.file)
    with pytest.raises(InputError, match="another actuator's name") as told:
        workshop.save_fit(card, name)
    assert "my-" in told.value.repair
    assert not list(workshop.lab.root.iterdir())
    assert workshop.save_fit(card, "my-friend-2") == "my-friend-2.toml"


def test_a_fit_is_not_called_as_an_actuator_that_there_is(workshop: Workshop) -> None:
    write_actuator(load_actuator("friend-2"), workshop.lab.root / "mine.toml")
    (workshop.lab.root / "my-plan.toml").write_text("title = 'an experiment'", encoding="utf-8")
    for name in ("friend-2", "mine.toml", "mine", "Mine"):
        with pytest.raises(InputError, match="another actuator's name"):
            workshop.identify(asked(name))
    with pytest.raises(InputError, match="another file's name"):
        workshop.identify(asked("my plan"))
    assert not workshop.fits


def test_a_name_means_one_fit(workshop: Workshop, jobs: list[Job]) -> None:
    """Two browsers are offered the same name, and both use it."""
    first = workshop.identify(asked("fit 1"))
    for name in ("fit 1", "Fit-1"):  # one file on some systems
        with pytest.raises(InputError, match="another fit's name") as told:
            workshop.identify(asked(name))
        assert told.value.where == "name"
    second = workshop.identify(asked(workshop.next_name()))
    assert second.asked.name == "fit 2"
    end(first, 1.0)
    end(second, 2.0)
    for card in (first, second):
        assert workshop.actuator_path(card.key) == workshop.actuator_path(card.asked.name) == str(card.file)
    assert workshop.models()[first.key] == "fit 1"
    with pytest.raises(InputError, match="another fit's name"):
        workshop.save_fit(second, "fit-1")
    with pytest.raises(InputError, match="another fit's name"):
        workshop.new_actuator("fit-1")
    assert workshop.save_fit(first, "fit-1") == "fit-1.toml"


def test_a_fit_that_came_to_nothing_stands_in_front_of_none(workshop: Workshop, jobs: list[Job]) -> None:
    vain = workshop.identify(asked("twin"))
    with pytest.raises(InputError, match="the fit 'twin' has no result: waiting"):
        workshop.actuator_path("twin")
    cancel(vain)
    with pytest.raises(InputError, match="the fit 'twin' has no result: cancelled") as told:
        workshop.actuator_path(vain.key)
    assert str(workshop.scratch) not in str(told.value)
    good = end(workshop.identify(asked("twin")))
    assert workshop.fits == [good]
    assert workshop.actuator_path("twin") == str(good.file)


def test_names_that_are_offered_are_free_and_never_come_again(workshop: Workshop, jobs: list[Job]) -> None:
    write_actuator(load_actuator("friend-2"), workshop.lab.root / "fit-2.toml")
    offered = []
    for _ in range(25):  # more than are kept
        offered.append(workshop.next_name())
        end(workshop.identify(asked(offered[-1])))
    assert len(workshop.fits) == 20
    assert len(set(offered)) == 25
    assert "fit 2" not in offered
    assert offered[0] == "fit 1"
    with pytest.raises(InputError, match="another fit's name"):  # a page may still show it
        workshop.identify(asked("fit 1"))
    with pytest.raises(InputError, match="'fit 1' is no longer kept") as told:
        workshop.actuator_path("fit 1")
    assert "save" in told.value.repair
    with pytest.raises(InputError, match="this fit is no longer kept"):  # as a link names it that was kept for long
        workshop.actuator_path("fit:0123abcd")


@pytest.mark.parametrize(
    "name", ["a" * 300, "../x/y", "x+leak.cubic", "x/y", "x\\y", "fit:x", "con", "x.", "x ", "", "x.TOML"]
)
def test_a_fit_has_a_name_that_a_file_can_have(workshop: Workshop, name: str) -> None:
    with pytest.raises(InputError) as told:
        workshop.identify(asked(name))
    assert (told.value.code, told.value.where) == ("bad-name", "name")
    assert len(str(told.value)) < 250
    card = FitCard(FittedFile(asked("x"), workshop.new_scratch(".toml"), "k"), Job(1, "identify", {}, "", None))
    if name.strip(" ") and not name.endswith((" ", ".TOML")):
        with pytest.raises(InputError, match="no plain"):
            workshop.save_fit(card, name)


def test_a_changed_actuator_is_saved_beside_what_there_is(workshop: Workshop) -> None:
    write_actuator(load_actuator("friend-2"), workshop.lab.root / "mine.toml")
    with pytest.raises(InputError, match=r"mine.toml exists already; choose another name$"):
        workshop.new_actuator("mine")
    with pytest.raises(InputError, match="another actuator's name"):
        workshop.new_actuator("friend-2")
    assert workshop.new_actuator("softer") == workshop.lab.root / "softer.toml"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("", "no actuator is named; choose one"),
        (" + leak.cubic", "no actuator is named; choose one"),
        (".", "there is no actuator '.'"),
        ("friend", "choose one of friend-2"),
        ("frend-2", "did you mean 'friend-2'"),
        ("LICENSE", "there is no actuator 'LICENSE'"),
        ("a" * 300, "a…'"),
        ("a" * 300 + ".toml", "not in the folder"),
    ],
)
def test_what_is_no_actuator_is_said_in_words_of_the_page(
    workshop: Workshop, name: str, words: str, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    write_actuator(load_actuator("friend-2"), elsewhere / "LICENSE")
    monkeypatch.chdir(elsewhere)  # where a server was started is no folder of the page
    with pytest.raises(InputError, match=words.replace(".", "\\.")):
        workshop.actuator_path(name)


def test_an_actuator_with_a_plus_in_the_name_of_its_file_can_be_chosen(workshop: Workshop) -> None:
    write_actuator(load_actuator("friend-2"), workshop.lab.root / "a+b.toml")
    assert load_actuator(workshop.actuator_path("a+b.toml")).name == "friend-2"
    assert load_actuator(workshop.actuator_path("a+b.toml+leak.cubic")).parameters()["leak.cubic.linear"]


def test_the_models_of_a_campaign_can_be_chosen(workshop: Workshop) -> None:
    """The page of a campaign's folder said that there was no fit yet."""
    folder = workshop.lab.root / MODELS
    folder.mkdir()
    step = simulate(load_actuator("friend-2"), "step 1 V", duration=2.0, rate=50.0)
    fit = identify(load_actuator("friend-2"), [step], free="circuit.dc_resistivity")
    write_fit(fit, folder / "strip-1.toml")
    name = f"{MODELS}/strip-1.toml"
    assert workshop.fitted_files() == [name]
    assert load_actuator(workshop.actuator_path(f"{name}+leak.cubic")).name
    assert workshop.runs_of_fit(name)[0] == []


def test_a_command_names_the_file_of_a_fit_or_makes_it_first(workshop: Workshop, jobs: list[Job]) -> None:
    root = workshop.lab.root
    one = end(workshop.identify(asked("fit 1")), 1.0)
    told = workshop.steps.repeatable(report_step(workshop.steps.file_name(one.key), ["a.nc"], [], "r.html"), [one.key])
    assert told.command.splitlines() == [
        "ipmclab identify friend-2 --free circuit.dc_resistivity --thorough --out fit-1.toml &&",
        "ipmclab report fit-1.toml --runs a.nc --out r.html",
    ]
    assert "“fit 1” is not saved" in told.note
    workshop.save_fit(one, "mine")
    saved = workshop.steps.repeatable(report_step(workshop.steps.file_name(one.key), ["a.nc"], [], "r.html"), [one.key])
    assert (saved.command, saved.note) == ("ipmclab report mine.toml --runs a.nc --out r.html", "")
    # Other hands have written another actuator there.
    write_actuator(load_actuator("friend-3-measured"), root / "mine.toml", overwrite=True)
    write_actuator(load_actuator("friend-3-measured"), root / "fit-1.toml")
    name = workshop.steps.file_name(one.key)
    assert not (root / name).exists()
    assert f"--out {name} &&" in workshop.steps.repeatable(report_step(name, [], [], "r.html"), [one.key]).command


def test_what_a_fit_says_names_the_actuator_as_its_commands_do(workshop: Workshop, jobs: list[Job]) -> None:
    """Not the file in which a worker keeps a fit that is not saved, nor the folder of the lab."""
    one = end(workshop.identify(asked("fit 1")))
    workshop.identify(asked("fit 2", one.key))
    write_actuator(load_actuator("friend-2"), workshop.lab.root / "mine.toml")
    workshop.identify(asked("fit 3", "mine.toml+leak.cubic"))
    assert [job.arguments["named"] for job in jobs] == ["friend-2", "fit-1.toml", "mine.toml+leak.cubic"]


def test_a_fit_that_started_from_fits_that_are_not_saved_can_be_repeated(
    workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a terminal in another copy of the folder, where nothing of the session is."""
    from ipmclab.cli.app import run as run_command

    root = workshop.lab.root
    strip = load_actuator("friend-2")
    for name, signal in (("step", "step 1 V"), ("sine", "sine 1 V 0.1 Hz")):
        write_run(simulate(strip, signal, duration=10.0, rate=50.0), root / f"{name}.nc")
    first = workshop.identify(asked("first", runs=("step.nc",)))
    assert first.job.future.result(HANGS)
    second = workshop.identify(replace(asked("second", "first", ("sine.nc",)), free=("circuit.contact_resistance",)))
    assert second.job.future.result(HANGS)
    workshop.fits.remove(first)  # as the oldest does
    step = simulate_step(
        workshop.steps.file_name("second"), {}, signal="step 1 V", duration=1.0, rate=50.0, is_fit=True
    )
    told = workshop.steps.repeatable(step, ["second"])
    assert [line.split()[1] for line in told.command.splitlines()] == ["identify", "identify", "simulate"]
    monkeypatch.chdir(root)
    for line in told.command.split(" &&\n"):
        assert run_command(shlex.split(line)[1:]) == 0
    assert load_actuator("second.toml").parameter_values == load_actuator(second.file).parameter_values
    for name in ("first.toml", "second.toml", "run.nc"):
        Path(name).unlink()
    exec(told.python, {})
    assert load_actuator("second.toml").parameter_values == load_actuator(second.file).parameter_values


def test_what_a_fit_cannot_start_from_is_told_before_a_worker_is_asked(workshop: Workshop, jobs: list[Job]) -> None:
    vain = cancel(workshop.identify(asked("vain")))
    with pytest.raises(IpmclabError, match="has no result"):
        workshop.identify(asked("next", "vain"))
    assert workshop.fits == [vain]
    assert len(jobs) == 1


def test_who_waits_for_a_look_waits_for_the_one_that_took_its_place(workshop: Workshop, jobs: list[Job]) -> None:
    """Of two windows the first one's look never begins: it has to follow the other's."""
    first = workshop.runs.looks()
    own = next(first)
    other = next(workshop.runs.looks())
    own._end("cancelled", error=JobCancelled())
    assert [*first] == [other]
    assert [job.task for job in jobs] == ["inspect", "inspect"]
