"""What a campaign gives: metrics, printed numbers, methods, report."""

import csv
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign_file import campaign_from_text, load_campaign
from ipmclab.campaign.methods import methods
from ipmclab.campaign.published import READ_AS, curled, reproduced, unprinted
from ipmclab.campaign.results import RunResult, by_repeat, read_results
from ipmclab.campaign.state import read_events
from ipmclab.campaign.template import TEMPLATE
from ipmclab.cli.app import run
from ipmclab.comparison.baseline import drift_of
from ipmclab.comparison.run_metrics import metrics_of_run
from ipmclab.errors import InputError
from ipmclab.prediction.headline import READINGS
from ipmclab.quality.metrics import Metric
from ipmclab.store.run_file import read_run

pytestmark = pytest.mark.usefixtures("finished_here")

CAMPAIGN = """
title = "a part of <chapter 5>"
rig = "{rig}"
measure = ["mass", "sheet resistance", "stiffness"]
identify = false
[method]
rate = "100 Hz"
duration = "40 s"
rest_after = "0 s"
zero_time = "1 s"
fingerprint = false
environment = {{ temperature = "20 degC", relative_humidity = "80 percent", settle = "1 s" }}
[[samples]]
id = "friend-6"
actuator = "friend-6-measured"
[[samples.virtual]]
measured = "displacement"
signal = "step 1 V"
set = {{ "circuit.contact_resistance" = "1.7 ohm" }}
[[experiments]]
name = "displacement"
measured = ["current", "displacement"]
signals = ["step 1 V"]
repeats = 2
[[experiments]]
name = "curl"
measured = ["current", "displacement"]
signals = ["step 0 V"]
rate = "10 Hz"
[[experiments]]
name = "other"
measured = ["current", "force"]
signals = ["sine 1 V 0.5 Hz"]
duration = "4 s"
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("results")
    import ipmclab.campaign

    rig = Path(ipmclab.campaign.__file__).parent / "library" / "friend-chapter-5-rig.toml"
    (folder / "campaign.toml").write_text(CAMPAIGN.format(rig=rig.as_posix()))
    assert run(["characterise", str(folder / "campaign.toml"), "--out", str(folder / "out"), "--json"]) == 0
    return folder / "campaign.toml", folder / "out"


def results_of(file: Path, out: Path):
    blocks = blocks_of(campaign_from_text(file.read_text(), folder=file.parent))
    recorded = {one["run"]: one for one in read_events(out) if one["event"] == "recorded"}
    return blocks, read_results(out, blocks, recorded)


def test_printed_numbers_are_met_by_the_strips_that_were_identified_from_them(made):
    _, results = results_of(*made)
    repeated = by_repeat(results)
    assert [len(one.results) for one in repeated] == [2, 1, 1]
    found = reproduced(repeated)
    assert [one.published.metric for one in found] == ["max_displacement", "peak_current", "steady_current"]
    assert all(one.agrees and len(one.values) == 2 for one in found)
    assert unprinted(repeated, found) == (
        "friend-6, curl, 20 degC, 80 %RH, baseline",
        "friend-6, other, 20 degC, 80 %RH, sine 1 V 0.5 Hz",
    )


def test_the_one_curl_of_which_about_a_number_is_printed_stands_beside_it():
    runs = [run for block in blocks_of(load_campaign("friend-chapter-5")) for run in block.runs]
    curls = [run for run in runs if run.label == "baseline" and run.sample in ("friend-4", "friend-5")]
    size = Metric("largest", "displacement", -2.1e-3, "m", None, "")
    repeated = by_repeat([RunResult(run, None, "", "kept", (), (size,)) for run in curls])
    (found,) = curled(repeated)
    assert (found.published.figure, found.published.number, found.distance) == ("5.42", "2 mm", 2.1e-3)
    assert [name for name in unprinted(repeated, ()) if "friend-5" in name] == [
        "friend-5, curl, 20 degC, 80 %RH, baseline"
    ]


def test_every_printed_metric_has_one_of_a_run():
    assert set(READ_AS) == set(READINGS)


def test_metrics_are_a_table(made):
    rows = list(csv.DictReader((made[1] / "metrics.csv").read_text(encoding="utf-8").splitlines()))
    assert {row["verdict"] for row in rows} == {"kept"}
    assert {row["run"] for row in rows} == {"1", "2", "3", "4"}
    one = next(row for row in rows if row["metric"] == "largest" and row["channel"] == "displacement")
    assert float(one["low"]) < float(one["value"]) < float(one["high"])
    assert (made[1] / one["file"]).is_file()


def test_repeats_have_their_scatter_and_the_interval_of_their_mean(made):
    rows = list(csv.DictReader((made[1] / "repeats.csv").read_text(encoding="utf-8").splitlines()))
    of_runs = list(csv.DictReader((made[1] / "metrics.csv").read_text(encoding="utf-8").splitlines()))
    kinds = {
        key: [row for row in rows if (row["channel"], row["metric"]) == key] for key in (LARGEST, ("force", "phase"))
    }
    (twice,) = [row for row in kinds[LARGEST] if row["repeats"] == "2"]
    _, results = results_of(*made)
    (curl,) = (drift_of(one.record) for one in results if one.run.part == "curl")
    parts = [one.record for one in results if one.run.part == "displacement"]
    values = [
        metric.value
        for run in parts
        for metric in metrics_of_run(run, drift=curl)
        if (metric.channel, metric.name) == LARGEST
    ]
    raw = [float(row["value"]) for row in of_runs if row["experiment"] == "displacement" and _is(row, LARGEST)]
    assert np.mean(raw) - np.mean(values) == pytest.approx(40.0 * curl.rate, rel=0.2)  # the peak is at the end
    assert twice["baseline"] == "friend-6/curl/20 degC, 80 %RH/baseline/1"
    assert float(twice["mean"]) == pytest.approx(np.mean(values))
    assert float(twice["standard_deviation"]) == pytest.approx(np.std(values, ddof=1))
    reach = 12.706 * np.std(values, ddof=1) / np.sqrt(2.0)  # Student's t with one degree of freedom
    of_drift = 1.96 * curl.standard_error * np.ptp(parts[0].time)  # in both repeats alike
    assert float(twice["high"]) - float(twice["mean"]) == pytest.approx(np.hypot(reach, of_drift), rel=1e-3)
    (once,) = kinds["force", "phase"]
    (run_alone,) = [row for row in of_runs if _is(row, ("force", "phase"))]
    assert (once["low"], once["high"], once["standard_deviation"]) == (run_alone["low"], run_alone["high"], "")
    assert once["baseline"] == ""


LARGEST = ("displacement", "largest")


def _is(row, key):
    return (row["channel"], row["metric"]) == key


@pytest.mark.parametrize(
    ("name", "beside", "values", "mean", "deviation"),
    [
        ("largest", "amplitude", (0.0990, -0.0992), -0.0991, 1.41e-4),  # a square: either reversal may be the larger
        ("largest", "time_to_peak", (0.0990, -0.0992), -1e-4, 0.140),  # a step that went the other way
        ("phase", "amplitude", (3.14, -3.14), np.pi, 2.25e-3),
    ],
)
def test_repeats_that_noise_puts_on_either_side_have_their_mean_on_one(name, beside, values, mean, deviation):
    planned = blocks_of(load_campaign("friend-chapter-5"))[0].runs[0]
    runs = [
        RunResult(
            planned,
            None,
            "",
            "kept",
            (),
            (Metric(name, "current", value, "A", None, ""), Metric(beside, "current", 0.01, "A", None, "")),
        )
        for value in values
    ]
    (repeated,) = by_repeat(runs)
    assert repeated.mean("current", name) == (
        pytest.approx(mean, abs=1e-9),
        pytest.approx(deviation, rel=0.01),
        2,
    )
    low, high = repeated.interval("current", name)
    assert low < mean < high


def test_a_peak_that_did_not_come_is_above_what_the_voltage_was_held(made):
    page = (made[1] / "report.html").read_text(encoding="utf-8")
    assert re.search(r"above\xa03\d\.\d+\xa0s", page)


def test_a_kept_run_that_was_lost_comes_back_by_what_the_message_says(made, tmp_path):
    file, out = made
    copy = tmp_path / "a copy"
    shutil.copytree(out, copy)
    lost = copy / next(one["path"] for one in read_events(copy) if one["event"] == "recorded")
    whole = read_run(lost).content_sha256
    lost.unlink()
    with pytest.raises(InputError, match="was recorded and kept, and now: no such file") as told:
        results_of(file, copy)
    words = r"move (\S+) into recording, both in (.+), then: ipmclab (.+)"
    journal, place, command = re.search(words, told.value.repair).groups()
    (Path(place) / journal).replace(copy / "recording" / Path(journal).name)
    assert run(shlex.split(command)) == 0
    assert read_run(lost).content_sha256 == whole
    assert len(results_of(file, copy)[1]) == 4


def test_facts_are_those_of_the_strip(made):
    from ipmclab import load_actuator
    from ipmclab.data import published_sample

    facts = {one["name"]: one for one in read_events(made[1]) if one["event"] == "fact"}
    strip, sample = load_actuator("friend-6-measured"), published_sample(6)
    inertia = strip["geometry.width"] * strip["geometry.thickness"] ** 3 / 12.0
    truth = {
        "dry mass": sample.dry_mass,
        "hydrated mass": sample.hydrated_mass,
        "water uptake": sample.hydrated_mass / sample.dry_mass - 1.0,
        "sheet resistance": strip["circuit.sheet_resistance"],
        "stiffness": 3.0 * strip["beam.modulus"] * inertia / strip["geometry.sensing_length"] ** 3,
    }
    assert set(facts) == set(truth)
    for name, value in truth.items():
        assert abs(facts[name]["value"] - value) < 4.0 * facts[name]["uncertainty"], name


def test_the_methods_name_no_limit_that_the_guard_cannot_see():
    """The current of the template's campaign is read up to 200 mA; its methods said that 300 mA were watched."""
    campaign = campaign_from_text(TEMPLATE)
    told = " ".join(methods(campaign, blocks_of(campaign), []))
    assert "The guard watched: voltage 4 V for 0.02 s, then zero." in told
    narrower = campaign_from_text(TEMPLATE.replace("300 mA", "150 mA"))
    assert "; current 150 mA" in " ".join(methods(narrower, blocks_of(narrower), []))


