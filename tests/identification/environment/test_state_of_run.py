"""How a fit knows in which state the strip was in a run."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ipmclab import Run, RunMetadata, Sample, load_actuator
from ipmclab.errors import InputError
from ipmclab.fit.run_state import RunState
from ipmclab.identification.environment.dose import doses_of
from ipmclab.identification.environment.state_of_run import states_of
from ipmclab.model import Actuator

STRIP = load_actuator("friend-2+environment.coupling_gain")


def run(**about: object) -> Run:
    known = {"temperature": 20.0, "relative_humidity": 80.0, **about}
    return Run.from_arrays(
        time=[0.0, 1.0, 2.0], voltage=[1.0, 1.0, 1.0], current=[0.0, 2.0, 2.0], metadata=RunMetadata(**known)
    )


def state(one: Run, strip: Actuator = STRIP) -> RunState:
    return states_of(strip, [one], ["run"])[0]


def test_without_more_a_strip_is_taken_to_be_in_equilibrium() -> None:
    found = state(run())
    assert found.how == "assumed"
    assert found.water_content == pytest.approx(7.219)
    assert found.standard_uncertainty == pytest.approx(23.17 * 0.02)  # slope of the isotherm, 2 %RH
    assert state(run(uncertainties={"relative_humidity": 0.5})).standard_uncertainty == pytest.approx(23.17 * 0.005)


def test_a_mass_measures_the_water() -> None:
    wet = run(mass=1.2e-4, sample=Sample(id="a", dry_mass=1.1e-4))
    found = state(wet)
    assert found.how == "measured"
    heavier = state(replace(wet, metadata=replace(wet.metadata, mass=1.3e-4)))
    assert heavier.water_content == pytest.approx(2.0 * (found.water_content or 0.0))
    assert state(run(mass=1.2e-4)).how == "assumed"  # nobody says what it weighs dry


def test_out_of_water_the_strip_dries_towards_the_air() -> None:
    contents = [state(run(minutes_out_of_water=minutes)).water_content or 0.0 for minutes in (0.0, 5.0, 20.0, 300.0)]
    assert contents[0] == STRIP["hydration.liquid_water_content"]
    assert contents == sorted(contents, reverse=True)
    assert contents[-1] == pytest.approx(7.219, rel=1e-3)
    late = state(run(minutes_out_of_water=300.0))
    assert late.how == "computed"
    # Long after, only the humidity leaves it open.
    assert late.standard_uncertainty == pytest.approx(0.46, rel=0.1)


def test_a_run_begins_where_the_one_before_it_left_the_strip() -> None:
    times = ["2026-11-23T10:00:00+00:00", "2026-11-23T10:10:00+00:00"]
    first = run(recorded_at=times[0], relative_humidity=90.0)
    second = run(recorded_at=times[1], relative_humidity=50.0, minutes_in_environment=5.0)
    later, before = states_of(STRIP, [second, first], ["second", "first"])
    assert (before.how, later.how) == ("assumed", "computed")
    assert 3.4855 < (later.water_content or 0.0) < (before.water_content or 0.0)
    # Nobody knows where the strip was before a run of which no time is stated.
    alone = replace(second, metadata=replace(second.metadata, recorded_at=None))
    assert states_of(STRIP, [first, alone], ["first", "second"])[1].how == "assumed"


def test_a_run_that_does_not_say_its_air_is_refused() -> None:
    with pytest.raises(InputError, match=r"second: parameters follow the environment.*does not say") as caught:
        states_of(STRIP, [run(), run(relative_humidity=None)], ["first", "second"])
    assert caught.value.code == "no-environment"


def test_doses_are_counted_in_the_order_of_the_runs() -> None:
    runs = [run(recorded_at=f"2026-11-23T{hour}:00:00+00:00") for hour in (12, 10, 11)]
    assert doses_of(runs, "runs") == [2.0, 0.0, 1.0]
    assert doses_of(runs, "hours") == [2.0, 0.0, 1.0]
    assert doses_of(runs, "charge") == [6.0, 0.0, 3.0]
    with pytest.raises(InputError, match="does not say when it was recorded"):
        doses_of([run()], "hours")
