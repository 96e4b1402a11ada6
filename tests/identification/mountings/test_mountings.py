"""What the next mounting will say, against mountings that were drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from ipmclab import (
    Fit,
    InputError,
    RunMetadata,
    identify,
    leave_one_run_out,
    prediction_bands,
    read_fit,
    simulate,
    validate,
    write_fit,
)
from ipmclab.cli.many_runs import many_runs_document, print_many_runs
from ipmclab.identification.mountings.mountings import Mounting, differ, why_unknown
from ipmclab.model import Actuator
from ipmclab.prediction.remarks import averages
from ipmclab.reporting.many_runs import left_out_rows, many_runs_part
from ipmclab.reporting.tables import parameter_rows
from ipmclab.run import Run
from tests.identification.many import CONTACT, ELECTRICAL, FRIEND, mounted, noisy

SEED = 20261121
FREE = [*ELECTRICAL[:1], *ELECTRICAL[3:]]


def drawn(generator: np.random.Generator, count: int, spread: float) -> tuple[list[Run], list[dict[str, float]]]:
    runs, truths = [], []
    for number in range(count):
        strip, values = mounted(generator, spread)
        runs.append(noisy(generator, "square 1 V 0.1 Hz", strip=strip, mounting=f"strip-7-{number}"))
        truths.append(dict(values))
    return runs, truths


def test_three_mountings_that_are_well_known_give_students_interval() -> None:
    generator = np.random.default_rng(SEED)
    runs, truths = [], []
    for number in range(3):
        strip, values = mounted(generator, 0.3)
        runs.append(noisy(generator, "square 1 V 0.02 Hz", strip=strip, duration=100.0, mounting=f"strip-7-{number}"))
        truths.append(values)
    fit = identify(FRIEND, runs)
    for name in ELECTRICAL:
        logs = np.log([truth[name] for truth in truths])
        reach = scipy.stats.t.ppf(0.975, 2) * logs.std(ddof=1) * np.sqrt(1.0 + 1.0 / 3.0)
        found = fit.parameters[name].interval_next_mounting
        assert found is not None
        # The mountings are known to a percent, not exactly.
        assert np.log(found) == pytest.approx([logs.mean() - reach, logs.mean() + reach], abs=0.06 * reach)
    assert "mountings-differ" in {finding.code for finding in fit.findings}
    assert len({observation.label for observation in fit.observations}) == len(runs)
    # That they differ is expected: one line, and no warning for each pair.
    (expected,) = (finding for finding in fit.findings if finding.code == "prefix-disagrees")
    assert (expected.severity, expected.channel) == ("info", "current")
    assert expected.values["pairs"] != 1
    assert averages(fit)
    assert all("average of mountings" in row.remark for row in parameter_rows(fit) if row.name in averages(fit))
    assert why_unknown(fit) == ""


def test_what_gives_way_to_a_shared_value_that_differs_is_no_better() -> None:
    """Only one parameter differs from mounting to mounting; held equal, it drags others along."""
    generator = np.random.default_rng(SEED)
    differing, dragged = "circuit.dc_resistivity", "circuit.branches.0.permittivity"
    runs = [
        noisy(
            generator,
            "square 1 V 0.02 Hz",
            duration=60.0,
            strip=FRIEND.replace(**{differing: factor * FRIEND[differing]}),
            mounting=f"strip-7-{number}",
        )
        for number, factor in enumerate((0.7, 1.0, 1.4))
    ]
    fit = identify(FRIEND, runs)
    low, high = fit.parameters[dragged].interval
    assert not low <= FRIEND[dragged] <= high
    assert {differing, dragged} <= averages(fit)
    told = fit.parameters[dragged].interval_next_mounting
    assert told is not None
    assert told[0] <= min(low, FRIEND[dragged])
    assert max(high, FRIEND[dragged]) <= told[1]
    said = {row.name: row.remark for row in parameter_rows(fit)}
    assert "average of mountings" in said[dragged]


def test_the_interval_holds_another_mounting() -> None:
    """Six strips of four mountings; ``benchmarks.mountings`` has hundreds."""
    generator = np.random.default_rng(SEED)
    inside = []
    for _ in range(6):
        runs, truths = drawn(generator, 5, 0.1)
        fit = identify(FRIEND, runs[:4])
        for name in ELECTRICAL:
            found = fit.parameters[name].interval_next_mounting
            assert found is not None
            inside.append(found[0] <= truths[4][name] <= found[1])
    # 30 answers at 95 %: fewer than 26 come twice in a hundred.
    assert np.mean(inside) >= 0.85


def test_fewer_than_three_mountings_cannot_tell() -> None:
    generator = np.random.default_rng(SEED)
    runs, _ = drawn(generator, 2, 0.1)
    fit = identify(FRIEND, runs)
    assert all(one.interval_next_mounting is None for one in fit.parameters.values())
    assert fit.mountings is not None
    assert fit.mountings.between == {}
    assert all("cannot be estimated from 2 mountings" in reason for reason in fit.mountings.unknown.values())
    assert why_unknown(fit) == (
        "the value at another mounting cannot be estimated from two mountings: it takes three or more of the same strip"
    )
    # That two differ is known all the same.
    assert [finding.code for finding in fit.findings if "mount" in finding.code] == ["mountings-differ"]
    one = identify(FRIEND, runs[:1])
    assert one.mountings is None
    assert "from one mounting" in why_unknown(one)


def test_several_samples_are_no_mountings_of_one() -> None:
    generator = np.random.default_rng(SEED)
    runs = [noisy(generator, "square 1 V 0.1 Hz", mounting=f"m{k}", sample=f"s{k % 2}") for k in range(3)]
    fit = identify(FRIEND, runs)
    assert fit.mountings is None
    assert "more than one strip" in why_unknown(fit)


def test_mountings_that_do_not_differ_are_not_called_different() -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, drawn(generator, 4, 0.0)[0])
    assert "mountings-differ" not in {finding.code for finding in fit.findings}
    assert not averages(fit)
    for name in ELECTRICAL:
        low, high = fit.parameters[name].interval_next_mounting or (np.nan, np.nan)
        assert low <= FRIEND[name] <= high


def test_it_goes_into_the_file_and_back(tmp_path: Path) -> None:
    fit = identify(FRIEND, drawn(np.random.default_rng(SEED), 3, 0.2)[0])
    write_fit(fit, tmp_path / "fitted.toml")
    again = read_fit(tmp_path / "fitted.toml")
    assert again.mountings == fit.mountings
    assert again.parameters == fit.parameters
    assert again.covariance == fit.covariance


def test_each_mounting_has_a_contact_of_its_own() -> None:
    """Three clampings of one strip, of unequal runs; the contact is all that differs."""
    generator = np.random.default_rng(SEED)
    contacts = {"a": 0.5, "b": 1.5, "c": 0.9}
    runs = []
    for mounting, contact in contacts.items():
        strip = FRIEND.replace(**{CONTACT: contact})
        runs.append(noisy(generator, "step 1 V", strip=strip, mounting=mounting))
        runs.append(noisy(generator, "sine 1 V 0.3 Hz", strip=strip, mounting=mounting, duration=12.0, rate=80.0))
    fit = identify(FRIEND, runs, free=FREE, per_mounting=CONTACT)
    for mounting, contact in contacts.items():
        found = fit.parameters[f"{CONTACT}[mounting {mounting}]"]
        assert found.interval[0] <= contact <= found.interval[1]
        assert found.standard_error < 0.02
    values = np.array(list(contacts.values()))
    reach = scipy.stats.t.ppf(0.975, 2) * values.std(ddof=1) * np.sqrt(1.0 + 1.0 / 3.0)
    following = fit.parameters[f"{CONTACT}[mounting a]"].interval_next_mounting
    # A contact resistance is not negative.
    assert following == pytest.approx((max(values.mean() - reach, 0.0), values.mean() + reach), rel=0.05)
    # A run of the fit has the contact of its mounting.
    told = validate(fit.actuator, [runs[2]])
    assert told.scores["current"].rmse == pytest.approx(1e-4, rel=0.1)
    assert told.runs[0].used_in_fit


def test_the_band_of_another_mounting_holds_it() -> None:
    generator = np.random.default_rng(SEED)
    inside = []
    for _ in range(4):
        runs, _ = drawn(generator, 4, 0.1)
        fit = identify(FRIEND, runs)
        strip, _ = mounted(generator, 0.1)
        new = noisy(generator, "sine 1 V 0.2 Hz", strip=strip, mounting="another")
        told = validate(fit.actuator, [new])
        assert told.scores["current"].inside_band is not None
        inside.append(told.scores["current"].inside_band)
        assert [f.severity for f in told.findings if f.code == "another-mounting"] == ["info"]
        assert prediction_bands(fit, new).mounting == "the next"
        narrow = prediction_bands(fit, simulate(FRIEND, "sine 1 V 0.2 Hz", duration=30.0, rate=25.0))
        assert narrow.mounting == "the fit's"
    assert np.mean(inside) > 0.85


def clamped(contact: float) -> Actuator:
    return FRIEND.replace(**{CONTACT: contact})


def fit_of_each_contact(generator: np.random.Generator, contacts: dict[str, float]) -> Fit:
    runs = [
        noisy(generator, signal, strip=clamped(contact), mounting=mounting)
        for mounting, contact in contacts.items()
        for signal in ("step 1 V", "sine 1 V 0.3 Hz")
    ]
    return identify(FRIEND, runs, free="circuit.dc_resistivity", per_mounting=CONTACT)


@pytest.mark.parametrize("contacts", [{"a": 0.3, "b": 1.0}, {"a": 0.3, "b": 1.0, "c": 0.6}])
def test_a_new_run_of_a_mounting_of_the_fit_has_what_that_mounting_has_for_itself(
    tmp_path: Path, contacts: dict[str, float]
) -> None:
    generator = np.random.default_rng(SEED)
    write_fit(fit_of_each_contact(generator, contacts), tmp_path / "fitted.toml")
    fit = read_fit(tmp_path / "fitted.toml")
    for mounting, contact in contacts.items():
        new = noisy(generator, "square 1 V 0.1 Hz", strip=clamped(contact), mounting=mounting)
        told = validate(fit.actuator, [new])
        score = told.scores["current"]
        assert score.rmse == pytest.approx(1e-4, rel=0.1)
        # 750 readings: four standard deviations.
        assert score.inside_band == pytest.approx(0.95, abs=0.032)
        (said,) = [finding for finding in told.findings if "mounting" in finding.code]
        assert (said.code, said.severity) == ("own-mounting", "info")
        assert f"is of mounting {mounting}, and was predicted with that mounting's own {CONTACT} (" in said.message
        assert said.values[CONTACT] == pytest.approx(contact, abs=0.02)
        bands = prediction_bands(fit, new)
        assert (bands.mounting, bands.left_out) == (f"mounting {mounting}", ())
        truth = simulate(clamped(contact), new).channels["current"]
        # Two parameters: four standard deviations of what is not known of them.
        assert np.all(np.abs(bands.predicted["current"] - truth) <= 4.0 * bands.of_parameters["current"] + 1e-12)


def test_a_band_of_a_run_that_names_no_mounting_holds_those_of_the_fit() -> None:
    generator = np.random.default_rng(SEED)
    contacts = {"a": 0.3, "b": 1.0}
    fit = fit_of_each_contact(generator, contacts)
    for contact in contacts.values():
        new = noisy(generator, "square 1 V 0.1 Hz", strip=clamped(contact))
        told = validate(fit.actuator, [new])
        assert (told.scores["current"].inside_band or 0.0) > 0.94
        (said,) = [finding for finding in told.findings if "mounting" in finding.code]
        assert (said.code, said.severity) == ("mounting-not-named", "warning")
        assert f"each of mountings a and b has its own {CONTACT}" in said.message
        assert "its band holds what each of these mountings answers, but not what another would" in said.message
        shunted = RunMetadata(voltage_sensed="upstream of shunt", shunt_resistance=1.0)
        for run in (new, replace(new, metadata=shunted)):
            bands = prediction_bands(fit, run)
            assert (bands.mounting, bands.left_out) == ("the fit's", ())
            truth = simulate(clamped(contact), run).channels["current"]
            low, high = bands.interval("current", of_readings=False)
            size = 2.0 * bands.of_parameters["current"] + 1e-12  # four standard deviations, two of them in the interval
            assert np.all((low - size <= truth) & (truth <= high + size))
            assert np.median((high - low) / np.ptp(truth)) < 0.05
    # Of a mounting that the fit never saw, two others do not tell the contact.
    new = noisy(generator, "square 1 V 0.1 Hz", strip=clamped(0.3), mounting="another")
    assert prediction_bands(fit, new).left_out == (CONTACT,)
    remarks = [finding for finding in validate(fit.actuator, [new]).findings if "mounting" in finding.code]
    assert [(finding.code, finding.severity) for finding in remarks] == [("another-mounting", "warning")]


def test_a_band_says_when_it_does_not_know_of_another_mounting() -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, drawn(generator, 1, 0.0)[0])
    new = noisy(generator, "sine 1 V 0.2 Hz", mounting="another")
    said = [finding for finding in validate(fit.actuator, [new]).findings if finding.code == "another-mounting"]
    assert [finding.severity for finding in said] == ["warning"]
    assert "cannot be estimated" in said[0].message


def test_a_run_that_is_predicted_from_mountings_that_differ_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever shows a run left out says of its prediction what the table says of the parameters."""
    generator = np.random.default_rng(SEED)
    strips = [FRIEND.replace(**{"circuit.dc_resistivity": leak}) for leak in (40.0, 44.0)]
    runs = [
        noisy(generator, signal, strip=strip, mounting=mounting)
        for strip, mounting in zip(strips, "ab", strict=True)
        for signal in ("step 1 V", "square 1 V 0.1 Hz")
    ]
    average = "from an average of mountings that differ: its band holds for none of them"
    other = "from another mounting, and mountings differ: its band does not hold for this one"
    for given, said in (
        (runs, [average] * 4),
        ([*runs[:2], runs[3]], [average, average, other]),  # without the third, the first two are of one mounting
        ([runs[0], runs[3]], [other, other]),
        (runs[:2], ["", ""]),
    ):
        fit = leave_one_run_out(identify(FRIEND, given, free=["circuit.dc_resistivity"]))
        assert bool(averages(fit)) == any(said)
        assert [row.remark for row in left_out_rows(fit)] == said  # of the report, and of the page
        assert [one["remark"] for one in many_runs_document(fit)["left_out"]] == said
        shown = str(many_runs_part(fit))
        print_many_runs(fit)
        printed = " ".join(capsys.readouterr().out.split())
        for sentence in (average, other):
            assert shown.count(f"<td>{sentence}</td>") == printed.count(sentence) == said.count(sentence)


