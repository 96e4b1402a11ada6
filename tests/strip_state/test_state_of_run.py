"""How a fit knows in which state the strip was in a run."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest

from ipmclab import Run, RunMetadata, Sample, load_actuator
from ipmclab.errors import InputError
from ipmclab.identification.environment.with_states import with_states
from ipmclab.identification.problem.record import prepare
from ipmclab.model import Actuator
from ipmclab.model.environment import Environment, WaterState
from ipmclab.model.environment.hydration import FILM
from ipmclab.strip_state import dose
from ipmclab.strip_state.dose import dose_now, doses_of
from ipmclab.strip_state.doubtful import doubtful, extrapolated
from ipmclab.strip_state.run_state import RunState
from ipmclab.strip_state.state_of_run import restated, states_of, water_after

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


@pytest.mark.parametrize("mass", [1.1e-4, 1.0e-4])
def test_a_strip_that_is_not_heavier_than_dry_is_refused_and_its_run_named(mass: float) -> None:
    heavy = run(mass=1.2e-4, sample=Sample(id="a", dry_mass=1.1e-4))
    light = replace(heavy, metadata=replace(heavy.metadata, mass=mass))
    with pytest.raises(InputError, match=r"second: the strip weighs .* and 110 mg when dry; correct the mass"):
        states_of(STRIP, [heavy, light], ["first", "second"])


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
    # No longer than since the run before, however long the strip has been in this air in all.
    third = run(recorded_at="2026-11-23T10:05:00+00:00", relative_humidity=50.0, minutes_in_environment=20.0)
    assert states_of(STRIP, [first, third], ["first", "third"])[1].water_content == later.water_content
    # Nobody knows where the strip was before a run of which no time is stated.
    alone = replace(second, metadata=replace(second.metadata, recorded_at=None))
    assert states_of(STRIP, [first, alone], ["first", "second"])[1].how == "assumed"


def test_the_time_since_the_run_before_counts_once() -> None:
    """Three runs 5 min apart out of water: as one run that begins where each does."""
    runs = [
        run(
            recorded_at=f"2026-11-23T10:{place:02d}:00+00:00",
            minutes_out_of_water=21.0 + place,
            minutes_in_environment=20.0 + place,
        )
        for place in (0, 5, 10)
    ]
    found = [one.water_content for one in states_of(STRIP, runs, ["a", "b", "c"])]
    alone = [state(run(minutes_out_of_water=minutes)).water_content for minutes in (21.0, 26.0, 31.0)]
    assert found == pytest.approx(alone, rel=1e-4)


def test_a_bench_that_does_not_wait_for_the_clock_says_by_its_minutes_how_long_the_strip_was_there() -> None:
    """In lock-step three hours of a simulated bench pass in seconds, and runs follow each other within one."""
    one = run(relative_humidity=45.0, recorded_at="2026-11-23T05:38:21+00:00", sample=Sample(id="a"))
    two = run(minutes_in_environment=600.0, recorded_at="2026-11-23T05:38:22+00:00", sample=Sample(id="a"))
    assert states_of(STRIP, [one, two], ["one", "two"])[1].water_content == pytest.approx(7.219, rel=1e-3)


def test_liquid_water_after_the_run_before_is_the_start() -> None:
    yesterday = run(recorded_at="2026-11-22T10:00:00+00:00", relative_humidity=40.0)
    today = run(recorded_at="2026-11-23T10:00:00+00:00", minutes_out_of_water=35.0, minutes_in_environment=30.0)
    found = states_of(STRIP, [yesterday, today], ["yesterday", "today"])[1]
    assert found.water_content == state(run(minutes_out_of_water=35.0)).water_content


@pytest.mark.parametrize("began", [0.0, 1e6])
@pytest.mark.parametrize(("minutes", "from_water"), [(30.0, False), (60.0, True)])
def test_of_liquid_water_and_the_run_before_the_later_one_is_the_start(
    minutes: float, from_water: bool, began: float
) -> None:
    then = datetime.fromisoformat("2026-11-23T10:00:00+00:00")
    first = run(recorded_at=then.isoformat(), relative_humidity=40.0)
    first = replace(first, time=first.time + began)  # whenever its clock began
    later = (then + timedelta(minutes=minutes)).isoformat()
    second = run(recorded_at=later, minutes_out_of_water=35.0, minutes_in_environment=minutes)
    found = states_of(STRIP, [first, second], ["first", "second"])[1].water_content
    assert (found == state(run(minutes_out_of_water=35.0)).water_content) is from_water


def test_lock_step_counts_the_minutes_that_are_stated() -> None:
    about = {"minutes_in_environment": 20.0, "sample": Sample(id="a")}
    first = run(relative_humidity=45.0, recorded_at="2026-11-23T05:00:00+00:00", sample=Sample(id="a"))
    at_once, waited = (run(recorded_at=f"2026-11-23T05:{when}+00:00", **about) for when in ("00:01", "20:00"))
    found = [states_of(STRIP, [first, one], ["first", "second"])[1].water_content for one in (at_once, waited)]
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def test_a_water_that_is_computed_is_as_sure_as_its_start_and_its_film() -> None:
    """10 % of the liquid content and 30 % of the film, where the actuator states nothing."""
    values, air, minutes = STRIP.parameter_values, Environment(20.0, 80.0), 5.0
    wet, wetter = WaterState(22.0, 20.0), WaterState(24.2, 20.0)
    middle = water_after(values, wet, air, 60.0 * minutes)
    drier, slower, faster = WaterState(19.8, 20.0), values[FILM] * math.exp(-0.3), values[FILM] * math.exp(0.3)
    of_start = water_after(values, wetter, air, 60.0 * minutes) - water_after(values, drier, air, 60.0 * minutes)
    of_film = [water_after({**values, FILM: film}, wet, air, 60.0 * minutes) for film in (slower, faster)]
    found = state(run(minutes_out_of_water=minutes, uncertainties={"relative_humidity": 0.0}))
    assert found.water_content == middle
    assert found.standard_uncertainty == pytest.approx(0.5 * math.hypot(of_start, of_film[0] - of_film[1]), rel=1e-9)


@pytest.mark.parametrize("humidity", [0.0, 100.0])
def test_no_air_is_drier_than_dry_or_wetter_than_saturated(humidity: float) -> None:
    assert state(run(relative_humidity=humidity, minutes_out_of_water=5.0)).standard_uncertainty > 0.0


def test_metal_holds_no_water() -> None:
    """Sample 2 of the thesis took up 10 mg: 11.23 by the 54.4 mg of polymer that a N117 of its size weighs."""
    sample = Sample(id="2", dry_mass=1.03e-4, nominal_membrane_thickness=1.83e-4)
    found = state(run(mass=1.13e-4, sample=sample))
    assert found.water_content == pytest.approx(11.23, rel=0.01)
    assert found.standard_uncertainty > 0.05 * 11.2
    plated = state(run(mass=1.13e-4, sample=replace(sample, nominal_membrane_thickness=None)))
    assert plated.standard_uncertainty > 0.25 * (plated.water_content or 0.0)


def test_a_simulated_run_knows_its_water() -> None:
    wet = run(origin="simulated", relative_humidity=100.0, water_content=22.0, water_content_origin="assumed")
    found = state(wet)
    assert (found.water_content, found.standard_uncertainty, found.how) == (22.0, 0.0, "assumed")
    read = replace(wet, metadata=replace(wet.metadata, origin="measured"))
    assert state(read).water_content == pytest.approx(14.003)


@pytest.mark.parametrize(("membrane", "of_sites"), [(None, 0.25), (1.83e-4, 0.05)])
@pytest.mark.parametrize(("stated", "of_mass"), [({}, 0.01), ({"mass": 1e-6}, 0.1)])
def test_a_weighed_water_is_as_sure_as_its_balance_and_its_sites(
    membrane: float | None, of_sites: float, stated: dict[str, float], of_mass: float
) -> None:
    """The sites are those of every weighed run; 0.1 mg, 5 % or (plated thickness) 25 % where nothing is stated."""
    sample = Sample(id="a", dry_mass=1.1e-4, nominal_membrane_thickness=membrane)
    found, other = states_of(STRIP, [run(mass=1.2e-4, sample=sample, uncertainties=stated)] * 2, ["one", "other"])
    water = found.water_content or 0.0
    assert found.standard_uncertainty == pytest.approx(water * math.hypot(of_mass, of_sites))
    assert found.shared == other.shared == pytest.approx({"observation.ionic_groups": water * of_sites})
    assert state(run(mass=1.2e-4, sample=sample)).shared == {}  # nothing is shared with no other run


def test_what_is_off_in_the_film_and_at_the_start_is_off_in_every_run_that_rests_on_it() -> None:
    """The sensor's error is that of each run; a run that begins where another ended has the error of that one too."""
    film, liquid = "observation.film", "observation.liquid_water"
    alike = [run(minutes_out_of_water=minutes) for minutes in (5.0, 20.0)]
    first, second = states_of(STRIP, alike, ["first", "second"])
    assert first.shared.keys() == second.shared.keys() == {film, liquid}
    assert first.shared[film] < 0.0 < first.shared[liquid]
    assert 0.0 < first.own_uncertainty < first.standard_uncertainty
    times = ["2026-11-23T10:00:00+00:00", "2026-11-23T10:05:00+00:00"]
    before = run(recorded_at=times[0], relative_humidity=90.0)
    after = run(recorded_at=times[1], relative_humidity=50.0, minutes_in_environment=5.0)
    begun, ended = states_of(STRIP, [before, after], ["before", "after"])
    assert begun.shared == {"observation.before.0": pytest.approx(begun.standard_uncertainty)}
    assert 0.0 < ended.shared["observation.before.0"] < begun.standard_uncertainty


