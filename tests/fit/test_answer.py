"""The short answer of a fit: on one screen, causes first, in words that an experimentalist agrees with."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Fit, Run, RunMetadata, identify, import_run, load_actuator, read_fit, simulate, write_fit
from ipmclab.cli.identify import print_fit
from ipmclab.cli.output import print_most_important
from ipmclab.fit.answer import answer_of
from ipmclab.fit.fit_table import changed
from ipmclab.fit.in_brief import MOST, WIDTH, in_brief, shortened
from ipmclab.fit.rows import digits_of
from ipmclab.fit.verdict import verdict
from ipmclab.reporting.notebook import html_of
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


def drawn(run: Run, signal: str) -> Mapping[str, tuple[float, float]]:
    """The size of the noise that was drawn for each reading [SI], and the same relative to the range [percent]."""
    clean = simulate(FRIEND, signal, duration=30.0, rate=25.0)
    found = {}
    for name in set(run.channels) & set(clean.channels) & {"current", "displacement", "force"}:
        size = float(np.std(run.channels[name] - clean.channels[name]))
        found[name] = size, 100.0 * size / float(np.ptp(run.channels[name]))
    return found


STEP = "step 1 V delay=1 s"


@pytest.fixture(scope="module")
def step() -> Run:
    return noisy(np.random.default_rng(20261121), STEP)


@pytest.fixture(scope="module")
def good(step: Run) -> Fit:
    return identify(FRIEND, step, labels=["step.nc"])


@pytest.mark.parametrize(
    ("name", "rows", "starts", "causes"),
    [
        ("step_1V", 1635, "Do not use this fit: the record of the current is wrong, as the first", ["contact-lost"]),
        ("step_2V_poor", None, "This fit can be used to predict the current only for voltages and durations like", []),
        ("step_3V", None, "Do not use this fit: the model does not follow the current", ["contact-missing"]),
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
    # Where the record is the cause, and where what is left is noise that grows with the voltage, no model is blamed.
    assert not {"model-error", "model-incomplete", "stage-missing"} & {one.code for one in answer.findings}
    assert answer.findings[0].code != "sampling-period-unknown"  # which changes no curve
    assert not any(one.text.endswith("...") for one in answer.findings)
    assert (f"{name}.csv.gz" in answer.verdict) != answer.is_refused
    assert f"{name}.csv.gz: " not in fit.summary()  # of one run its name is said once
    assert not any(line.rstrip().endswith((",", ";", ":", "(")) for line in lines if "  " in line)


def test_a_good_fit_may_be_used(good: Fit, step: Run) -> None:
    said = re.fullmatch(
        r"This fit can be used to predict the current \(residual (\S+) % of the range in step.nc\); "
        r"all 5 parameters are determined\.",
        answer_of(good).verdict,
    )
    assert said is not None
    assert float(said[1]) == pytest.approx(drawn(step, STEP)["current"][1], rel=0.05)
    assert "known from these readings" not in good.summary()
    assert good.known


def test_a_fit_that_missed_other_runs_is_not_said_to_predict(good: Fit) -> None:
    said = verdict(good, {"current"})
    assert said.startswith(
        "This fit follows the current of its own runs, but does not predict the current of every other run ("
    )
    assert verdict(good, {"force"}) == answer_of(good).verdict


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
    assert answer_of(fit).verdict.endswith(
        "none of its parameters is determined, but the quantities under 'known from these readings' are known."
    )


def left_open(fit: Fit, determined: Collection[str] = ()) -> Fit:
    """The same fit, of which only some parameters are determined."""
    return replace(
        fit, parameters={name: replace(one, determined=name in determined) for name, one in fit.parameters.items()}
    )


def test_a_fit_of_which_hardly_anything_stands_predicts_voltages_like_its_own() -> None:
    """Slow modes that a short record does not tell apart follow it, and say nothing of another voltage."""
    fit = identify(FRIEND, noisy(np.random.default_rng(20261121), STEP), free="electrical,observation.offset.current")
    zero = "observation.offset.current[0]"
    like_its_own = (
        "This fit can be used to predict the current only for voltages and durations like those of its own runs ("
    )
    bare = replace(left_open(fit, [zero]), known=(), findings=())
    assert verdict(bare).startswith(like_its_own)
    assert verdict(bare).endswith("none of the strip's 5 parameters is determined.")
    # Quantities that stand only if the model holds do not stand where it lacks something.
    lacking = replace(left_open(fit), findings=(finding("model-error"),))
    assert fit.known
    assert verdict(lacking).startswith(like_its_own)
    # Of a model that lacks something most parameters have to stand: one with 3 of 9 followed 11 % of a longer record.
    two, three = list(fit.parameters)[:2], list(fit.parameters)[:3]
    assert verdict(replace(lacking, parameters=left_open(fit, two).parameters)).startswith(like_its_own)
    most = left_open(fit, three)
    assert not verdict(replace(lacking, parameters=most.parameters)).startswith(like_its_own)
    # One parameter of the strip, or what all of them leave fixed, is something.
    anything = "This fit can be used to predict the current ("
    assert verdict(replace(bare, parameters=left_open(fit, ["circuit.dc_resistivity"]).parameters)).startswith(anything)
    assert verdict(replace(left_open(fit), findings=())).startswith(anything)
    # A leak that the model lacks passes for a resistance at the one voltage that was applied: from steps and squares of
    # 2 V a strip with one was fitted to 0.4 % of the range, and a sine of 1.6 V predicted to 82 % of it.
    known = replace(left_open(fit, list(fit.parameters)), findings=())
    electrolysed = replace(known, findings=(finding("above-electrolysis", channel="voltage"),))
    assert verdict(known).startswith(anything)
    assert verdict(electrolysed).startswith(like_its_own)
    rough = replace(bare, observations=tuple(replace(one, noise={"current": 1.0}) for one in bare.observations))
    assert verdict(rough).startswith("This fit predicts the current only roughly and only for voltages and durations")


def test_several_runs_and_outputs_go_by_their_names() -> None:
    generator = np.random.default_rng(20261121)
    signals = {"a.nc": "step 1 V", "b.nc": "sine 1 V 0.2 Hz"}
    runs = [noisy(generator, signal, outputs=("current", "force")) for signal in signals.values()]
    fit = identify(FRIEND, runs, free="circuit.dc_resistivity,coupling.p2", labels=["a.nc", "b.nc"])
    said = answer_of(fit).verdict
    assert said.startswith(
        "This fit can be used to predict the current and force (residual, relative to the range: current"
    )
    told = re.search(r"current at most (\S+) % in (\S+); force at most (\S+) % in (\S+)\)", said)
    assert told is not None
    noise = {label: drawn(run, signal) for (label, signal), run in zip(signals.items(), runs, strict=True)}
    for output, percent, label in (("current", told[1], told[2]), ("force", told[3], told[4])):
        worst = max(noise, key=lambda one: noise[one][output][1])
        assert label == worst
        assert float(percent) == pytest.approx(noise[worst][output][1], rel=0.05)
    assert said.endswith("both parameters are determined.")


def test_a_residual_is_said_in_units_where_the_file_is_older(good: Fit, step: Run, tmp_path: Path) -> None:
    older = changed(good, observations=tuple(replace(one, span={}) for one in good.observations))
    write_fit(older, tmp_path / "older.toml")
    said = re.search(r"\(residual (\S+) mA in step.nc\)", answer_of(read_fit(tmp_path / "older.toml")).verdict)
    assert said is not None
    # Three digits, and what five parameters and a zero take from the noise of 750 readings.
    assert float(said[1]) == pytest.approx(1e3 * drawn(step, STEP)["current"][0], rel=0.02)


def test_a_fit_that_was_read_says_the_same(good: Fit, tmp_path: Path) -> None:
    write_fit(good, tmp_path / "fitted.toml")
    assert read_fit(tmp_path / "fitted.toml").summary() == good.summary()


def test_a_search_that_did_not_end_is_refused(good: Fit) -> None:
    lost = replace(good, converged=False, findings=(finding("not-converged", "error", None), finding("model-error")))
    assert answer_of(lost).verdict == "Do not use this fit: the search did not end at a best fit."
    assert [one.code for one in answer_of(lost).findings] == ["not-converged"]


def test_a_model_that_lacks_something_is_not_the_strip(good: Fit) -> None:
    lacking = answer_of(replace(good, findings=(finding("model-error"),)))
    assert lacking.verdict.endswith("but the model lacks something: they describe this model, not yet the strip.")
    assert lacking.known_title == "known from these readings, if the model holds"
    assert answer_of(replace(good, findings=())).known_title == "known from these readings"


def test_noise_that_nothing_describes_is_no_fault_of_the_model(good: Fit) -> None:
    """Of a hum the verdict said that the model lacks something."""
    hums = replace(good, findings=(finding("noise-not-described"),))
    said = "; intervals may be too small, for no noise model describes what is left."
    assert answer_of(hums).verdict.endswith(f"parameters are determined{said}")
    assert answer_of(hums).known_title == "known from these readings"
    both = replace(good, findings=(finding("noise-not-described"), finding("model-error")))
    assert answer_of(both).verdict.endswith(f"they describe this model, not yet the strip{said}")
    assert not answer_of(replace(left_open(hums), known=())).verdict.endswith(said)


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
    assert [one.code for one in lines] == ["undetermined", "sampling-period-unknown", "response-opposite"]
    assert lines[0].text.endswith("measure the width")


def test_what_changes_the_numbers_comes_before_what_scales_them() -> None:
    told = [
        finding("edge-reading-partial"),
        finding("sampling-period-unknown", channel=None),
        finding("thickness-against-membrane", channel=None),
        finding("above-electrolysis", channel="voltage"),
        finding("undetermined", channel=None, message="a is open; measure the width"),
        finding("model-incomplete"),
        finding("clipped"),
    ]
    lines, _ = in_brief(told, ["current"], most=7)
    assert [one.code for one in lines] == [
        "clipped",
        "model-incomplete",
        "above-electrolysis",
        "undetermined",
        "sampling-period-unknown",
        "thickness-against-membrane",
        "edge-reading-partial",
    ]


def test_a_current_that_rises_asks_for_a_leak_and_for_nothing_that_follows() -> None:
    told = [finding("current-rises"), finding("undetermined", channel=None, message="a is open; record longer")]
    (line,), _ = in_brief(told, ["current"])
    assert "leak.slow" in line.text


def test_a_drift_is_read_in_units_of_its_channel(good: Fit) -> None:
    (one, *_) = good.parameters.values()
    name = "observation.drift.displacement[0]"
    drift = replace(one, name=name, value=-2.15e-6, interval=(-4.3e-6, 0.1e-6), unit="m/s")
    row = next(row for row in answer_of(replace(good, parameters={name: drift})).parameters)
    assert (row.value, row.interval, row.unit) == ("-2.15", "-4.3 to 0.1", "um/s")


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
    assert short in (text, text.replace(" (more than 2 mA, as measured)", "")[: len(short)])
    assert short.endswith(("rest", "leaks", "moved"))
    assert short.count("(") == short.count(")")


AGREE = "a.nc and b.nc do not agree"


@pytest.mark.parametrize(
    ("text", "width", "short"),
    [
        # Behind a colon two words before a comma say nothing; a clause does.
        (f"{AGREE}: of a.nc, without it the gain changes by 5", 50, AGREE),
        (f"{AGREE}: without it the gain changes, so look at it", 60, f"{AGREE}: without it the gain changes"),
        ("record longer, with steps and slow and fast signals and a weaker noise", 40, "record longer"),
        # A sentence that is too long for a line stands whole, on more lines.
        ("the sensor drifts by 0.3 mm over the whole record", 40, "the sensor drifts by 0.3 mm over the whole record"),
        ("the sensor drifts by 0.3 mm; creep looks the same", 20, "the sensor drifts by 0.3 mm"),
    ],
)
def test_a_text_ends_where_a_clause_does(text: str, width: int, short: str) -> None:
    assert shortened(text, width) == short


def test_parameters_are_named_where_they_fit_on_the_line() -> None:
    def line(cure: str, *names: str) -> str:
        told = Finding("undetermined", "warning", f"they are open; {cure}", values=dict.fromkeys(names, 1.0))
        return in_brief([told])[0][0].text

    long = "record longer, with steps and slow and fast signals"
    first, second = "circuit.branches.0.resistivity", "circuit.branches.1.permittivity"
    assert line(long, first, second) == f"to determine {first} and {second}: {long}"
    assert line(long, "coupling.gain", "coupling.p2") == f"to determine coupling.gain and coupling.p2: {long}"
    assert line(long, first, second, "leak.a") == f"to determine {first} and 2 more: {long}"
    assert (
        line("record faster", "leak.a", "leak.b", "leak.c") == "to determine leak.a, leak.b and leak.c: record faster"
    )
    assert (
        line(long, 80 * "x", "leak.b")
        == "to determine 2 parameters: record longer, with steps and slow and fast signals"
    )


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


LONG = "a-very-long-name-of-a-series-of-records-made-in-the-humid-chamber-on-monday-by-two-people-a.nc"


@pytest.mark.parametrize(
    "told",
    [
        Finding(
            "undetermined", "warning", "it is open; measure the width", values={f"{LONG}[mounting strip-7-0]": 1.0}
        ),
        Finding("undetermined", "warning", "it is open; measure the width", values=dict.fromkeys((LONG, "b"), 1.0)),
        Finding("undetermined", "warning", "it is open; measure the width"),
        Finding("model-error", "warning", f"{LONG}: the model leaves 0.3 mA of the current", channel="current"),
        Finding("contact-lost", "error", f"{LONG}: none flows", channel="current", samples=((10**6, 10**7),)),
        Finding("odd", "error", f"{LONG}: {LONG}{LONG}", channel="force"),
    ],
)
def test_long_names_leave_room_for_what_is_said(told: Finding) -> None:
    (line,), _ = in_brief([told], ["current"], [LONG, "b.nc"])
    assert all(len(one) <= WIDTH for one in str(line).splitlines())
    if told.code == "undetermined":
        assert re.fullmatch(r"to determine (1|2|more) parameters?: measure the width", line.text)


def test_advice_stands_whole_below_its_severity() -> None:
    """On as many lines as it needs, each within the columns of a terminal."""
    cure = "record at several voltages above the threshold of the leak, by a slow sine or by steps, each for a minute"
    told = Finding("undetermined", "warning", f"it is open; {cure}", values={"leak.exponential.current_density": 1.0})
    first, *others = str(in_brief([told])[0][0]).splitlines()
    assert others
    assert all(line.startswith(9 * " ") and line[9] != " " for line in others)
    assert max(map(len, [first, *others])) <= WIDTH
    whole = " ".join([first, *(line.strip() for line in others)])
    assert whole == f"warning  to determine leak.exponential.current_density: {cure}"


def test_each_finding_of_one_kind_is_said_or_counted() -> None:
    told = [
        finding("at-bound", message="circuit.sheet_resistance went to its bound"),
        finding("at-bound", message="beam.modulus went to its bound"),
        finding("exact-fixed-value", message="coupling.p2 is taken as exact"),
        finding("exact-fixed-value", message="geometry.thickness is taken as exact"),
    ]
    lines, more = in_brief(told, ["current"], ["step.nc"])
    assert [line.text for line in lines] == [one.message for one in told]
    assert more == 0
    lines, more = in_brief(told, ["current"], ["step.nc"], most=3)
    assert (len(lines), more) == (3, 1)


def test_what_one_run_has_twice_is_said_twice() -> None:
    told = [
        finding("spike", message=f"{label}: a reading leaves at {row}")
        for label, row in (("a.nc", 1), ("a.nc", 2), ("b.nc", 3))
    ]
    lines, more = in_brief(told, ["current"], ["a.nc", "b.nc"])
    assert [line.text for line in lines] == [
        "a.nc: a reading leaves at 1 (2 runs alike)",
        "a.nc: a reading leaves at 2",
    ]
    assert more == 0


def test_a_model_that_does_not_allow_the_current_is_no_fault_of_the_record(good: Fit) -> None:
    told = (
        finding("impossible-current", "error"),
        finding("stage-missing"),
        finding("model-error", channel="force"),
        finding("density-against-mass", channel=None),
        finding("undetermined", channel=None, message="a is open; measure the width"),
    )
    answer = answer_of(replace(good, findings=told))
    assert answer.verdict == "Do not use this fit: the model's series resistance does not allow the measured current."
    told_of = [one.code for one in in_brief(told, ["current", "force"])[0]]
    assert told_of == ["impossible-current", "model-error", "undetermined", "density-against-mass"]
    nothing = (finding("model-explains-nothing", "error"), *told)
    assert answer_of(replace(good, findings=nothing)).verdict == answer.verdict
    assert [one.code for one in in_brief(nothing, ["current", "force"])[0]] == ["impossible-current"]


def test_a_peak_that_the_model_does_not_allow_is_said_once() -> None:
    told = [finding("peak-above-series-resistance"), finding("impossible-current", "error")]
    assert [one.code for one in in_brief(told)[0]] == ["impossible-current"]
    assert [one.code for one in in_brief(told[:1])[0]] == ["peak-above-series-resistance"]


def test_a_fit_of_no_use_shows_no_numbers(good: Fit) -> None:
    told = replace(good, findings=(finding("contact-lost", "error", message="the contact was open"),))
    first, second, *rest = told.summary().splitlines()
    assert first.startswith("Do not use this fit")
    assert second == "error    the contact was open"
    assert rest == ["its values: see fit.findings"]
    assert "<table" not in html_of(told).partition("Do not use this fit")[0]
    parameter = next(iter(good.parameters))
    assert parameter not in told.summary()
    assert parameter in good.summary()


def test_a_record_that_is_wrong_comes_before_what_the_model_does_not_allow(good: Fit) -> None:
    told = (finding("impossible-current", "error"), finding("contact-lost", "error"))
    answer = answer_of(replace(good, findings=told))
    assert answer.verdict == "Do not use this fit: the record of the current is wrong, as the first finding says."
    assert [one.code for one in answer.findings] == ["contact-lost"]


def test_what_two_runs_do_not_follow_is_no_fault_of_their_records(good: Fit) -> None:
    told = tuple(finding("model-explains-nothing", "error", message=f"{label}: nothing") for label in ("a.nc", "b.nc"))
    assert (
        answer_of(replace(good, findings=told)).verdict == "Do not use this fit: the model does not follow the current."
    )


def test_an_open_contact_is_a_stretch_of_rows() -> None:
    told = Finding("contact-lost", "error", "step.nc: none flows", channel="current", samples=((100, 292),))
    (line,), _ = in_brief([told], ["current"], ["step.nc"])
    assert line.text.endswith("no current flows from row 100 to row 291")


@pytest.mark.parametrize(
    ("value", "width", "digits"),
    [(1e-200, 1e200, 3), (1e200, 1e-200, 12), (5e-324, 5e-324, 3), (1.0, 0.01, 4), (math.inf, 1.0, 4), (0.0, 1.0, 4)],
)
def test_digits_of_any_number(value: float, width: float, digits: int) -> None:
    assert digits_of(value, width) == digits


def test_a_fit_of_nothing_is_said_to_be_one(good: Fit) -> None:
    assert answer_of(replace(good, observations=())).verdict == "Do not use this fit: it holds no readings."
    nothing = tuple(replace(one, noise={}, span={}) for one in good.observations)
    assert answer_of(replace(good, observations=nothing)).verdict == "Do not use this fit: it holds no readings."


def test_a_fit_without_parameters_says_so(good: Fit) -> None:
    fixed = replace(good, parameters={}, findings=())
    assert answer_of(fixed).verdict.endswith("of the range in step.nc); no parameter was free.")
    assert fixed.summary().splitlines()[0].split() == ["parameter", "value", "95", "%", "interval", "unit"]
    lacks = answer_of(replace(fixed, findings=(finding("model-error"),))).verdict
    assert lacks.endswith("and the model lacks something: the values describe this model, not yet the strip.")


def test_a_residual_of_exactly_zero_is_one_of_the_range(good: Fit) -> None:
    exact = replace(good, observations=tuple(replace(one, noise={"current": 0.0}) for one in good.observations))
    assert "(residual 0 % of the range in step.nc)" in answer_of(exact).verdict


def test_the_rest_stands_where_it_can_be_read(good: Fit, capsys: pytest.CaptureFixture[str]) -> None:
    told = replace(good, findings=tuple(finding(f"code-{number}") for number in range(MOST + 2)))
    assert told.summary().endswith("\n2 more findings: see fit.findings")
    assert "2 more findings: see fit.findings" in html_of(told)
    print_fit(told)
    assert capsys.readouterr().out.endswith("\n2 more findings: --details, or the report\n")
    print_fit(told, where="--json")
    assert capsys.readouterr().out.endswith("\n2 more findings: --json\n")
    print_most_important(told.findings, details=False)
    assert capsys.readouterr().out.endswith("\n2 more findings: --details\n")


def test_only_a_row_of_the_table_is_longer_than_a_line(good: Fit) -> None:
    (first, *_), (one, *_) = good.parameters, good.parameters.values()
    long = replace(good, parameters={f"{first}[{LONG}]": one}, findings=(finding("odd", message=LONG * 2),))
    long = replace(long, observations=tuple(replace(one, label=LONG) for one in long.observations))
    lines = long.summary().splitlines()
    assert len(lines[1]) > WIDTH
    assert max(map(len, lines[2:])) <= WIDTH
