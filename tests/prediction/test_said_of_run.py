"""What a record itself shows of why it was missed: it begins under voltage, or a channel of it is turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Run, load_actuator, simulate, validate
from ipmclab.fit.in_brief import in_brief
from ipmclab.model import Actuator
from ipmclab.prediction.verdict import verdict_of

RATE = 25.0


@pytest.fixture(scope="module")
def strip() -> Actuator:
    return load_actuator("friend-2")


def read(strip: Actuator, signal: str = "step 1 V delay=4 s", duration: float = 60.0) -> Run:
    """A foreign record, of which only its channels are known."""
    clean = simulate(strip, signal, duration=duration, rate=RATE)
    generator = np.random.default_rng(20261126)
    return Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.channels["current"] + generator.normal(0.0, 1e-4, len(clean)),
        displacement=clean.channels["displacement"] + generator.normal(0.0, 2e-6, len(clean)),
        hold="unknown",
    )


def part(run: Run, first: int, name: str) -> Run:
    arrays = {channel: values[first:] for channel, values in run.channels.items()}
    return replace(Run.from_arrays(time=run.time[: len(run) - first], hold="unknown", **arrays), file=name)


def test_a_cut_that_begins_under_voltage_is_said_to_do_so_first(strip: Actuator) -> None:
    cut = part(read(strip), 300, "later.nc")
    validation = validate(strip, cut)
    assert validation.findings[0].code == "begins-under-voltage"
    assert validation.findings[0].severity == "warning"
    assert not {"no-edge-shown", "assumed-rest"} & {finding.code for finding in validation.findings}
    lines, _ = in_brief(validation.findings, labels=["later.nc"])
    assert "begins under voltage" in str(lines[0])
    found = verdict_of(validation)
    assert {output for output, *_ in found.missed} == {"current", "displacement"}
    said = " ".join(found.sentences)
    assert "later.nc begins under voltage, and the prediction from rest" in said
    assert "another one" not in said


def test_a_record_with_its_edge_does_not_begin_under_voltage(strip: Actuator) -> None:
    validation = validate(strip, part(read(strip), 0, "whole.nc"))
    assert "begins-under-voltage" not in {finding.code for finding in validation.findings}
    assert verdict_of(validation).missed == ()


def test_a_contact_that_comes_within_a_record_begins_at_rest(strip: Actuator) -> None:
    whole = read(strip)
    late = replace(whole, voltage=np.ones(len(whole)))
    assert "begins-under-voltage" not in {finding.code for finding in validate(strip, late).findings}


@pytest.mark.parametrize("scale", [1.0, 1.6])
def test_a_turned_channel_is_called_so(strip: Actuator, scale: float) -> None:
    run = part(read(strip), 0, "turned.nc")
    turned = replace(run, displacement=-scale * run.channels["displacement"])
    validation = validate(strip, turned)
    first = validation.findings[0]
    assert (first.code, first.channel, first.severity) == ("sign-turned", "displacement", "warning")
    said = " ".join(verdict_of(validation).sentences)
    assert "The displacement of turned.nc goes the other way than predicted" in said
    assert "another one" not in said


def test_each_missed_run_has_its_own_cause(strip: Actuator) -> None:
    run = read(strip)
    other = replace(run, current=run.channels["current"] * 4.0, file="other.nc")
    turned = replace(run, displacement=-run.channels["displacement"], file="turned.nc")
    said = " ".join(verdict_of(validate(strip, [part(run, 300, "later.nc"), turned, other])).sentences)
    causes = [
        said.index(words) for words in ("of turned.nc goes the other way", "later.nc begins", "Elsewhere the strip")
    ]
    assert causes == sorted(causes)


def test_a_strip_that_relaxes_past_rest_is_not_turned(strip: Actuator) -> None:
    """It bends as predicted at first, and most of the record lies on the other side of rest."""
    run = part(read(strip), 0, "relaxes.nc")
    since = np.maximum(run.time - 4.0, 0.0)
    size = 0.5 * float(np.abs(run.channels["displacement"]).max())
    relaxes = np.where(since > 2.0, -4.0 * size * (1.0 - np.exp(-(since - 2.0) / 2.0)), size * np.sign(since))
    validation = validate(strip, replace(run, displacement=relaxes))
    predicted = validation.runs[0].comparisons["displacement"].predicted
    assert predicted @ relaxes < -0.9 * np.linalg.norm(predicted) * np.linalg.norm(relaxes)
    assert validation.scores["displacement"].fit_percent < 0.0
    assert "sign-turned" not in {finding.code for finding in validation.findings}


def test_noise_about_zero_is_not_turned(strip: Actuator) -> None:
    run = part(read(strip), 0, "noise.nc")
    wiggles = 1e-6 * np.sin(2.0 * np.pi * run.time / 7.0)
    assert "sign-turned" not in {one.code for one in validate(strip, replace(run, displacement=wiggles)).findings}


def test_a_sensor_that_drifts_is_called_so(strip: Actuator) -> None:
    """The fit had the drift, the prediction has none: "the strip or its state was another one" was said of it."""
    run = part(read(strip, "step 1 V delay=20 s", 80.0), 0, "drifting.nc")
    displacement = run.channels["displacement"]
    slope = -3.0 * float(np.ptp(displacement)) / 80.0
    drifting = replace(run, displacement=displacement + slope * run.time)
    found = verdict_of(validate(strip, drifting))
    assert {output for output, *_ in found.missed} == {"displacement"}
    said = " ".join(found.sentences)
    assert "The sensor of the displacement drifts in drifting.nc: its rows at 0 V show -" in said
    assert "another one" not in said
    # Another strip: the same drift is not what was missed.
    other = validate(strip, replace(drifting, displacement=drifting.channels["displacement"] + 9.0 * displacement))
    assert "another one" in " ".join(verdict_of(other).sentences)