def test_the_water_of_runs_is_known_along_the_tangent_where_readings_put_the_film() -> None:
    """Where they make it much slower: what it makes of the water there, not where it was thought to be."""
    alike = [run(minutes_out_of_water=minutes) for minutes in (10.0, 60.0)]
    states = states_of(STRIP, alike, ["first", "second"])
    off = {"observation.film": -2.0}
    found = restated(STRIP, list(zip(alike, states, strict=True)), off)
    assert found is not None
    slow = STRIP.replace(**{FILM: STRIP[FILM] * math.exp(-0.6)})
    for one, other, known in zip(found, states_of(slow, alike, ["first", "second"]), states, strict=True):
        assert one.content_at(off) == pytest.approx(other.water_content, rel=1e-9)
        assert (one.water_content, one.standard_uncertainty) == (known.water_content, known.standard_uncertainty)
        assert RunState.from_table(one.to_table()) == one
    assert restated(STRIP, list(zip(alike, found, strict=True)), off) is None


def test_what_is_assumed_of_a_start_is_in_the_water() -> None:
    just_out = state(run(minutes_out_of_water=0.0))
    assert just_out.water_content == pytest.approx(22.0)
    assert just_out.standard_uncertainty == pytest.approx(2.2)
    assert state(run(origin="simulated")).standard_uncertainty == 0.0  # its air is known


