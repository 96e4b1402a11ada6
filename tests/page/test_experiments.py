"""An experiment as a form: what it says is what its file says, and each mistake stands at its field."""

from __future__ import annotations

import errno
import tomllib
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import load_actuator, write_actuator
from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.experiment_form import FIELDS, Draft, Unsaved
from ipmclab.page.experiments import check, experiments, limit_at, preview, rigs, save
from ipmclab.page.lab import Lab
from ipmclab.rig.experiments.experiment_file import TEMPLATE, experiment_from_table, load_experiment

WHOLE = """
title = "all of it"
sample = { id = "strip-1", membrane = "Nafion 117" }
rig = "virtual"
folder = "runs"
signals = ["step 1 V", "sine 1 V 0.1 Hz"]
rate = "50 Hz"
duration = "40 s"
measured = ["current", "displacement"]
rest_before = "3 s"
repeats = 2
pair = true
baseline = true
fingerprint = false
operator = "A. Reader"
steps = ["clamp", "apply"]
clamp_pressure = "100 kPa"
[environment]
temperature = "25 degC"
settle = "10 min"
humidity_tolerance = "2 percent"
[limits]
voltage = "2 V"
current = { most = "150 mA", duration = "100 ms" }
displacement = "off"
"""


def with_values(draft: Draft, **values: str | bool) -> Draft:
    return replace(draft, values={**draft.values, **values})


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab.open(tmp_path)


def test_a_new_experiment_has_a_limit_of_the_current_that_its_bench_sees(lab: Lab) -> None:
    path = lab.root / "wide.toml"
    text = (resources.files("ipmclab.rig.files.library") / "thesis.toml").read_text("utf-8")
    path.write_text(text.replace('["-0.2 V", "0.2 V"]', '["-1 V", "1 V"]'), encoding="utf-8")
    assert [limit_at(lab, name) for name in ("virtual", "wide.toml", "none.toml", "../x.toml")] == [
        "190 mA",
        "",
        "",
        "",
    ]
    for rig in ("virtual", "wide.toml"):
        limit = {"limits.current": limit_at(lab, rig)}
        plan = check(lab, with_values(Draft.new(), sample="s", rig=rig, **limit)).plan
        assert plan is not None
        assert not plan.limits.unwatched(plan.rig, plan.experiment.measured)


def test_a_file_is_the_same_experiment_after_the_form(lab: Lab) -> None:
    """What the form does not show is kept."""
    (lab.root / "whole.toml").write_text(WHOLE, encoding="utf-8")
    draft = Draft.read(lab, "whole")
    assert draft.values["signals"] == "step 1 V\nsine 1 V 0.1 Hz"
    before = experiment_from_table(tomllib.loads(WHOLE), folder=lab.root)
    assert experiment_from_table(draft.table(), folder=lab.root) == before
    written = save(lab, with_values(replace(draft, name="copy"), title="a copy"))
    assert replace(load_experiment(written), title=before.title, where=before.where) == before


def test_the_template_can_be_opened(lab: Lab) -> None:
    (lab.root / "first.toml").write_text(TEMPLATE.replace('"rig.toml"', '"virtual"'), encoding="utf-8")
    checked = check(lab, Draft.read(lab, "first"))
    assert checked.errors == {}
    assert checked.plan is not None


@pytest.mark.parametrize("key", ["sample", "mounting_id"])
def test_a_name_that_no_list_has_room_for_is_refused_at_its_field(lab: Lab, key: str) -> None:
    draft = with_values(Draft.new(), sample="strip-1")
    assert check(lab, with_values(draft, **{key: 80 * "é"})).errors == {}
    checked = check(lab, with_values(draft, **{key: 81 * "é"}))
    assert set(checked.errors) == {key}
    assert "it has 81 letters, at most 80" in checked.errors[key]
    assert checked.experiment is not None


def test_in_a_laboratory_folder_an_experiment_records_there(tmp_path: Path) -> None:
    """A new one needs no file for that; one that does not say where means a folder that this page does not show."""
    (tmp_path / "recording").mkdir()
    lab = Lab.open(tmp_path)
    draft = with_values(replace(Draft.new(), name="step"), sample="strip-1")
    assert check(lab, draft).errors == {}
    path = save(lab, draft)
    assert load_experiment(path).folder == lab.root
    path.write_text(path.read_text(encoding="utf-8").replace('folder = "."\n', ""), encoding="utf-8")
    with pytest.raises(InputError, match="says something else"):
        save(lab, Draft.read(lab, "step"))
    assert load_experiment(save(lab, Draft.read(lab, "step"), replace=True)).folder == lab.root
    path.write_text(path.read_text(encoding="utf-8").replace('folder = "."', 'folder = "runs"'), encoding="utf-8")
    assert "change folder in the file" in check(lab, Draft.read(lab, "step")).errors[""]


