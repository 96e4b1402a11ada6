"""The campaign file: what it takes, and what it says of a mistake."""

from dataclasses import replace

import pytest

from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign_file import campaign_from_text, load_campaign
from ipmclab.campaign.planned import plan_campaign
from ipmclab.campaign.sitting import experiment_for, sittings_of, virtual_rig
from ipmclab.campaign.template import TEMPLATE
from ipmclab.errors import InputError

MISTAKES = [
    ("20 degC, 80 percent", "20 degX", "line 28: experiments.0.environments.0"),
    ('rate = "50 Hz"', 'rate = "50 kg"', "line 11: method.rate"),
    ('name = "force"', 'nam = "force"', "line 32: experiments.1"),
    ("seed = 1 ", 'seed = "x" ', "line 4: seed"),
    ('samples = ["strip-1"]', 'samples = ["strip-9"]', "line 34: experiments.1.samples.0"),
    ('"current", "force"]', '"current", "forc"]', "line 35: experiments.1.measured"),
    ("repeats = 2", "repeat = 2", "line 29: experiments.0.repeat"),
    ('actuator = "friend-3-measured"', 'actuator = "friend-9"', "line 22: samples.1.actuator"),
    ('id = "strip-3"', 'id = "strip-1"', "line 21: samples.1.id"),
    ('id = "strip-3"', 'id = "STRIP-1"', "line 21: samples.1.id"),
    ('rig = "virtual"', 'rig = "nowhere.toml"', "line 2: rig"),
    ("baseline = true", 'baseline = true\nfolder = "runs"', "line 31: experiments.0.folder"),
]


@pytest.mark.parametrize(("right", "wrong", "place"), MISTAKES)
def test_a_mistake_is_told_with_its_line_and_a_repair(right, wrong, place):
    assert right in TEMPLATE
    with pytest.raises(InputError) as told:
        campaign_from_text(TEMPLATE.replace(right, wrong), where="c.toml")
    assert told.value.where == f"c.toml, {place}"
    assert told.value.repair


def test_an_experiment_file_is_a_part(tmp_path):
    (tmp_path / "step.toml").write_text(
        'sample = "other"\nsignal = "step 1 V"\nrate = "100 Hz"\nduration = "5 s"\nmeasured = ["current", "force"]'
    )
    text = '[[samples]]\nid = "a"\n[[experiments]]\nname = "f"\nfile = "step.toml"\nsignal = "step 2 V"'
    ((block,),) = [blocks_of(campaign_from_text(text, folder=tmp_path))]
    assert block.experiment.rate == 100.0
    assert block.experiment.sample.id == "a"
    assert [run.label for run in block.runs] == ["step 2 V"]


@pytest.mark.parametrize("order", ["listed", "randomised"])
@pytest.mark.parametrize("clamped", ["for each block", "for each run"])
def test_a_campaign_that_grows_keeps_its_mountings(order, clamped):
    text = TEMPLATE.replace('"randomised"', f'"{order}"').replace('"for each block"  ', f'"{clamped}"  ')
    more = '\n[[experiments]]\nname = "next-1"\nsignals = ["sine 1 V 0.2 Hz"]\nduration = "10 s"\n'
    before, after = (mountings(campaign_from_text(one)) for one in (text, text + more))
    assert before.items() < after.items()
    added = {mounting for run, mounting in after.items() if run not in before}
    assert added.isdisjoint(before.values())
    assert len(added) == 2  # strips


def test_the_template_can_be_recorded_as_it_is():
    """The guard ended its step of 3 V, and with it the campaign."""
    remarks = plan_campaign(campaign_from_text(TEMPLATE), bytes_free=10**12).remarks
    assert not any("the guard" in one for one in remarks)


def mountings(campaign):
    """The mounting of each run of a campaign at a virtual bench."""
    sittings = list(sittings_of(campaign, blocks_of(campaign)))
    return {run.id: experiment_for(campaign, one, "a title").mounting_id for one in sittings for run in one.runs}