def test_a_wet_sensor_reads_a_little_more_than_saturation() -> None:
    assert state(run(relative_humidity=100.4)).water_content == pytest.approx(14.003)


def test_an_air_that_was_read_and_is_not_stated_is_known() -> None:
    """It was refused as a run that does not say its temperature and humidity."""
    read = {"temperature": [19.0, np.nan, 21.0], "relative_humidity": [79.0, 81.0, np.nan]}
    bare = Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[1.0] * 3, metadata=RunMetadata(), **read)
    assert (state(bare).temperature, state(bare).relative_humidity) == (20.0, 80.0)
    assert state(bare).water_content == state(run()).water_content


def test_a_run_that_does_not_say_its_air_is_refused() -> None:
    with pytest.raises(InputError, match=r"second: parameters follow the environment.*does not say") as caught:
        states_of(STRIP, [run(), run(relative_humidity=None)], ["first", "second"])
    assert caught.value.code == "no-environment"


def test_doses_are_counted_in_the_order_of_the_runs() -> None:
    runs = [run(recorded_at=f"2026-11-23T{hour}:00:00+00:00") for hour in (12, 10, 11)]
    assert doses_of(runs, "runs") == [2.0, 0.0, 1.0]
    assert doses_of(runs, "hours") == [2.0, 0.0, 1.0]
    assert doses_of(runs, "charge") == [6.0, 0.0, 3.0]
    with pytest.raises(InputError, match="does not state when it was recorded"):
        doses_of([run()], "hours")


def test_a_current_that_is_read_again_has_flowed_meanwhile() -> None:
    """Readings that are missing counted as no current."""
    known = [run(run_number=number) for number in (1, 2)]
    current = np.full(3, 2.0)
    gap = replace(known[0], current=np.where([False, True, False], np.nan, current))
    assert doses_of([gap, known[1]], "charge") == [0.0, 4.0]
    nothing = replace(known[0], current=np.full(3, np.nan))
    with pytest.raises(InputError, match=r"runs\[0\]: .* this run has no current"):
        doses_of([nothing, known[1]], "charge")