def test_the_methods_say_what_was_done(made):
    file, out = made
    campaign = campaign_from_text(file.read_text(), folder=file.parent)
    events = read_events(out)
    told = " ".join(methods(campaign, blocks_of(campaign), events))
    one_flagged = [event | {"verdict": "flagged"} if event is events[-1] else event for event in events]
    assert "3 runs passed and 1 is flagged" in " ".join(methods(campaign, blocks_of(campaign), one_flagged))
    for text in (
        "One sample was recorded on",
        "virtual one",
        "clamped once for each block",
        "40 s each at 100 rows",
        "20 degC, 80 %RH",
        "4 runs passed",
        "each run began with a strip at rest",
        "dry mass and hydrated mass (weighed once, tapped dry with tissue)",
    ):
        assert text in told
    assert "rested at 0 V" not in told  # each run is a sitting of its own
    page = " ".join((out / "report.html").read_text(encoding="utf-8").split())
    assert "From the displacement of 2 runs the curl of the strip was taken" in page


def test_the_report_is_one_file_that_escapes_what_it_was_given(made):
    page = (made[1] / "report.html").read_text(encoding="utf-8")
    assert "<title>a part of &lt;chapter 5&gt;</title>" in page
    assert not re.search(r'(?:src|href)="(?!#)', page)
    assert "Of 3 numbers that chapter 5 prints of these runs, 3 are met" in page
    assert page.count("<svg") >= 3
    assert "curl, 20 degC, 80 %RH" in page
    compared = (made[1] / "comparison.html").read_text(encoding="utf-8")
    assert "displacement, strain" in compared  # by the dimensions of the model that the campaign names
    ids = re.findall(r'\bid="([^"]*)"', page)
    assert len(ids) == len(set(ids))


def test_what_was_found_in_runs_that_count_is_told_once_for_each_kind(made):
    from ipmclab.reporting.campaign import _findings

    _, results = results_of(*made)
    found = [replace(one, findings=("slip",) if one.run.part == "displacement" else ()) for one in results]
    assert list(_findings(by_repeat(found))) == ["slip: displacement, 20 degC, 80 %RH, step 1 V (2 runs)"]
    worded = [replace(one, said={"slip": f"it slips by {one.run.planned.repeat} mm"}) for one in found]
    told = list(_findings(by_repeat(worded)))
    assert told == ["it slips by 1 mm, or alike (slip): displacement, 20 degC, 80 %RH, step 1 V (2 runs)"]
    assert not list(_findings(by_repeat(results)))  # a baseline without a voltage is no finding