def test_a_disk_that_is_full_leaves_the_file_as_it_was(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    draft = with_values(replace(Draft.new(), name="step"), sample="strip-1")
    before = save(lab, draft).read_bytes()

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr("ipmclab.destination.sync_file", full)
    with pytest.raises(IpmclabError, match="no space left"):
        save(lab, with_values(draft, sample="strip-2"), replace=True)
    assert {path.name: path.read_bytes() for path in lab.root.glob("*step*")} == {"step.toml": before}


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ('signals = ["step 1 V"]\nmeasured = []', {}),
        ('signals = ["step 1 V"]\nmeasured = ["force", "current"]', {}),
        ('signals = ["step 1 V"]\nmeasured = "current"', {"measured": "not a list"}),
        ('signals = ["step 1 V"]\nmeasured = ["current", "force", "displacement"]', {"measured": "in one run"}),
        ('signals = ["step 1 V"]\nrepeats = "2"', {"repeats": "not a whole number"}),
        ('signals = "step 1 V"', {"signals": "write one"}),
        ('signals = ["step 1 V"]\nrig = 5', {"rig": "not a text"}),
        ('signal = "step 1 V"\nsignals = ["step 2 V"]', {"signals": "both given"}),
    ],
)
def test_what_no_field_can_show_stays_as_the_file_has_it(lab: Lab, line: str, told: dict[str, str]) -> None:
    """Nothing else is recorded in its place, and a mistake is told where it is, as a recorder tells it."""
    text = f'title = "t"\nsample = "s"\nrate = "50 Hz"\nduration = "10 s"\nfolder = "runs"\n{line}\n'
    (lab.root / "e.toml").write_text(text, encoding="utf-8")
    draft = Draft.read(lab, "e")
    checked = check(lab, draft)
    assert set(checked.errors) == set(told), checked.errors
    assert all(words in checked.errors[key] for key, words in told.items())
    wanted = tomllib.loads(text)
    assert {key: value for key, value in draft.table().items() if key in wanted} == wanted
    if not told:
        assert checked.experiment is not None
        assert checked.experiment.measured == tuple(wanted["measured"])


def test_a_new_experiment_needs_a_sample_only(lab: Lab) -> None:
    draft = Draft.new()
    assert set(check(lab, draft).errors) == {"sample"}
    checked = check(lab, with_values(draft, sample="strip-1"))
    assert checked.errors == {}
    assert checked.plan is not None
    assert [run.signal.amplitude for run in checked.plan.runs if run.purpose == "signal"] == [1.0]


def test_all_mistakes_are_told_at_once_each_at_its_field(lab: Lab) -> None:
    wrong = {
        "sample": "",
        "signals": "step 1 V\nstep 1 W",
        "duration": "-3 s",
        "rate": "50",
        "repeats": "two",
        "rest_before": "1,5 s",
        "pause": "-1 s",
        "environment.temperature": "900 degC",
        "environment.settle": "long",
        "limits.voltage": "2 W",
        "limits.charge": "-1 C",
        "clamp_pressure": "5",
        "rig": "none.toml",
    }
    humid = with_values(Draft.new(), **{"environment.relative_humidity": "80 percent"})
    errors = check(lab, with_values(humid, **wrong)).errors
    assert set(errors) == set(wrong) - {"rig"}  # whether the rig is there is looked at once it can be read
    assert "comma" in errors["rest_before"]
    assert "has no unit" in errors["rate"]
    right = {"sample": "s", "rig": "none.toml"}
    assert "no such rig file" in check(lab, with_values(Draft.new(), **right)).errors["rig"]


@pytest.mark.parametrize(
    ("key", "text", "told"),
    [
        ("duration", "", "it is empty; write for example 40 s"),
        ("rate", "", "it is empty; write for example 50 Hz"),
        ("signals", "", "no signal is named; write one, such as step 1 V"),
        ("sample", "", "no sample is named: a run must say whose it is; fill in the sample's id, such as strip-1"),
        ("repeats", "xyz", "'xyz' is not a whole number; write 1 or more, such as 2"),
        (
            "actuator",
            "nope",
            "there is no actuator 'nope', neither in the library nor in this folder; known: 'mine.toml'",
        ),
        ("actuator", "mine.tml", "neither in the library nor in this folder; did you mean 'mine.toml'?"),
        ("actuator", "x+" + 300 * "a", "there is no actuator 'x'"),
    ],
)
def test_a_mistake_is_told_in_the_words_of_the_form(lab: Lab, key: str, text: str, told: str) -> None:
    """There are no keys and no quotes on it."""
    write_actuator(load_actuator("friend-2"), lab.root / "mine.toml")
    errors = check(lab, with_values(Draft.new(), **{"sample": "s", key: text})).errors
    assert set(errors) == {key}
    assert told in errors[key]