def test_a_time_that_the_computer_does_not_know_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows gives an OSError for a local time before 1970, such as that of a clock that counts from 1904."""

    class Clock(datetime):
        def timestamp(self) -> float:
            raise OSError(22, "Invalid argument")

    monkeypatch.setattr(dose, "datetime", Clock)
    assert math.isnan(dose.recorded(run(recorded_at="1904-01-01T00:00:00")))


def test_runs_that_are_not_given_count_where_all_are_numbered() -> None:
    assert doses_of([run(run_number=number) for number in (20, 1, 2)], "runs") == [19.0, 0.0, 1.0]
    # Numbers that begin again with each day tell nothing: those that are given are counted.
    days = [
        run(run_number=number, recorded_at=f"2026-11-{day}T10:00:00+00:00")
        for number, day in ((5, 20), (1, 21), (2, 22))
    ]
    assert doses_of(days, "runs") == [0.0, 1.0, 2.0]


def test_what_only_some_runs_state_orders_none() -> None:
    day = "2026-11-20T10:00:00+00:00"
    some_times = [run(run_number=number, recorded_at=when) for number, when in ((20, day), (1, day), (2, None))]
    assert doses_of(some_times, "runs") == [19.0, 0.0, 1.0]
    assert doses_of([run(run_number=number) for number in (2, None, 1)], "runs") == [0.0, 1.0, 2.0]
    # A number that is there twice tells nothing of what came between.
    assert doses_of([run(run_number=number) for number in (1, 1, 2)], "runs") == [0.0, 1.0, 2.0]


def test_a_run_adds_its_hours_and_what_is_not_known_adds_nothing() -> None:
    long = Run.from_arrays(time=[100.0, 3700.0, 7300.0], voltage=[1.0] * 3)
    assert dose.added_by(long, "hours", 0) == 2.0
    assert dose_now([], "hours") == dose_now([RunState()], "hours") == 0.0


def test_the_next_run_comes_after_the_last_one() -> None:
    runs = [run(run_number=number) for number in (1, 2, 3)]
    records = [prepare(one, place, ["current"], ()) for place, one in enumerate(runs)]
    ages = ["age.runs.coupling.gain", "age.charge.coupling.gain"]
    states = [record.state for record in with_states(STRIP, runs, records, ages) if record.state is not None]
    assert [state.doses for state in states] == [{"runs": float(k), "charge": 3.0 * k} for k in range(3)]
    assert dose_now(states, "runs") == 3.0
    assert dose_now(states, "charge") == 9.0
    assert RunState.from_table(states[2].to_table()) == states[2]


@pytest.mark.parametrize(
    ("temperature", "humidity", "said"),
    [
        (19.0, 39.0, None),  # a sensor is no better than 1 K and 1 %RH
        (31.0, 81.0, None),
        (25.0, 60.0, None),
        (31.1, 60.0, "the run is at 31.1 degC, and the runs of the fit were at 20 to 30 degC:"),
        (18.9, 60.0, "18.9 degC"),
        (25.0, 81.1, "the run is at 81.1 %RH, and the runs of the fit were at 40 to 80 %RH:"),
        (25.0, 38.9, "38.9 %RH"),
        (40.0, 90.0, "40 to 80 %RH; and at 40 degC, and the runs of the fit were at 20 to 30 degC"),
        (None, 60.0, None),
        (31.1, None, "31.1 degC"),
    ],
)
def test_a_state_outside_of_those_of_a_fit_is_told(
    temperature: float | None, humidity: float | None, said: str | None
) -> None:
    def at(warm: float | None, wet: float | None) -> RunState:
        return RunState(5.0, 0.1, "assumed", warm, wet)

    seen = [at(30.0, 40.0), at(None, None), at(20.0, 80.0)]
    found = extrapolated(at(temperature, humidity), seen, "the run")
    assert [one.code for one in found] == ([] if said is None else ["environment-extrapolated"])
    assert said is None or said in found[0].message
    assert extrapolated(at(temperature, humidity), [at(None, None)], "the run") == []


def test_a_run_whose_air_moves_its_water_is_named() -> None:
    def codes(**about: object) -> set[str]:
        long = Run.from_arrays(time=[0.0, 600.0, 1200.0], voltage=[1.0] * 3, metadata=replace(run().metadata, **about))
        return {finding.code for finding in doubtful(STRIP, long, state(long), "long")}

    assert codes() == set()
    assert codes(water_content=12.0, water_content_origin="measured") == {"water-moves"}
    assert codes(minutes_out_of_water=10.0) == {"water-moves"}
    assert codes(minutes_out_of_water=300.0) == set()
    assert codes(origin="simulated", water_content=12.0) == set()  # what was simulated need not move


def test_a_short_run_moves_little_water_whenever_its_clock_began() -> None:
    soon = replace(run(minutes_out_of_water=10.0), time=1e6 + np.array([0.0, 1.0, 2.0]))
    assert doubtful(STRIP, soon, state(soon), "run") == []


def test_a_wet_sensor_beside_a_run_reads_a_little_more_than_saturation() -> None:
    wet = replace(run(), temperature=np.full(3, 20.0), relative_humidity=np.full(3, 100.4))
    assert "water-moves" not in {one.code for one in doubtful(STRIP, wet, state(wet), "run")}


@pytest.mark.parametrize("known", [RunState(), RunState(5.0, 0.1, "measured", 20.0), RunState(5.0, 0.1, "measured")])
def test_a_state_of_which_little_is_known_is_not_doubted(known: RunState) -> None:
    assert doubtful(STRIP, run(), known, "run") == []


@pytest.mark.parametrize("of_its_own", [True, False])
@pytest.mark.parametrize(("drier", "moves"), [(0.0, False), (40.0, True)])
def test_the_air_that_was_read_counts_and_not_the_one_that_was_stated(
    of_its_own: bool, drier: float, moves: bool
) -> None:
    """Whether the sensors have times of their own or are read with every row, which was overlooked."""
    time = 1000.0 + np.array([0.0, 600.0, 1200.0, 1800.0])
    read = {"temperature": [20.0, np.nan, 20.0, 20.0], "relative_humidity": 80.0 - drier * np.array([0, 1, 1, 1])}
    own = {"time_environment": time + 1e-3} if of_its_own else {}
    long = Run.from_arrays(time=time, voltage=[1.0] * 4, metadata=run().metadata, **read, **own)
    assert [one.code for one in doubtful(STRIP, long, state(long), "run")] == (["water-moves"] if moves else [])


def test_equilibrium_takes_films_and_thickness_and_is_slower_upwards() -> None:
    slow = STRIP.replace(**{"hydration.asymmetry": 10.0})
    thick = STRIP.replace(**{"hydration.diffusivity": 1e-12})
    waited = run(minutes_in_environment=120.0)
    assert doubtful(STRIP, waited, state(waited), "run") == []
    for strip in (slow, thick):
        (said,) = doubtful(strip, waited, state(waited, strip), "run")
        assert said.code == "not-in-equilibrium"


@pytest.mark.parametrize("asymmetry", [1.0, 10.0, 0.1])
def test_three_time_constants_are_equilibrium(asymmetry: float) -> None:
    """Of the slower way, upwards or downwards: nobody says from which side the strip came."""
    strip = STRIP.replace(**{"hydration.asymmetry": asymmetry})
    soon = run(minutes_in_environment=0.0)
    (said,) = doubtful(strip, soon, state(soon, strip), "run")
    slow = said.values["time_constant"]
    assert isinstance(slow, float)
    plain = doubtful(STRIP, soon, state(soon), "run")[0].values["time_constant"]
    assert slow == pytest.approx(max(1.0, asymmetry / STRIP["hydration.asymmetry"]) * plain)
    for part, settled in ((2.95, False), (3.05, True)):
        waited = run(minutes_in_environment=part * slow / 60.0)
        assert (doubtful(strip, waited, state(waited, strip), "run") == []) is settled


@pytest.mark.parametrize(("part", "moves"), [(0.985, True), (0.995, False), (1.005, False), (1.015, True)])
def test_water_moves_where_it_changes_by_more_than_a_hundredth(part: float, moves: bool) -> None:
    """However well it was known: the strip has the content that is stated, and ends where its air has it."""
    air = {"temperature": 20.0, "relative_humidity": 80.0}
    at_rest = state(run(**air)).water_content or 0.0
    long = Run.from_arrays(time=[0.0, 1e5, 2e5], voltage=[1.0] * 3, metadata=RunMetadata(**air))
    known = RunState(part * at_rest, 0.0, "measured", 20.0, 80.0)
    assert [one.code for one in doubtful(STRIP, long, known, "run")] == (["water-moves"] if moves else [])