def test_what_the_others_lack_stands_before_what_their_mountings_do() -> None:
    generator = np.random.default_rng(SEED)
    strips = [FRIEND.replace(**{"circuit.dc_resistivity": leak}) for leak in (40.0, 44.0)]
    runs = [noisy(generator, "step 1 V", strip=strip, mounting=name) for strip, name in zip(strips, "ab", strict=True)]
    free = ["circuit.dc_resistivity"]
    fit = leave_one_run_out(identify(FRIEND, runs, free=free, per_mounting=CONTACT))
    for row in left_out_rows(fit):
        assert row.remark.startswith(f"the others do not determine {CONTACT}[mounting ")
        assert "; from another mounting, and mountings differ" in row.remark


def test_a_contact_that_no_mounting_determines_is_said_to_be_unknown() -> None:
    """The current alone leaves the contact open against the branches, in every mounting."""
    generator = np.random.default_rng(SEED)
    runs = [noisy(generator, signal, mounting=name) for name, signal in (("a", "step 1 V"), ("b", "sine 1 V 0.1 Hz"))]
    fit = identify(FRIEND, runs, free="electrical", per_mounting=CONTACT)
    assert not any(one.determined for name, one in fit.parameters.items() if name.startswith(CONTACT))
    assert fit.mountings is not None
    assert "cannot be estimated" in fit.mountings.unknown[CONTACT]
    # What another mounting leaves open is nothing to a run of this one.
    new = noisy(generator, "sine 1 V 0.2 Hz", mounting="a")
    open_names = [name for name in prediction_bands(fit, new).left_out if name.startswith(CONTACT)]
    assert open_names == [f"{CONTACT}[mounting a]"]


