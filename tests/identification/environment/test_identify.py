"""``identify`` of runs in many environments, and what command line and report say of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Actuator, Run, RunMetadata, identify, load_actuator, read_fit, read_run, simulate, write_fit
from ipmclab.cli.identify import fit_document, print_fit
from ipmclab.cli.simulate import simulate as simulate_verb
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.free import parse_free
from ipmclab.identification.problem.priors import with_priors
from ipmclab.model.declared import declaration_of
from ipmclab.model.environment import Environment, WaterState
from ipmclab.model.environment.hydration import FILM, LIQUID
from ipmclab.reporting.many_runs import many_runs_part
from ipmclab.strip_state.in_state import in_state
from ipmclab.strip_state.run_state import RunState
from ipmclab.strip_state.state_of_run import water_after

STRIP = load_actuator("friend-2+environment.permittivity")
TRUE = STRIP.replace(**{"environment.permittivity.exponent": 0.6})
LAW = "environment.permittivity.exponent"
BRANCHES = ["circuit.branches.0.permittivity", "circuit.branches.1.permittivity"]


def runs(humidities: tuple[float, ...], true: Actuator = TRUE) -> list[Run]:
    noise = np.random.default_rng(20261123)
    found = []
    for number, humidity in enumerate(humidities):
        clean = simulate(true.at(Environment(20.0, humidity)), "step 0.5 V", duration=12, rate=8)
        assert clean.current is not None
        about = RunMetadata(
            temperature=20.0, relative_humidity=humidity + 2.0 * noise.standard_normal(), run_number=number
        )
        current = clean.current + 1e-4 * noise.standard_normal(len(clean))
        found.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, metadata=about))
    return found


@pytest.fixture(scope="module")
def fit() -> Fit:
    return identify(STRIP, runs((80.0, 50.0, 80.0)), free=[*BRANCHES, "environment"], prior="environment")


def test_the_law_is_found_beside_the_strip_in_its_reference(fit: Fit) -> None:
    one = fit.parameters[LAW]
    assert one.interval[0] < 0.6 < one.interval[1]
    assert fit.actuator["circuit.branches.0.permittivity"] == pytest.approx(0.12, rel=0.1)
    assert not any(finding.code == "prefix-disagrees" for finding in fit.findings)  # other air, another answer


@pytest.mark.parametrize(("slower", "wetter"), [(-1.5, 0.0), (1.0, 1.0), (-1.0, -1.0)])
def test_runs_out_of_water_are_wrong_together(slower: float, wetter: float) -> None:
    """Film and content in liquid water are the same in all of them: what they are off by averages out in none."""
    values = TRUE.parameter_values
    there = {**values, FILM: values[FILM] * np.exp(-0.3 * slower)}
    begin = WaterState(values[LIQUID] * (1.0 + 0.1 * wetter), 20.0)
    noise, found = np.random.default_rng(20261129), []
    for humidity, minutes in ((60.0, 5.0), (60.0, 15.0), (60.0, 40.0), (50.0, 10.0), (50.0, 25.0)):
        water = water_after(there, begin, Environment(20.0, humidity), 60.0 * minutes)
        clean = simulate(TRUE.at(WaterState(water, 20.0)), "step 0.5 V", duration=12, rate=8)
        assert clean.current is not None
        about = RunMetadata(temperature=20.0, relative_humidity=humidity, minutes_out_of_water=minutes)
        current = clean.current + 1e-4 * noise.standard_normal(len(clean))
        found.append(Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, metadata=about))
    fit = identify(STRIP, found, free=[*BRANCHES, LAW])
    for name in (*BRANCHES, LAW):
        low, high = fit.parameters[name].interval
        assert low < TRUE[name] < high, name


def test_a_prior_of_the_literature_is_marked_as_such(fit: Fit, tmp_path: Path) -> None:
    assert fit.parameters[LAW].prior_of_literature
    assert "with the literature's prior" in fit.summary()
    (said,) = [finding.message for finding in fit.findings if finding.code == "prior"]
    assert "as the literature has it" in said
    write_fit(fit, tmp_path / "fitted.toml")
    assert read_fit(tmp_path / "fitted.toml").parameters[LAW].prior_of_literature


def test_how_fast_a_parameter_ages_is_read_from_the_outputs_that_it_moves() -> None:
    """Nothing but the rate of the coupling is free: the displacement is asked, and missed where it is not there."""
    strip = load_actuator("friend-2")
    aged = []
    for number in range(3):
        clean = simulate(
            strip.replace(**{"coupling.gain": strip["coupling.gain"] * np.exp(-0.05 * number)}),
            f"step {1 + number} V",
            duration=4.0,
            rate=20.0,
        )
        about = RunMetadata(run_number=number)
        aged.append(
            Run.from_arrays(
                time=clean.time,
                voltage=clean.voltage,
                current=clean.current,
                displacement=clean.displacement,
                metadata=about,
            )
        )
    rate = identify(strip, aged, free="age.runs.coupling.gain").parameters["age.runs.coupling.gain"]
    assert rate.value == pytest.approx(-0.05, rel=1e-6)
    with pytest.raises(InputError, match=r"age\.runs\.coupling\.gain is free, and there is no usable"):
        identify(strip, [replace(run, displacement=None) for run in aged], free="electrical, age.runs.coupling.gain")
    line = load_actuator("friend-2+line.segments")
    with pytest.raises(InputError, match="is a count, which a fit does not move"):
        identify(line, aged, free="electrical, age.runs.line.segments")


def test_a_group_has_the_priors_that_are_known() -> None:
    names = parse_free(STRIP.parameter_values, [*BRANCHES, "environment"])
    assert list(with_priors(STRIP, names, "environment").priors) == [LAW]
    with pytest.raises(InputError, match="nothing is known beforehand"):
        with_priors(STRIP, names, "circuit.branches.0.permittivity")


def test_a_group_of_which_nothing_is_known_is_refused() -> None:
    names = parse_free(STRIP.parameter_values, "electrical")
    with pytest.raises(InputError, match="nothing is known beforehand of any parameter of 'electrical'"):
        with_priors(STRIP, names, "electrical")


def test_what_moves_the_water_is_no_parameter_of_a_fit() -> None:
    known = STRIP.parameter_values
    for name in ("hydration.film", "hydration.asymmetry", "hydration.sorption.scale", "age.runs.hydration.film"):
        with pytest.raises(InputError, match="computes the water of each run once"):
            parse_free(known, ["electrical", name])
    with pytest.raises(InputError, match="computes the water of each run once"):
        parse_free(known, "electrical", per_run="hydration.film")
    assert parse_free(known, "hydration.percolation").shared == ("hydration.percolation",)


def test_command_line_and_report_show_each_state(fit: Fit, capsys: pytest.CaptureFixture[str]) -> None:
    print_fit(fit, details=True)
    told = capsys.readouterr().out
    assert "water content" in told
    assert "assumed" in told
    page = str(many_runs_part(fit))
    assert "The state of the strip in each run" in page
    document = fit_document(fit)["observations"][0]["state"]
    assert document["how"] == "assumed"
    assert document["found"] == pytest.approx(document["water_content"], rel=0.3)


def test_a_law_that_one_condition_leaves_open_is_named_with_the_condition_that_tells() -> None:
    fit = identify(STRIP, runs((80.0,)), free=[*BRANCHES, LAW])
    (said,) = [finding for finding in fit.findings if finding.code == "law-undetermined"]
    assert LAW in said.message
    assert said.values["relative_humidity"] in (30.0, 45.0)
    assert not fit.parameters[LAW].determined


def test_what_warmth_does_is_told_by_a_run_as_warm_as_common_chambers_make_it() -> None:
    """From runs at 20 degC alone the energy is open, and 40 degC is farther than 15 degC."""
    energy = "environment.dc_resistivity.energy"
    strip = load_actuator("friend-2+environment.dc_resistivity")
    fit = identify(strip, runs((80.0,), strip), free=["circuit.dc_resistivity", energy])
    (said,) = [finding for finding in fit.findings if finding.code == "law-undetermined"]
    assert said.values["temperature"] == 40.0
    assert "a run at 40 degC, " in said.message
    assert f"would determine {energy} best, which runs at 20 degC and " in said.message


def test_what_ages_is_named_by_scale_and_parameter() -> None:
    known = STRIP.parameter_values
    assert parse_free(known, "electrical,age.hours.coupling.gain").age == ("age.hours.coupling.gain",)
    for name, said in (
        ("age.years.coupling.gain", "does not say with what"),
        ("age.runs.coupling.gian", "no such parameter"),
    ):
        with pytest.raises(InputError, match=said):
            parse_free(known, name)
    with pytest.raises(InputError, match="runs at different doses"):
        parse_free(known, "electrical", per_run="age.runs.coupling.gain")


def test_a_fitted_strip_is_simulated_in_an_environment_with_its_interval(
    fit: Fit, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fit(fit, tmp_path / "fitted.toml")
    told = {}
    for environment in ("20 degC, 65 %RH", "45 degC, 65 %RH"):
        out = tmp_path / f"{environment[:2]}.nc"
        simulate_verb(
            str(tmp_path / "fitted.toml"),
            signal="step 0.5 V",
            duration="12 s",
            rate="8 Hz",
            out=out,
            environment=environment,
        )
        told[environment] = capsys.readouterr().out
        found = read_run(out)
        there = TRUE.at(Environment.parse(environment))
        true = simulate(there, "step 0.5 V", duration=12, rate=8)
        assert found.current == pytest.approx(true.current, rel=0.05)
        assert found.metadata.relative_humidity == 65.0
    assert "95 % interval" in told["20 degC, 65 %RH"]
    assert "the laws were never asked there" not in told["20 degC, 65 %RH"]
    assert "the laws were never asked there" in " ".join(told["45 degC, 65 %RH"].split())


def test_runs_that_no_law_brings_together_are_named() -> None:
    given = runs((80.0, 50.0, 65.0))
    about = replace(given[2].metadata, relative_humidity=85.0)  # a sensor that stood in a wet corner
    wrong = replace(given[2], metadata=about)
    fit = identify(STRIP.replace(**{LAW: 0.6}), [*given[:2], wrong], free=BRANCHES)
    (said,) = [finding for finding in fit.findings if finding.code == "water-contradicted"]
    assert "run 2" in said.message


def test_a_law_that_leads_out_of_what_strips_can_be_stays_within() -> None:
    """Gain and energy move together at one temperature: a walk along that valley once ended in an error."""
    far = dict(STRIP.parameter_values) | {LAW: 40.0}
    there = in_state(far, RunState(water_content=20.0, temperature=22.0), ["circuit.branches.0.permittivity"])
    for name, value in there.values.items():
        declared = declaration_of(name)
        assert declared is None or declared.lower <= value <= declared.upper
    assert not there.by.any()  # at its bound it moves no more
