"""The short answer of a fit: on one screen, causes first, in words that an experimentalist agrees with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Fit, Run, RunMetadata, identify, import_run, load_actuator, read_fit, simulate, write_fit
from ipmclab.fit.answer import answer_of
from ipmclab.fit.fit_table import changed
from ipmclab.fit.in_brief import MOST, WIDTH, in_brief, shortened
from ipmclab.run import Finding
from tests.identification.many import FRIEND, noisy
from tests.identification.test_real_current import MAPS, strip

SCREEN = 24


def read_lines(fit: Fit) -> list[str]:
    """The lines of a short answer, which fits on one screen."""
    lines = fit.summary().splitlines()
    assert len(lines) < SCREEN  # and one says which file was written
    assert max(map(len, lines)) <= WIDTH
    assert len(answer_of(fit).findings) <= MOST
    return lines


def finding(code: str, severity: str = "warning", channel: str | None = "current", message: str = "") -> Finding:
    return Finding(code, severity, message or f"step.nc: what {code} says", "do this", channel=channel)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def good() -> Fit:
    return identify(FRIEND, noisy(np.random.default_rng(20261121), "step 1 V delay=1 s"), labels=["step.nc"])


@pytest.mark.parametrize(
    ("name", "rows", "starts", "causes"),
    [
        ("step_1V", 1635, "Do not use this fit: the record of the current is wrong, as the first", ["contact-lost"]),
        ("step_2V_poor", None, "This fit can be used to predict the current (residual 3", []),
        ("step_3V", None, "Do not use this fit: the record of the current is wrong, as the first", ["contact-missing"]),
    ],
)
def test_a_real_record(name: str, rows: int | None, starts: str, causes: list[str], real_runs: Path) -> None:
    run = import_run(real_runs / f"{name}.csv.gz", MAPS / f"{name}.toml")
    channels = {channel: run.channels[channel][:rows] for channel in ("current", "displacement")}
    cut = Run.from_arrays(
        time=run.time[:rows], voltage=run.voltage[:rows], hold=run.hold, metadata=run.metadata, **channels
    )
    fit = identify(strip(56.9), cut)
    lines = read_lines(fit)
    assert any(line.startswith(starts) for line in lines)
    answer = answer_of(fit)
    assert [one.code for one in answer.findings][: len(causes)] == causes
    if causes:
        assert not {"model-error", "model-incomplete", "stage-missing"} & {one.code for one in answer.findings}
    assert f"{name}.csv.gz" in answer.verdict or "the model does not follow the current" in answer.verdict
    assert f"{name}.csv.gz: " not in fit.summary()  # of one run its name is said once
    assert not any(line.rstrip().endswith((",", ";", ":", "(")) for line in lines if "  " in line)


def test_a_good_fit_may_be_used(good: Fit) -> None:
    verdict = answer_of(good).verdict
    assert verdict.startswith("This fit can be used to predict the current (residual 0.1")
    assert verdict.endswith("% of the range in step.nc); all 5 parameters are determined.")
    assert "known from these readings" not in good.summary()
    assert good.known


def test_what_is_known_stands_beside_what_is_not() -> None:
    fit = identify(
        FRIEND,
        noisy(np.random.default_rng(20261121), "step 1 V delay=1 s"),
        free="electrical,circuit.sheet_resistance",
        labels=["step.nc"],
    )
    lines = read_lines(fit)
    place = lines.index("known from these readings")
    assert all("not determined" in line for line in lines[1:place])
    assert lines[place + 1].split()[:2] == ["high-frequency", "resistance"]
    assert any("measure the sheet resistance" in line for line in lines)
    assert answer_of(fit).verdict.endswith("none of its parameters is determined, but what stands below them is known.")


def test_several_runs_and_outputs_go_by_their_names() -> None:
    generator = np.random.default_rng(20261121)
    runs = [noisy(generator, signal, outputs=("current", "force")) for signal in ("step 1 V", "sine 1 V 0.2 Hz")]
    fit = identify(FRIEND, runs, free="circuit.dc_resistivity,coupling.p2", labels=["a.nc", "b.nc"])
    said = answer_of(fit).verdict
    assert said.startswith(
        "This fit can be used to predict the current and force (residual, relative to the range: current"
    )
    assert "current at most 0.22 % in a.nc; force at most 0.11 % in a.nc)" in said
    assert said.endswith("both parameters are determined.")


def test_a_residual_is_said_in_units_where_the_file_is_older(good: Fit, tmp_path: Path) -> None:
    older = changed(good, observations=tuple(replace(one, span={}) for one in good.observations))
    write_fit(older, tmp_path / "older.toml")
    assert "(residual 0.103 mA in step.nc)" in answer_of(read_fit(tmp_path / "older.toml")).verdict


def test_a_fit_that_was_read_says_the_same(good: Fit, tmp_path: Path) -> None:
    write_fit(good, tmp_path / "fitted.toml")
    assert read_fit(tmp_path / "fitted.toml").summary() == good.summary()


def test_a_search_that_did_not_end_is_refused(good: Fit) -> None:
    lost = replace(good, converged=False, findings=(finding("not-converged", "error", None), finding("model-error")))
    assert answer_of(lost).verdict == "Do not use this fit: the search did not end at a best fit."
    assert [one.code for one in answer_of(lost).findings] == ["not-converged"]


def test_a_model_that_lacks_something_is_not_the_strip(good: Fit) -> None:
    said = answer_of(replace(good, findings=(finding("model-error"),))).verdict
    assert said.endswith("but the model lacks something: they describe this model, not yet the strip.")


def test_an_impossible_current_silences_what_follows_from_it() -> None:
    told = [
        finding("model-error"),
        finding("capacitance-out-of-range", channel=None),
        finding("stage-missing"),
        finding("model-error", channel="force"),
        finding("current-rises"),
    ]
    lines, more = in_brief(told, ["current", "force"], ["step.nc"])
    assert [one.code for one in lines] == ["current-rises", "model-error"]
    assert more == 3


def test_what_a_model_lacks_by_name_silences_how_much_it_lacks() -> None:
    lines, _ = in_brief([finding("model-error"), finding("stage-missing")], ["current"])
    assert [one.code for one in lines] == ["stage-missing"]


def test_errors_come_first_and_those_of_other_channels_count_as_warnings() -> None:
    told = [
        finding("exact-fixed-value", "info"),
        finding("undetermined", channel=None, message="a is not determined; measure the width"),
        finding("sampling-period-unknown", channel=None),
        finding("response-opposite", "error", "displacement"),
        finding("contact-lost", "error"),
    ]
    lines, more = in_brief(told, ["current"])
    assert [one.code for one in lines] == ["contact-lost", "sampling-period-unknown", "response-opposite"]
    assert more == 2
    lines, _ = in_brief(told[:-1], ["current"])
    assert [one.code for one in lines] == ["sampling-period-unknown", "response-opposite", "undetermined"]
    assert lines[-1].text.endswith("measure the width")


def test_at_most_five_and_the_rest_is_counted() -> None:
    told = [finding(f"code-{number}") for number in range(8)]
    lines, more = in_brief(told)
    assert (len(lines), more) == (5, 3)


def test_the_same_of_several_runs_is_one_line() -> None:
    told = [finding("spike", message=f"{name}: a reading leaves") for name in ("a.nc", "b.nc", "c.nc")]
    (line,), more = in_brief(told, ["current"], ["a.nc", "b.nc", "c.nc"])
    assert line.text == "a.nc: a reading leaves (3 runs alike)"
    assert more == 0


@pytest.mark.parametrize("width", [40, 60, 91])
def test_a_text_is_never_cut_within_a_word_or_a_bracket(width: int) -> None:
    text = "the strip draws 3 mA (more than 2 mA, as measured) at rest; so it leaks, or the zero of its amplifier moved"
    short = shortened(text, width)
    assert len(short) <= width
    assert short.removesuffix(" ...") in (text, text.replace(" (more than 2 mA, as measured)", "")[: len(short)])
    assert short.endswith(("rest", "leaks", "moved"))
    assert short.count("(") == short.count(")")


def test_a_run_goes_by_its_file(tmp_path: Path) -> None:
    from ipmclab import read_run, write_run

    run = noisy(np.random.default_rng(20261121), "step 1 V delay=1 s")
    named = replace(run, metadata=RunMetadata(signal="step 1 V", source_file="raw.csv", starts_from_rest=True))
    write_run(named, tmp_path / "mine.nc")
    fit = identify(FRIEND, read_run(tmp_path / "mine.nc"))
    assert [one.label for one in fit.observations] == ["mine.nc"]


def test_a_simulated_strip_without_noise_is_followed() -> None:
    strip_2 = load_actuator("friend-2")
    fit = identify(strip_2, simulate(strip_2, "step 1 V", duration=10.0, rate=25.0))
    assert answer_of(fit).verdict.startswith("This fit can be used")


def test_a_contradiction_says_what_contradicts_what() -> None:
    told = Finding(
        "density-against-mass",
        "warning",
        "a mass of 113 mg and a density of 3965 kg/m^3 need a thickness of 0.19 mm, but the model has 0.245 mm",
        values={"sigmas": 6.34},
    )
    (line,), _ = in_brief([told])
    assert line.text == "mass and density contradict the thickness of the model, by 6.3 standard uncertainties"