def test_each_repeat_of_a_random_order_is_a_whole_of_its_own():
    campaign = campaign_from_text(TEMPLATE)
    blocks = blocks_of(campaign)
    assert [[run.id for run in block.runs] for block in blocks] == [
        [run.id for run in block.runs] for block in blocks_of(campaign)
    ]
    listed = blocks_of(campaign_from_text(TEMPLATE.replace("randomised", "listed")))
    signals = {run.id for block in blocks for run in block.runs if run.planned.purpose == "signal"}
    assert signals == {run.id for block in listed for run in block.runs if run.planned.purpose == "signal"}
    wholes = [[run.planned.repeat for run in block.runs] for block in blocks if block.part == "displacement"]
    assert all(len({(repeat - 1) % 2 for repeat in repeats}) == 1 for repeats in wholes)
    orders = {tuple(run.label for run in block.runs) for block in blocks if len(block.runs) == 4}
    assert len(orders) > 1
    other = blocks_of(campaign_from_text(TEMPLATE.replace("seed = 1 ", "seed = 2 ")))
    assert [run.id for block in other for run in block.runs] != [run.id for block in blocks for run in block.runs]


def test_two_polarities_stay_together_and_share_their_pair():
    text = TEMPLATE.replace("baseline = true", "pair = true")
    for block in blocks_of(campaign_from_text(text)):
        for first, second in zip(block.runs[::2], block.runs[1::2], strict=False):
            assert first.planned.pair_id == second.planned.pair_id
    again, once = (blocks_of(campaign_from_text(text))[0].runs[0].planned.pair_id for _ in range(2))
    assert again == once


def test_a_block_at_hardware_is_one_sitting():
    campaign = campaign_from_text(TEMPLATE)
    blocks = blocks_of(campaign)
    runs = sum(len(block.runs) for block in blocks)
    assert len(list(sittings_of(campaign, blocks))) == runs
    assert campaign.is_virtual
    real = replace(campaign, rig=replace(campaign.rig, bench="ni"))
    assert len(list(sittings_of(real, blocks))) == len(blocks)
    done = {run.id for run in blocks[0].runs[:-1]}
    assert len(next(sittings_of(real, blocks, done)).runs) == 1


def test_the_plan_tells_when_each_run_comes():
    plan = plan_campaign(campaign_from_text(TEMPLATE), bytes_free=10**12)
    ends = [one.starts + one.seconds for one in plan.runs]
    assert [one.starts for one in plan.runs] == pytest.approx([0.0, *ends[:-1]])
    assert plan.seconds == pytest.approx(ends[-1])
    assert plan.limits["strip-1, force"]["voltage"].startswith("4 V")
    assert list(plan.watched().values()) == ["displacement", "force"]  # another limit is not watched in each


def test_the_plan_refuses_what_no_guard_would_let_pass():
    text = TEMPLATE.replace("300 mA", "30 mA")
    with pytest.raises(InputError, match="is expected to draw"):
        plan_campaign(campaign_from_text(text), bytes_free=10**12)


def test_chapter_5_has_the_experiments_of_the_thesis():
    campaign = load_campaign("friend-chapter-5")
    runs = [run for block in blocks_of(campaign) for run in block.runs]
    assert 100 <= len(runs) <= 120
    assert {run.sample for run in runs} == {f"friend-{number}" for number in range(1, 8)}
    labels = {run.label for run in runs}
    assert {"step 1 V", "step 2 V", "step 3 V", "sine 1 V 0.05 Hz", "sine 1 V 1 Hz", "square 1 V 0.1 Hz"} <= labels
    conditions = {run.condition for run in runs}
    assert {"room", *(f"20 degC, {humidity} %RH" for humidity in (60, 70, 80))} <= conditions
    assert {f"{warm} degC, 80 %RH" for warm in (20, 30, 40)} <= conditions


def test_baselines_of_chapter_5_dry_and_curl_in_the_room_alone():
    campaign = load_campaign("friend-chapter-5")
    strip = campaign.strip("friend-5")
    drying = strip.virtual("displacement", "baseline", "room")
    assert drying["hydration.face_difference"] == -0.18
    assert not strip.virtual("displacement", "baseline", "20 degC, 80 %RH").structure.hydration
    assert not strip.virtual("displacement", "step 1 V", "room").structure.hydration
    hydrated = {
        sitting.runs[0].condition: virtual_rig(campaign, sitting, {})[0].virtual.hydrated
        for sitting in sittings_of(campaign, blocks_of(campaign))
    }
    assert hydrated["room"]
    assert not hydrated["20 degC, 80 %RH"]