def test_messages() -> None:
    generator = np.random.default_rng(SEED)
    run = noisy(generator, "step 1 V")
    with pytest.raises(InputError, match="does not say of which it is") as caught:
        identify(FRIEND, [run], per_mounting=CONTACT)
    assert caught.value.code == "no-mounting"
    with pytest.raises(InputError, match="belongs to each run already") as caught:
        identify(FRIEND, [run], per_run=CONTACT, per_mounting=CONTACT)
    assert caught.value.code == "per-run-and-mounting"
    force = noisy(generator, "step 1 V", outputs=("force",), mounting="b")
    current = noisy(generator, "sine 1 V 0.1 Hz", mounting="a")
    with pytest.raises(InputError, match="no usable current"):
        identify(FRIEND, [current, force], free="coupling", per_mounting="circuit.dc_resistivity")


@pytest.mark.parametrize(("chance", "told"), [(3e-4, True), (3e-3, False)])
def test_mountings_differ_where_chance_makes_it_once_in_a_thousand(chance: float, told: bool) -> None:
    """Of two estimates with one error, the squared distance over twice its variance is chi-square with one degree."""
    name, error = "circuit.dc_resistivity", 0.02
    apart = error * np.sqrt(2.0 * scipy.stats.chi2.isf(chance, 1))
    each = [
        Mounting(str(number), (f"run {number}",), {name: value}, {name: error * value})
        for number, value in enumerate([40.0, 40.0 * np.exp(apart)])
    ]
    found = differ(each, FRIEND)
    assert found == ({name: pytest.approx(chance)} if told else {})
