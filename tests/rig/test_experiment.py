"""The experiment file: what it may say, and what is refused with the place and the repair."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from ipmclab.errors import InputError
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.experiments.experiment_file import TEMPLATE, experiment_from_table, load_experiment
from ipmclab.rig.experiments.plan import make_plan

GOOD: dict[str, Any] = {"sample": "strip-1", "signal": "step 1 V", "rate": "50 Hz", "duration": "40 s"}


def test_the_template_is_an_experiment() -> None:
    experiment = experiment_from_table(tomllib.loads(TEMPLATE))
    assert [str(signal) for signal in experiment.signals] == ["step 1 V", "sine 1 V 0.1 Hz"]
    assert (experiment.rest_before, experiment.rest_after) == (5.0, 5.0)
    uncommented = "\n".join(line.removeprefix("# ") for line in TEMPLATE.splitlines())
    everything = experiment_from_table(tomllib.loads(uncommented.replace('"strip-1.toml"', '"friend-2"')))
    assert [air.relative_humidity for air in everything.environments] == [40.0, 60.0]
    assert {air.settle for air in everything.environments} == {1800.0}


def test_what_it_names_is_looked_for_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "step.toml"
    path.write_text(
        'sample = "strip-1"\nsignal = "step 1 V"\nrate = "50 Hz"\nduration = "40 s"\nrig = "rig.toml"\nfolder = "lab"\n'
    )
    experiment = load_experiment(path)
    assert (experiment.rig, experiment.folder) == (tmp_path / "rig.toml", tmp_path / "lab")
    assert experiment.title == "step"


def test_a_signal_from_a_file_lies_beside_it_and_is_reversed_by_name(tmp_path: Path) -> None:
    (tmp_path / "sweep.csv").write_text("".join(f"{k / 50},{k % 7 / 7}\n" for k in range(2000)))
    experiment = experiment_from_table(
        GOOD | {"signal": "file sweep.csv", "pair": True, "fingerprint": False}, folder=tmp_path
    )
    plan = make_plan(experiment, THESIS_RIG, bytes_free=10**9)
    assert [str(run.signal) for run in plan.runs] == [
        f"file {tmp_path / 'sweep.csv'}",
        f"file {tmp_path / 'sweep.csv'} gain=-1",
    ]
    written = "samples " + " ".join(f"{k / 50} s {k % 7 / 7} V" for k in range(2000))
    plan = make_plan(experiment_from_table(GOOD | {"signal": written}), THESIS_RIG, bytes_free=10**9)
    assert max(len(step.text) for step in plan.steps) < 300


def test_a_sample_comes_from_its_table_or_from_its_actuator() -> None:
    table = GOOD | {"sample": {"id": "strip-1", "membrane": "Nafion N117"}}
    assert experiment_from_table(table).sample.membrane == "Nafion N117"
    del table["sample"]
    assert experiment_from_table(table | {"actuator": "friend-2"}).sample.id == "friend-2"


@pytest.mark.parametrize(
    ("change", "code", "where", "words"),
    [
        ({"sample": None}, "missing-key", "sample", "must say whose it is"),
        ({"signal": None}, "missing-key", "signal", "no signal"),
        ({"signals": ["step 1 V"]}, "bad-value", "signal", "both given"),
        ({"signal": None, "signals": []}, "bad-value", "signals", "empty"),
        ({"signal": "sien 1 V 0.1 Hz"}, "unknown-waveform", "signal", "did you mean 'sine'"),
        ({"signal": "step 1 V delay=50 s"}, "signal-too-long", "signal", "record longer"),
        ({"rate": "50"}, "missing-unit", "rate", "no unit"),
        ({"rate": 50}, "bad-value", "rate", "quotes"),
        ({"rate": "-50 Hz"}, "out-of-range", "rate", "above 0"),
        ({"rate": "0 Hz"}, "out-of-range", "rate", "above 0"),
        ({"duration": "1,5 s"}, "decimal-comma", "duration", "decimal point"),
        ({"rest_before": "-1 s"}, "out-of-range", "rest_before", "0 or more"),
        ({"repeats": 0}, "out-of-range", "repeats", "give 1 to 1000"),
        ({"sampel": "x"}, "unknown-key", "sampel", "did you mean 'sample'"),
        ({"measured": ["curent"]}, "unknown-channel", "measured", "did you mean 'current'"),
        ({"measured": ["force", "displacement"]}, "blocked-tip", "measured", "two experiments"),
        ({"steps": ["clamp"]}, "missing-key", "steps", "apply"),
        ({"steps": ["apply", "clamp"]}, "bad-order", "steps", "order"),
        ({"steps": ["aply"]}, "unknown-step", "steps", "did you mean 'apply'"),
        ({"environment": {}}, "missing-key", "environment", "neither"),
        ({"environment": {"temperature": "25 C"}}, "bad-unit", "environment.temperature", "degC"),
        ({"environment": {"relative_humidity": "180 percent"}}, "out-of-range", "environment.relative_humidity", "180"),
        (
            {"environment": {"temperature": "25 degC", "settle": "2 h", "longest_wait": "1 h"}},
            "out-of-range",
            "environment.longest_wait",
            "not longer than settle",
        ),
    ],
)
def test_what_is_refused(change: dict[str, Any], code: str, where: str, words: str) -> None:
    table = {key: value for key, value in (GOOD | change).items() if value is not None}
    with pytest.raises(InputError) as caught:
        experiment_from_table(table, where="x.toml")
    assert (caught.value.code, caught.value.where) == (code, f"x.toml: {where}")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("content", "code"), [(None, "no-such-file"), (b"rate =", "bad-toml"), (b"\xff\xfe\x00", "bad-file")]
)
def test_files_that_are_none(tmp_path: Path, content: bytes | None, code: str) -> None:
    path = tmp_path / "x.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_experiment(path)
    assert caught.value.code == code
    assert str(path) in str(caught.value)
    with pytest.raises(InputError, match="this is a folder"):
        load_experiment(tmp_path)


def test_a_folder_that_cannot_be_made_is_refused_and_nothing_is_made(tmp_path: Path) -> None:
    text = 'sample = "strip-1"\nsignal = "step 1 V"\nrate = "50 Hz"\nduration = "40 s"\nfolder = "FOLDER"\n'
    path = tmp_path / "step.toml"
    (tmp_path / "taken").write_text("", encoding="utf-8")
    for folder, message in (("taken", "is a file"), ("no/where", "does not exist")):
        path.write_text(text.replace("FOLDER", folder), encoding="utf-8")
        with pytest.raises(InputError, match=message) as caught:
            load_experiment(path)
        assert caught.value.where == f"{path}: folder"
    path.write_text(text.replace("FOLDER", "laboratory"), encoding="utf-8")
    assert load_experiment(path).folder == tmp_path / "laboratory"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["step.toml", "taken"]


@pytest.mark.parametrize(
    ("changes", "where", "words"),
    [
        ({"rate": 50}, "experiment: rate", '"50 Hz"'),
        ({"rate": "fast"}, "experiment: rate", "25 Hz"),
        ({"rate": "0 Hz"}, "experiment: rate", "'50 Hz'"),
        ({"bench": "ni"}, "experiment", "rig = names this one"),
    ],
)
def test_the_example_in_a_message_fits_the_key(changes: dict[str, Any], where: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        experiment_from_table(GOOD | changes)
    assert caught.value.where == where
    assert words in caught.value.repair
