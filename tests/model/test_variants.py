"""Stages named after a plus: what is taken, and that everything else is refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from ipmclab import InputError, load_actuator, write_actuator
from ipmclab.model import actuator_from_text, actuator_to_text
from ipmclab.model.declared import declaration_of
from ipmclab.model.kinds import kind_of, optional_kinds
from ipmclab.model.variants import with_stages

LEAKING = '[leak.slow]\ngrowth = 0.5\ntime_constant = "60 s"\n'


@pytest.mark.parametrize(
    ("stages", "code", "words"),
    [
        ("leak.cubic+leak.exponential", "two-forms", "leak.cubic and leak.exponential"),
        ("line.modes=6+line.segments=5", "two-forms", "line.modes and line.segments"),
        ("branches=2+branches=3", "two-counts", "'branches' is named twice"),
        ("line.modes=2.5", "bad-count", "whole number from 1 to"),
        ("line.modes=-3", "bad-count", "whole number from 1 to"),
        ("line.segments=0", "bad-count", "whole number from 1 to"),
        ("line.segments=1000", "bad-count", "whole number from 1 to"),
        ("line.modes=", "bad-count", "whole number from 1 to"),
        ("branches=1e1", "bad-count", "whole number from 1 to 99"),
        ("relaxation.force=100", "bad-count", "whole number from 1 to 99"),
        ("leak.cubic=3", "bad-count", "give 'leak.cubic' alone; values are set in a file"),
        ("leak.cubic.cubic=-1", "unknown-stage", "leak.cubic; values are set in a file or by replace()"),
        ("relaxation.force_pair.0.lead", "unknown-stage", "name the stage, relaxation.force_pair"),
        ("leak", "unknown-stage", "leak.cubic, leak.exponential, leak.butler_volmer, leak.slow"),
        ("line", "unknown-stage", "line.modes, line.segments"),
        ("relaxation=2", "unknown-stage", "relaxation.displacement, relaxation.displacement_pair, relaxation.force"),
        ("leak.cubc", "unknown-stage", "leak.cubic"),
        ("", "unknown-stage", "no stage is called ''"),
        ("leak.slow", "no-form", "add one of leak.cubic, leak.exponential, leak.butler_volmer"),
    ],
)
def test_what_cannot_be_meant_is_refused(stages: str, code: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        load_actuator(f"friend-2+{stages}")
    assert caught.value.code == code
    assert words in str(caught.value)


def test_the_range_of_a_count_is_that_of_a_file() -> None:
    for stage in ("line.modes", "line.segments"):
        with pytest.raises(InputError) as caught:
            load_actuator(f"friend-2+{stage}=1000")
        highest = int(caught.value.repair.split(" to ")[1].split(",")[0])
        text = actuator_to_text(load_actuator(f"friend-2+{stage}={highest}"))
        key = stage.partition(".")[2]
        with pytest.raises(InputError, match=f"1 to {highest}"):
            actuator_from_text(text.replace(f"{key} = {highest}", f"{key} = {highest + 1}"))


def test_another_form_takes_the_place_of_the_one_that_is_there() -> None:
    cubic = load_actuator("friend-2+leak.slow+leak.cubic+line.segments = 4")
    assert cubic.name == "friend-2+leak.slow+leak.cubic+line.segments=4"
    other = with_stages(cubic, "leak.exponential", "line.segments=6")
    assert other.name == "friend-2+leak.slow+leak.exponential+line.segments=6"
    assert other.parameter_values == load_actuator(other.name).parameter_values
    assert (other.structure.leak, other.structure.slow_leak) == ("exponential", True)


def test_a_slow_leak_without_a_leak_is_refused_in_a_file_too(tmp_path: Path) -> None:
    path = tmp_path / "strip.toml"
    text = actuator_to_text(load_actuator("friend-2"))
    path.write_text(text + LEAKING, "utf-8")
    with pytest.raises(InputError, match="there is none") as caught:
        load_actuator(path)
    assert (caught.value.code, caught.value.where) == ("no-form", f"{path}: leak.slow")
    path.write_text(
        f'{text}{LEAKING}[leak.cubic]\ncubic = "3 A/V^3/m^2"\nlinear = "0 S/m^2"\nquadratic = "0 A/V^2/m^2"\n'
    )
    assert load_actuator(path).structure.leak == "cubic"


def test_a_plus_in_a_folder_is_no_stage(tmp_path: Path) -> None:
    folder = tmp_path / "c++"
    folder.mkdir()
    write_actuator(load_actuator("friend-2"), folder / "strip.toml")
    assert load_actuator(f"{folder / 'strip.toml'}+leak.cubic").structure.leak == "cubic"


@pytest.mark.parametrize("stage", ["branches", "viscoelastic", "relaxation.force", "environment.branches"])
def test_each_of_several_is_known_by_its_own_name(stage: str) -> None:
    strip = with_stages(load_actuator("friend-2"), "branches=3", f"{stage}=3")
    kind = next(kind for kind in optional_kinds() if kind.name == stage)
    names = [name for name in strip.parameter_values if kind_of(name) is kind]
    assert {kind.one(name) for name in names} == {f"{kind.prefix}{number}." for number in range(3)}
    for name in names:
        assert declaration_of(name) == strip.structure.declarations[name]