@pytest.mark.parametrize("key", ['signal = "file ramp.csv"', 'signal = "step 0 V for 1 s then file ramp.csv"'])
def test_another_signal_in_a_file_is_another_campaign(tmp_path, key):
    text = f'[[samples]]\nid = "a"\n[[experiments]]\nname = "f"\nrate = "50 Hz"\nduration = "2 s"\n{key}'
    found = []
    for volts in ("0,0\n1,1\n", "0,0\n1,2\n", "0,0\n1,1\n"):
        (tmp_path / "ramp.csv").write_text(volts)
        found.append(campaign_from_text(text, folder=tmp_path).checksum)
    assert found[0] == found[2] != found[1]


@pytest.mark.parametrize("folder", ["lab", "a lab"])
def test_a_signal_in_a_file_is_the_same_run_wherever_its_campaign_is_named_from(tmp_path, monkeypatch, folder):
    """From another folder the campaign was said to be another one, and a virtual state looked for the file there."""
    (tmp_path / folder).mkdir()
    (tmp_path / folder / "ramp.csv").write_text("0,0\n1,1\n")
    text = '[[samples]]\nid = "a"\nactuator = "friend-1-measured"\n'
    text += 'virtual = [{ signal = "file ramp.csv", set = { "geometry.width" = "4 mm" } }]\n'
    text += '[[experiments]]\nname = "f"\nrate = "50 Hz"\nduration = "2 s"\nmeasured = ["current"]\n'
    text += 'signals = ["file ramp.csv", "step 0 V for 1 s then file ramp.csv"]'
    (tmp_path / folder / "c.toml").write_text(text)
    found = []
    for place, name in ((folder, "c.toml"), (".", f"{folder}/c.toml"), ("/", str(tmp_path / folder / "c.toml"))):
        monkeypatch.chdir(tmp_path / place)
        campaign = load_campaign(name)
        runs = blocks_of(campaign)[0].runs
        strip = campaign.strips[0].virtual(runs[0].measured, runs[0].label, runs[0].condition)
        found.append(([one.id for one in runs], campaign.checksum, strip["geometry.width"]))
    assert found[0] == found[1] == found[2]
    assert found[0][0] == ["a/f/room/file ramp.csv/1", "a/f/room/step 0 V for 1 s then file ramp.csv/1"]
    assert found[0][2] == 4e-3


def test_two_polarities_of_every_signal_share_a_pair_of_their_own(tmp_path):
    """Those of a signal in a file did not, and two signals whose offsets differ in their sign shared one."""
    (tmp_path / "ramp.csv").write_text("0,0\n1,1\n")
    signals = ["file ramp.csv", "step 1 V", "sine 1 V 1 Hz offset=0.5 V", "sine 1 V 1 Hz offset=-0.5 V"]
    text = '[[samples]]\nid = "a"\n[[experiments]]\nname = "f"\nrate = "50 Hz"\nduration = "2 s"\npair = true\n'
    (block,) = blocks_of(campaign_from_text(f"{text}signals = {signals}", folder=tmp_path))
    pairs = [one.planned.pair_id for one in block.runs]
    assert pairs[::2] == pairs[1::2]
    assert len(set(pairs)) == len(signals)


@pytest.mark.parametrize(("wrong", "repair"), [("attempts = 0 ", "1 or more"), ("seed = -1", "0 or more")])
def test_a_number_beyond_its_end_is_told_which_may_stand_there(wrong, repair):
    """No attempt was told to be counted from 0."""
    key = wrong.partition(" =")[0]
    (line,) = (one for one in TEMPLATE.splitlines() if one.startswith(f"{key} ="))
    with pytest.raises(InputError) as caught:
        campaign_from_text(TEMPLATE.replace(line, wrong))
    assert caught.value.repair == f"give {repair}"


def test_a_remark_names_the_samples_that_it_is_about():
    remarks = plan_campaign(campaign_from_text(TEMPLATE), bytes_free=10**12).remarks
    expected = [one for one in remarks if "expected to draw" in one and one.startswith("displacement")]
    assert [one.partition(":")[0] for one in expected] == ["displacement of strip-1", "displacement of strip-3"]
    assert any(one.startswith("displacement: the limit of the current is 300 mA") for one in remarks)