def test_a_file_with_measures_and_circuit_is_proposed_as_an_actuator_and_no_other(lab: Lab) -> None:
    (lab.root / "circuit.toml").write_text("[geometry]\n[circuit]\n", encoding="utf-8")
    (lab.root / "measures.toml").write_text("[geometry]\n", encoding="utf-8")
    told = check(lab, with_values(Draft.new(), sample="s", actuator="nope")).errors["actuator"]
    assert "known: 'circuit.toml', 'friend-" in told
    assert "measures.toml" not in told


@pytest.mark.parametrize(
    "named", ["friend-2", "friend-2+leak.cubic", "mine.toml", "mine.toml + clamp", "below/mine.toml"]
)
def test_a_model_of_the_strip_is_of_the_library_or_the_folder(lab: Lab, named: str) -> None:
    (lab.root / "below").mkdir()
    for place in (lab.root, lab.root / "below"):
        write_actuator(load_actuator("friend-2"), place / "mine.toml")
    assert check(lab, with_values(Draft.new(), sample="s", actuator=named)).errors == {}


@pytest.mark.parametrize("air", ["", "900 degC"])
def test_the_waits_are_checked_without_an_environment_that_is_waited_for(lab: Lab, air: str) -> None:
    """They stay out of the file, but a mistake is one."""
    waits = {"environment.settle": "1 km", "environment.longest_wait": "x"}
    draft = with_values(Draft.new(), sample="s", **{"environment.temperature": air}, **waits)
    errors = check(lab, draft).errors
    assert set(errors) == set(waits) | ({"environment.temperature"} if air else set())
    assert "km" in errors["environment.settle"]
    checked = check(lab, with_values(Draft.new(), sample="s", **{"environment.settle": "1 min"}))
    assert checked.errors == {}
    assert checked.experiment is not None
    assert checked.experiment.environments == ()


@pytest.mark.parametrize("repeats", ["0", "1001", "200000000", "9" * 5000])
def test_an_experiment_has_no_more_repeats_than_can_be_planned(lab: Lab, repeats: str) -> None:
    """The page plans at each key: nothing in a field may take it long."""
    assert set(check(lab, with_values(Draft.new(), sample="s", repeats=repeats)).errors) == {"repeats"}


@pytest.mark.parametrize("one", [field for field in FIELDS if field.kind == "text"], ids=lambda field: field.key)
def test_no_text_in_any_field_is_a_fault(lab: Lab, one) -> None:
    """It is told at its own field, or it is an experiment whose file says the same."""
    for text in ("", "x", "-1", "1e999 V", "\0", "['a']", '"', "5 s 5 s", "∞ V", "file x", "a" * 3000):
        draft = replace(with_values(Draft.new(), **{"sample": "s", one.key: text}), name="one")
        checked = check(lab, draft)
        if checked.errors:
            assert set(checked.errors) == {one.key}, text
            assert all(checked.errors.values())
            continue
        assert checked.plan is not None
        again = load_experiment(save(lab, draft, replace=True))
        assert replace(again, where=checked.experiment.where) == checked.experiment


@pytest.mark.parametrize("key", [field.key for field in FIELDS if field.kind != "switch"])
def test_half_a_letter_is_told_at_its_field_and_not_saved(lab: Lab, key: str) -> None:
    """Browsers can send a lone surrogate, and neither a file nor an answer can hold it."""
    draft = replace(with_values(Draft.new(), **{"sample": "s", key: "1 \ud800"}), name="one")
    errors = check(lab, draft).errors
    assert key in errors
    assert "\n".join(errors.values()).encode()
    with pytest.raises(InputError, match="damaged") as told:
        save(lab, draft)
    assert str(told.value).encode()
    assert not list(lab.root.iterdir())


def test_what_is_beyond_rig_or_limits_is_told_at_the_signal(lab: Lab) -> None:
    draft = with_values(Draft.new(), sample="s")
    assert "3.5 V" in check(lab, with_values(draft, signals="step 5 V")).errors["signals"]
    beyond = with_values(draft, signals="step 2 V", **{"limits.voltage": "1.5 V"})
    assert "1.5 V" in check(lab, beyond).errors["signals"]
    assert "rows" in check(lab, with_values(draft, duration="1e9 s")).errors["duration"]


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("signals", "file /etc/passwd"),
        ("signals", "step 1 V\nstep 1 V for 2 s then FILE '../x.csv'"),
        ("rig", "../rig.toml"),
        ("actuator", "/etc/passwd+leak.cubic"),
    ],
)
def test_a_file_outside_the_folder_is_not_read(lab: Lab, key: str, text: str) -> None:
    assert "not in the folder" in check(lab, with_values(Draft.new(), sample="s", **{key: text})).errors[key]


