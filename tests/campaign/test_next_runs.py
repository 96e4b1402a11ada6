"""Which runs a campaign should record next, and the file that then asks for them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ipmclab import InputError, write_fit
from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign_file import load_campaign
from ipmclab.campaign.conduct import Conduct, Sat
from ipmclab.campaign.known import known_of, recorded_runs
from ipmclab.campaign.next_runs import Wishes, propose_for_campaign, ways_of
from ipmclab.campaign.state import State
from ipmclab.cli.app import run
from ipmclab.store.journal.laboratory import Laboratory
from tests.campaign.carried_out import carry_out

pytestmark = pytest.mark.usefixtures("finished_here")

CAMPAIGN = """
title = "two strips"   # a comment that stays
identify = false
[method]
rate = "10 Hz"
duration = "10 s"
rest_before = "5 s"
rest_after = "0 s"
pause = "20 s"
zero_time = "1 s"
fingerprint = false
repeats = 2
limits = { voltage = "3 V" }
[[samples]]
id = "friend-1"
actuator = "friend-1-measured"
[[samples]]
id = "friend-3"
actuator = "friend-3-measured"
[[experiments]]
name = "current"
measured = ["current"]
samples = ["friend-1"]
signals = ["step 1.5 V"]
[[experiments]]
name = "displacement"
measured = ["current", "displacement"]
samples = ["friend-3"]
signals = ["step 1 V"]
"""

LEAK = "circuit.dc_resistivity"
QUICK = Wishes(longest=10.0)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("next") / "campaign.toml"
    file.write_text(CAMPAIGN)
    carry_out(load_campaign(file), file.with_suffix(""))
    return file


def test_limits_rests_and_runs_are_those_of_the_campaign(made: Path) -> None:
    campaign = load_campaign(made)
    results, left = recorded_runs(campaign, made.with_suffix(""))
    assert (len(results), left) == (4, 0)
    known, remarks = known_of(campaign, results, free=[LEAK])
    assert not remarks
    assert len(known["friend-3"].fit.runs) == 2
    (way,) = ways_of(campaign, "friend-1", known["friend-1"], QUICK).items()
    name, allowed = way
    assert (name, allowed.limits.voltage.most, allowed.rate) == ("current", 1.5, 10.0)
    assert allowed.rest == 5.0 + 20.0 + 2.0  # before it, the pause, and the zeros
    assert allowed.reads == ("current",)
    lower = ways_of(campaign, "friend-1", known["friend-1"], Wishes(limits={"voltage": "0.5 V"}))
    assert lower["current"].limits.voltage.most == 0.5


def test_a_fit_of_a_sample_is_taken_and_another_is_refused(made: Path, tmp_path: Path) -> None:
    campaign = load_campaign(made)
    results, _ = recorded_runs(campaign, made.with_suffix(""))
    mine = [one for one in results if one.run.sample == "friend-1"][:1]
    known, _ = known_of(campaign, mine, free=[LEAK])
    fit = known["friend-1"].fit
    write_fit(fit, tmp_path / "friend-1.toml")
    again, _ = known_of(campaign, mine, free=[LEAK], models=tmp_path)
    assert again["friend-1"].fit.parameters[LEAK].value == pytest.approx(fit.parameters[LEAK].value, rel=1e-4)
    found = propose_for_campaign(campaign, made.with_suffix(""), fits=[fit], free=[LEAK], minutes=2, wishes=QUICK)
    assert set(found.proposal.of) == {"friend-1", "friend-3"}
    assert found.proposal.remarks == ("1 runs of friend-1 are not in its fit: their information is not counted here",)
    assert propose_for_campaign(campaign, None, fits=[fit], minutes=2, wishes=QUICK).proposal.of.keys() == {"friend-1"}
    stranger = known_of(campaign, results, free=[LEAK])[0]["friend-3"].fit
    only_first = load_campaign(_without_the_second(made, tmp_path))
    with pytest.raises(InputError, match="none of the campaign's samples"):
        propose_for_campaign(only_first, None, fits=[stranger], wishes=QUICK)


def _without_the_second(made: Path, folder: Path) -> Path:
    text = made.read_text().replace('[[samples]]\nid = "friend-3"\nactuator = "friend-3-measured"\n', "")
    file = folder / "one.toml"
    file.write_text(text.partition('[[experiments]]\nname = "displacement"')[0])
    return file


def test_appended_runs_are_recorded_by_the_same_command(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = made.read_text()
    asked = ["next", str(made), "--free", LEAK, "--minutes", "3", "--longest", "10 s", "--append"]
    assert run([*asked, "--json"]) == 2
    assert "nobody can be asked" in capsys.readouterr().err
    assert made.read_text() == before
    assert run([*asked, "--yes", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["appended_to"] == str(made)
    assert sum(one["bench_time"] for one in told["runs"]) == pytest.approx(told["bench_time"])
    gains = [one["gain_per_minute"] for one in told["runs"]]
    assert len(gains) > 1
    text = made.read_text()
    assert text.startswith(before.rstrip())
    campaign = load_campaign(made)
    planned = [one.id for block in blocks_of(campaign) for one in block.runs]
    assert len(planned) == 4 + len(told["runs"])
    results, left = recorded_runs(campaign, made.with_suffix(""))
    assert (len(results), left) == (4, len(told["runs"]))
    with State(made.with_suffix("")) as state:
        laboratory = Laboratory.open(made.with_suffix(""))
        conduct = Conduct(campaign, blocks_of(campaign), laboratory, state, sit=lambda *_: Sat(), on_progress=print)
        conduct.begin()  # the folder takes the longer campaign
        assert conduct.left == len(told["runs"])


def test_a_folder_of_another_campaign_is_refused(made: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(CAMPAIGN.replace("two strips", "others"))
    with pytest.raises(InputError, match="another campaign"):
        recorded_runs(load_campaign(other), made.with_suffix(""))
    with pytest.raises(InputError, match="nothing is known of a sample"):
        known_of(load_campaign(other), ())


def test_a_run_that_is_flagged_because_nobody_can_read_it_is_not_left_to_record(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    file.write_text(CAMPAIGN)
    campaign = load_campaign(file)
    plan = [one.id for block in blocks_of(campaign) for one in block.runs]
    with State(tmp_path) as state:
        state.add("campaign", checksum=campaign.checksum, plan=plan)
        state.add("recorded", run=plan[0], uuid="u", path="runs/gone.nc", verdict="flagged", findings=[])
        state.add("recorded", run=plan[1], uuid="v", path="runs/other.nc", verdict="repeat", findings=[])
    assert recorded_runs(campaign, tmp_path) == ((), len(plan) - 1)