def test_runs_that_would_go_elsewhere_are_told(lab: Lab) -> None:
    (lab.root / "else.toml").write_text(WHOLE.replace('folder = "runs"', 'folder = "other"'), encoding="utf-8")
    assert "shows the runs in 'runs'" in check(lab, Draft.read(lab, "else")).errors[""]


def test_the_voltage_that_is_drawn_is_the_one_that_is_applied(lab: Lab) -> None:
    """Against the run that the virtual bench makes of it, rests included."""
    from ipmclab.rig.recording.recorder import record
    from ipmclab.rig.virtual import VirtualBench

    draft = with_values(Draft.new(), sample="s", signals="square 1 V 0.5 Hz", duration="6 s", rest_before="1 s")
    checked = check(lab, with_values(draft, rest_after="2 s", pair=True))
    assert checked.experiment is not None
    (panel,) = preview(checked.experiment)
    assert [one.label for one in panel.series] == ["square 1 V 0.5 Hz", "square -1 V 0.5 Hz"]
    run = record(VirtualBench(), "square 1 V 0.5 Hz", duration=6, rate=50, rest_before=1, rest_after=2)
    drawn = np.interp(run.time, panel.series[0].time, panel.series[0].values)
    behind_shunt = run.voltage[1:]  # read just before the output changes: a row later
    assert np.corrcoef(drawn[:-1], behind_shunt)[0, 1] > 0.99
    assert set(np.unique(panel.series[0].values)) == {-1.0, 0.0, 1.0}
    assert panel.series[0].time[-1] == pytest.approx(9 - 1 / 50)


def test_a_long_run_is_drawn_with_few_points(lab: Lab) -> None:
    checked = check(lab, with_values(Draft.new(), sample="s", duration="10 h", rate="1 kHz", signals="sine 1 V 1 mHz"))
    assert checked.experiment is not None
    assert sum(len(one.time) for one in preview(checked.experiment)[0].series) < 250_000


def test_saving_does_not_overwrite_unasked(lab: Lab) -> None:
    draft = replace(with_values(Draft.new(), sample="s"), name="one")
    path = save(lab, draft)
    assert save(lab, draft) == path  # it says the same
    other = with_values(draft, duration="5 s")
    with pytest.raises(InputError, match="says something else"):
        save(lab, other)
    save(lab, other, replace=True)
    assert Draft.read(lab, "one").values["duration"] == "5 s"
    assert experiments(lab) == ["one"]
    (lab.root / "rig.toml").write_text('bench = "virtual"\n', encoding="utf-8")
    (lab.root / "broken.toml").write_text("= =", encoding="utf-8")
    assert rigs(lab) == ["virtual", "rig.toml"]
    for name in ("", "../x", ".hidden", "a/b", "x" * 200):
        with pytest.raises(InputError, match="no plain file name"):
            save(lab, replace(draft, name=name))


def test_what_a_browser_kept_stands_upon_the_file_as_it_is_now(lab: Lab) -> None:
    """What the form does not show comes from the file, never from a browser."""
    (lab.root / "t.toml").write_text('signal = "step 1 V"\nrate = "50 Hz"\nsteps = ["clamp"]\n', encoding="utf-8")
    values = {"sample": "strip-1", "pair": True, "folder": "elsewhere", "steps": [], "rate": 3, "measured": "nothing"}
    found = Unsaved.of(lab, {"from": "t", "values": {**values, "name": "new"}})
    table = found.draft.table()
    assert (table["sample"], table["pair"], table["steps"], table["rate"]) == ("strip-1", True, ["clamp"], "50 Hz")
    assert "folder" not in table
    assert (found.origin, found.base.name, found.draft.name) == ("t", "t", "new")
    assert not found.problem
    same = {"from": "t", "digest": found.base.digest, "values": values}
    assert not Unsaved.of(lab, same).problem
    (lab.root / "t.toml").write_text('signal = "step 1 V"\nrate = "50 Hz"\nsteps = ["apply"]\n', encoding="utf-8")
    assert Unsaved.of(lab, same).problem == "t.toml was changed since"  # in what the form does not show
    gone = Unsaved.of(lab, {"from": "../t", "values": {"sample": "strip-1"}})
    assert (gone.origin, gone.draft.values["sample"]) == ("", "strip-1")
    assert "cannot be read" in gone.problem


_KEYS = st.sampled_from(["from", "digest", "values", "sample", "name"])
_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(_KEYS, inner),
)


@given(kept=_JSON)
def test_nothing_that_a_browser_says_it_has_kept_is_a_fault(lab: Lab, kept: object) -> None:
    found = Unsaved.of(lab, kept)
    check(lab, found.draft)
