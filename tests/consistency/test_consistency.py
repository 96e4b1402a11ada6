"""Facts about one strip held against each other: silent where they agree, and each conflict with both its numbers."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import Run, identify, load_actuator, simulate
from ipmclab.consistency import CHECKS, Fact, cross_check, facts_of_runs, published_facts
from ipmclab.consistency.flick import flicks, ring_of
from ipmclab.consistency.known import KnownStrip
from ipmclab.consistency.polymers import MEMBRANES, PLATINUM
from ipmclab.consistency.push import pushes
from ipmclab.consistency.stiffness import ring_of_step, stiffness
from ipmclab.data import published_sample
from ipmclab.fit.in_brief import in_brief
from ipmclab.model import Actuator, write_actuator
from ipmclab.run import Finding, RunMetadata
from ipmclab.sample import Sample

SEED = 20261121
MASS = "density-against-mass"
SIGNALS = {"step": "step 1 V", "sine": "sine 1 V 0.1 Hz", "square": "square 1 V 0.1 Hz"}


@dataclass(frozen=True)
class Strip:
    """An actuator whose sample data follow from it, and the runs that were recorded of it."""

    actuator: Actuator
    runs: dict[str, Run]

    def findings(self, **changed) -> tuple[Finding, ...]:
        call = {"runs": list(self.runs.values())} | changed
        return cross_check(call.pop("actuator", self.actuator), **call)


def virtual_actuator(draw) -> Actuator:
    """A strip whose masses, density and thickness are those of its layers; ``draw(low, high)`` gives a number."""
    membrane = MEMBRANES[("115", "117", "1110")[int(draw(0.0, 2.999))]]
    loading = draw(0.02, 0.12)
    free, clamped, width = draw(0.018, 0.040), draw(0.003, 0.008), draw(0.004, 0.010)
    area = (free + clamped) * width
    thickness = membrane.thickness * (1.0 + draw(0.0, 0.14)) + 2.0 * draw(1.0, 2.0) * loading / PLATINUM
    dry = (membrane.basis_weight + 2.0 * loading) * area
    wet = dry + draw(0.20, 0.37) * membrane.basis_weight * area
    capacitance, share = draw(20.0, 900.0), draw(0.2, 0.8)
    permittivity = (share * capacitance * thickness, (1.0 - share) * capacitance * thickness)
    sensing = draw(0.6, 0.95) * free
    p1, p2 = draw(1.0, 5.0), draw(6.0, 20.0)
    zero = draw(50.0, 300.0)
    coupling = draw(2e-4, 2e-3) * thickness**2 / (3.0 * sensing**2)  # so that a volt bends by 0.2 to 2 mm
    values = {
        "geometry.free_length": free,
        "geometry.clamped_length": clamped,
        "geometry.width": width,
        "geometry.thickness": thickness,
        "geometry.sensing_length": sensing,
        "circuit.sheet_resistance": draw(0.5, 3.0),
        "circuit.contact_resistance": draw(0.0, 2.0),
        "circuit.dc_resistivity": draw(20.0, 200.0) * area / thickness,
        "circuit.branches.0.resistivity": draw(0.02, 0.2) / permittivity[0],
        "circuit.branches.0.permittivity": permittivity[0],
        "circuit.branches.1.resistivity": draw(1.0, 20.0) / permittivity[1],
        "circuit.branches.1.permittivity": permittivity[1],
        "coupling.gain": coupling * p1 * p2 / zero,
        "coupling.zero": zero,
        "coupling.p1": p1 + p2,
        "coupling.p2": p1 * p2,
        "beam.density": wet / (area * thickness),
        "beam.modulus": math.exp(draw(math.log(5e7), math.log(1.5e9))),
        "beam.damping_ratio": draw(0.02, 0.1),
    }
    sample = Sample(
        id="virtual", membrane=f"Nafion {membrane.name}", plating_loading=loading, dry_mass=dry, hydrated_mass=wet
    )
    return Actuator(name="virtual", parameter_values=values, sample=sample)


def recorded(run: Run, measured: str, rng: np.random.Generator) -> Run:
    """A run as a rig gives it: the current and one channel beside it, with noise of 0.2 % of their ranges."""
    channels = {}
    for name in ("current", measured):
        values = run.channels[name]
        channels[name] = values + 2e-3 * float(np.ptp(values)) * rng.standard_normal(len(values))
    metadata = RunMetadata(sample=Sample(id="virtual"), signal=run.metadata.signal)
    return Run.from_arrays(time=run.time, voltage=run.voltage, hold=run.hold, metadata=metadata, **channels)


def flicked(actuator: Actuator, rng: np.random.Generator) -> Run:
    """Bent by 0.5 mm and let go at 0 V; the laser reads at 1 kS/s with 1.25 um of noise."""
    run = simulate(actuator, "step 0 V", duration=2.0, rate=1000.0, initial_state={"beam.displacement": 5e-4})
    noisy = run.displacement + 1.25e-6 * rng.standard_normal(len(run))
    return Run.from_arrays(time=run.time, voltage=run.voltage, displacement=noisy)


def pushed(actuator: Actuator, rng: np.random.Generator, *, times: float = 1.0, noise: float = 0.02) -> Run:
    """Pushed by twice its thickness in 10 s, and back, at 0 V; the noise of the force is a part of its rise."""
    time = np.arange(1100) / 50.0
    travel = 2.0 * actuator["geometry.thickness"] * np.interp(time, [1.0, 11.0, 21.0], [0.0, 1.0, 0.0])
    force = times * stiffness(actuator.parameter_values) * travel
    return Run.from_arrays(
        time=time,
        voltage=np.zeros_like(time),
        displacement=travel + 1.25e-6 * rng.standard_normal(1100),
        force=force + noise * float(np.max(force)) * rng.standard_normal(1100),
        metadata=RunMetadata(sample=Sample(id="virtual")),
    )


def strip_of(draw) -> Strip:
    actuator = virtual_actuator(draw)
    rng = np.random.default_rng(SEED)
    runs = {
        f"{name} {measured}": recorded(simulate(actuator, signal, duration=20.0, rate=50.0), measured, rng)
        for measured in ("displacement", "force")
        for name, signal in SIGNALS.items()
    }
    return Strip(actuator, runs | {"flick": flicked(actuator, rng), "push": pushed(actuator, rng)})


@pytest.fixture(scope="module")
def strip() -> Strip:
    """The strip in the middle of all ranges."""
    return strip_of(lambda low, high: 0.5 * (low + high))


def the(findings: tuple[Finding, ...], code: str) -> Finding:
    (found,) = (finding for finding in findings if finding.code == code)
    return found


@given(st.data())
def test_every_check_is_silent_on_a_consistent_strip(data) -> None:
    one = strip_of(lambda low, high: data.draw(st.floats(low, high)))
    assert len(pushes([one.runs["push"]])) == 1
    assert one.findings() == ()


def test_masses_and_layers_of_random_strips_agree_within_what_is_taken_as_uncertain() -> None:
    """True values read with the uncertainties that are assumed: a finding by chance only, 0.3 % for each check."""
    rng = np.random.default_rng(SEED)
    alarms = 0
    for _ in range(200):
        true = virtual_actuator(lambda low, high: float(rng.uniform(low, high)))
        known = KnownStrip(true)
        names = ("geometry.thickness", "geometry.width", "geometry.free_length", "beam.density")
        read = {name: value + known.uncertainty(name) * rng.standard_normal() for name, value in known.values.items()}
        sample = replace(
            true.sample,
            dry_mass=true.sample.dry_mass + 1e-6 * rng.standard_normal(),
            hydrated_mass=true.sample.hydrated_mass + 1e-6 * rng.standard_normal(),
            plating_loading=true.sample.plating_loading * (1.0 + 0.1 * rng.standard_normal()),
        )
        alarms += len(cross_check(true.replace(**{name: read[name] for name in names}), sample=sample))
    assert alarms <= 8  # of 1000 looks; 3 expected


def changed(strip: Strip, name: str, **channels: float) -> list[Run]:
    """The runs with some channels of those whose name begins so times a factor."""
    runs = []
    for key, run in strip.runs.items():
        if key.startswith(name):
            run = replace(run, **{channel: factor * getattr(run, channel) for channel, factor in channels.items()})
        runs.append(run)
    return runs


def test_the_strip_of_the_middle_is_consistent(strip: Strip) -> None:
    assert strip.findings() == ()
    assert {fact.metric for fact in facts_of_runs(list(strip.runs.values()))} == {
        "peak_current",
        "max_displacement",
        "max_force",
        "half_period_end_current",
    }
    assert len(flicks(list(strip.runs.values()))) == 1


@pytest.mark.parametrize(
    ("code", "parameter", "factor"),
    [
        ("density-against-mass", "beam.density", 1.3),
        ("thickness-against-membrane", "geometry.thickness", 1.3),
        ("thickness-against-membrane", "geometry.thickness", 0.7),
        ("capacitance-out-of-range", "circuit.branches.0.permittivity", 20.0),
        ("capacitance-out-of-range", "circuit.branches.0.permittivity", None),
        ("motion-against-stiffness", "beam.modulus", 3.0),
        ("resonance-against-stiffness", "beam.modulus", 2.0),
        ("peak-above-series-resistance", "circuit.sheet_resistance", 3.0),
        ("sine-against-step", "coupling.p1", 30.0),
    ],
)
def test_one_wrong_parameter_is_found_by_its_check(strip: Strip, code: str, parameter: str, factor) -> None:
    if factor is None:  # far too little in both branches
        wrong = {
            name: 1e-3 * strip.actuator[name] for name in strip.actuator.parameter_values if "permittivity" in name
        }
    else:
        wrong = {parameter: factor * strip.actuator[parameter]}
    found = [one for one in strip.findings(actuator=strip.actuator.replace(**wrong)) if one.code == code]
    assert found
    for one in found:  # the modes count for displacement and for force
        assert one.values["sigmas"] > 3.0
        assert one.repair.startswith("cheapest experiment that decides: ")


def test_values_of_a_wrong_mass_are_those_that_were_put_in(strip: Strip) -> None:
    sample = strip.actuator.sample
    heavy = the(strip.findings(sample=replace(sample, dry_mass=1.4 * sample.dry_mass)), "dry-mass-against-layers")
    assert heavy.values["found"] == pytest.approx(1.4 * heavy.values["expected"])
    dry = the(strip.findings(sample=replace(sample, hydrated_mass=1.02 * sample.dry_mass)), "water-uptake")
    membrane = MEMBRANES["117"]
    polymer = membrane.basis_weight / (membrane.basis_weight + 2.0 * sample.plating_loading)
    assert dry.values["found"] == pytest.approx(0.02 / polymer)
    assert dry.values["molecules_per_acid_group"] == pytest.approx(0.02 / polymer * 1100.0 / 18.015)
    wet = replace(sample, hydrated_mass=2.0 * sample.dry_mass)
    assert "38 %" in the(strip.findings(sample=wet), "water-uptake").message
    assert not [
        one for one in strip.findings(sample=replace(wet, solvent="ionic liquid")) if one.code == "water-uptake"
    ]


def test_wrong_runs_are_found_with_the_two_numbers(strip: Strip) -> None:
    weak = the(strip.findings(runs=changed(strip, "step force", force=0.3)), "motion-against-stiffness")
    assert weak.values["found"] == pytest.approx(0.3 * weak.values["expected"], rel=0.03)
    assert weak.values["implied_modulus"] == pytest.approx(0.3 * strip.actuator["beam.modulus"], rel=0.03)
    slow = the(strip.findings(runs=changed(strip, "sine displacement", displacement=0.5)), "sine-against-step")
    assert slow.channel == "displacement"
    assert slow.values["found"] == pytest.approx(0.5 * slow.values["expected"], rel=0.03)
    strong = the(strip.findings(runs=changed(strip, "step displacement", current=4.0)), "peak-above-series-resistance")
    series = strip.actuator.circuit_elements().series
    assert strong.values["expected"] == pytest.approx(1.0 / series)
    first = strip.runs["step displacement"].current[0]
    assert strong.values["found"] == pytest.approx(4.0 * first, rel=0.05)


def test_equal_voltages_with_unequal_currents_are_two_states(strip: Strip) -> None:
    runs = changed(strip, "step force", current=0.5)
    found = strip.findings(runs=runs)
    assert {one.code for one in found if one.channel == "current"} == {"prefix-disagrees"}  # reading by reading
    assert the(found[:1], "prefix-disagrees").values["ratio"] == pytest.approx(0.5, rel=0.02)
    # At another rate the readings have no partners; their numbers have.
    faster = recorded(simulate(strip.actuator, "step 1 V", duration=20.0, rate=80.0), "force", np.random.default_rng(1))
    faster = replace(faster, current=0.5 * faster.current)
    both = the(strip.findings(runs=[strip.runs["step displacement"], faster]), "two-states")
    assert both.values["ratio"] == pytest.approx(2.0, rel=0.03)


def test_a_push_and_a_motion_that_disagree_are_told_whatever_the_modulus_is(strip: Strip) -> None:
    """The modulus lies between the two, so far from neither that it would be told."""
    runs = [
        *changed(strip, "step displacement", displacement=1.3),
        pushed(strip.actuator, np.random.default_rng(SEED), times=1.3),
    ]
    runs = [runs[place] for place in (0, 3, -1)]  # the steps and the push
    loose = replace(strip.actuator, standard_uncertainties={"geometry.sensing_length": 1e-4})
    found = {one.code: one for one in cross_check(loose, runs)}
    assert set(found) == {"push-against-motion"}
    values = found["push-against-motion"].values
    assert values["expected"] / values["found"] == pytest.approx(1.3 * 1.3, rel=0.03)
    assert values["resonance"] / values["implied_resonance"] == pytest.approx(1.3, rel=0.03)
    for modulus in (0.1, 10.0):
        other = loose.replace(**{"beam.modulus": modulus * loose["beam.modulus"]})
        same = the(cross_check(other, runs), "push-against-motion")
        assert same.values["found"] == pytest.approx(values["found"], rel=1e-3)
        assert same.values["sigmas"] == pytest.approx(values["sigmas"], rel=1e-2)


def test_a_ring_and_a_motion_that_disagree_are_told_whatever_the_modulus_is(strip: Strip) -> None:
    runs = changed(strip, "step displacement", displacement=3.0)
    found = the(strip.findings(runs=runs), "resonance-against-motion")
    assert found.values["found"] / found.values["expected"] == pytest.approx(math.sqrt(3.0), rel=0.03)
    assert found.values["implied_stiffness"] == pytest.approx(stiffness(strip.actuator.parameter_values), rel=0.03)
    other = strip.actuator.replace(**{"beam.modulus": 5.0 * strip.actuator["beam.modulus"]})
    same = the(strip.findings(actuator=other, runs=runs), "resonance-against-motion")
    assert same.values["expected"] == pytest.approx(found.values["expected"], rel=1e-3)


@pytest.mark.parametrize("slow", [1.5, 0.4, -0.4])
def test_slow_modes_are_taken_off_a_motion_before_it_is_held_against_a_push(slow: float) -> None:
    """A displacement that relaxes makes force over displacement no stiffness: the push agrees all the same."""
    strip = load_actuator("friend-2+relaxation.displacement").replace(
        **{"relaxation.displacement.0.ratio": slow, "relaxation.displacement.0.time_constant": 2.0}
    )
    rng = np.random.default_rng(SEED)
    runs = [pushed(strip, rng)]
    for measured in ("displacement", "force"):
        run = simulate(strip, "step 1 V", duration=20.0, rate=50.0)
        channels = {name: run.channels[name] for name in ("current", measured)}
        runs.append(Run.from_arrays(time=run.time, voltage=run.voltage, **channels))
    ratio = float(np.max(runs[2].force) / np.max(runs[1].displacement))
    assert abs(ratio / stiffness(strip.parameter_values) - 1.0) > 0.25
    assert {one.code for one in cross_check(strip, runs)} == {"capacitance-out-of-range"}


def test_conditions_are_not_mixed_in_the_new_pairs() -> None:
    push = Fact("friend-2", "push", "stiffness", 2.9, 0.1, conditions="20 degC, 80 %RH")
    codes = {one.code for one in cross_check(load_actuator("friend-2"), facts=[*published_facts(2), push])}
    assert "push-against-motion" not in codes


def test_a_push_of_another_stiffness_is_found(strip: Strip) -> None:
    expected = stiffness(strip.actuator.parameter_values)
    push = Fact("virtual", "push", "stiffness", 2.0 * expected, 0.05 * expected, where="push 3")
    found = the(strip.findings(facts=[push]), "push-against-stiffness")
    assert found.message.startswith("push 3: ")
    assert found.values["implied_modulus"] == pytest.approx(2.0 * strip.actuator["beam.modulus"])


@pytest.mark.parametrize(("travel", "is_push"), [(40e-6, False), (75e-6, True)])
def test_a_push_goes_over_fifty_micrometres_or_more(strip: Strip, travel: float, is_push: bool) -> None:
    """Less is what a strip moves by itself."""
    run = strip.runs["push"]
    part = travel / float(np.ptp(run.displacement))
    found = pushes([replace(run, displacement=part * run.displacement, force=part * run.force)])
    assert [fact.value for fact in found] == [
        pytest.approx(stiffness(strip.actuator.parameter_values), rel=0.05)
    ] * is_push


def test_a_run_of_another_sample_is_left_out(strip: Strip) -> None:
    runs = changed(strip, "step force", force=0.3, current=0.5)
    other = RunMetadata(sample=Sample(id="another"))
    assert strip.findings(runs=[replace(run, metadata=other) for run in runs]) == ()
    # The others keep the places that they have in the call.
    first = replace(strip.runs["step displacement"], metadata=other)
    found = the(strip.findings(runs=[first, *runs])[:1], "motion-against-stiffness")
    assert "in run 4 (step 1 V)" in found.message
    assert "in run 1 (step 1 V)" in found.message


def test_a_channel_that_holds_only_noise_has_no_number(strip: Strip) -> None:
    step = strip.runs["step displacement"]
    silent = replace(step, force=1e-4 * np.random.default_rng(SEED).standard_normal(len(step)))
    assert {fact.metric for fact in facts_of_runs([silent])} == {"peak_current", "max_displacement"}


def test_force_and_motion_of_one_run_belong_together() -> None:
    strip = load_actuator("friend-2")
    run = simulate(strip, "step 1 V", duration=20.0, rate=50.0)
    stiff = replace(run, force=2.0 * run.force, displacement=2.0 * run.displacement)
    assert "motion-against-stiffness" not in {one.code for one in cross_check(strip, [run, stiff])}


@pytest.mark.parametrize("damping_ratio", [0.01, 0.1])
@pytest.mark.parametrize("frequency", [4.0, 13.4, 38.3, 110.0])
def test_the_ring_of_a_flick_is_read_within_its_error(frequency: float, damping_ratio: float) -> None:
    rng = np.random.default_rng(SEED)
    time = np.arange(2000) / 1000.0
    angular = 2.0 * np.pi * frequency
    fading = np.exp(-damping_ratio * angular * time) * np.cos(angular * math.sqrt(1.0 - damping_ratio**2) * time)
    found = [ring_of(5e-4 * fading + 1.25e-6 * rng.standard_normal(2000), 1000.0) for _ in range(20)]
    errors = np.array([(one[0] - frequency) / one[1] for one in found if one])
    assert len(errors) == 20
    assert float(np.sqrt(np.mean(errors**2))) < 2.0
    assert max(abs(one[0] / frequency - 1.0) for one in found if one) < 0.01


def test_what_does_not_ring_or_rings_too_fast_gives_no_frequency() -> None:
    rng = np.random.default_rng(SEED)
    time = np.arange(2000) / 1000.0
    noise = 1.25e-6 * rng.standard_normal(2000)
    assert ring_of(noise, 1000.0) is None
    assert ring_of(5e-4 * np.exp(-3.0 * time) + noise, 1000.0) is None
    assert ring_of(5e-4 * np.exp(-5.0 * time) * np.cos(2 * np.pi * 300.0 * time) + noise, 1000.0) is None
    driven = Run.from_arrays(time=time, voltage=np.ones(2000), displacement=5e-4 * np.cos(2 * np.pi * 20.0 * time))
    assert flicks([driven]) == ()


def test_the_ring_of_a_step_is_what_a_fast_simulation_shows() -> None:
    """Amplitude from the residue at the beam's pole, against an oscillation fitted to the tail of a 20 kHz record."""
    actuator = load_actuator("friend-2").replace(**{"beam.modulus": 1.77e8, "beam.damping_ratio": 0.005})
    run = simulate(actuator, "step 1 V", duration=1.0, rate=20_000.0)
    angular = 2.0 * np.pi * 13.378
    part = run.time > 0.2
    time, motion = run.time[part], run.displacement[part]
    fading = np.exp(-0.005 * angular * time)
    smooth = np.vander(time, 9)
    columns = np.column_stack((fading * np.cos(angular * time), fading * np.sin(angular * time), smooth))
    fitted = np.linalg.lstsq(columns, motion, rcond=None)[0]
    assert ring_of_step(actuator) == pytest.approx(math.hypot(fitted[0], fitted[1]), rel=0.02)


# --- published numbers -----------------------------------------------------------------------------------------------

PUBLISHED = {
    # Found and expected, in SI units, as a careful reader of the thesis finds them.
    "density-against-mass": (0.190e-3, 0.245e-3),
    "thickness-against-membrane": (0.245e-3, 0.183e-3),
    "dry-mass-against-layers": (103e-6, 84e-6),
    "capacitance-out-of-range": (2453.0, 1000.0),
    "motion-against-stiffness": (0.351, 2.878),
    "peak-above-series-resistance": (0.2048, 0.0625),
    "two-states": (0.2048, 0.06701),
    "prefix-disagrees": (0.180, 0.2048),
    "sine-against-step": (0.386, 0.83),
}


@pytest.fixture(scope="module")
def published() -> dict[str, Finding]:
    found = cross_check(load_actuator("friend-2"), sample=published_sample(2), facts=published_facts(2))
    assert len({finding.code for finding in found}) == len(found)
    return {finding.code: finding for finding in found}


def test_the_published_sample_2_has_these_conflicts_and_no_other(published) -> None:
    assert set(published) == set(PUBLISHED)
    for code, (found, expected) in PUBLISHED.items():
        assert published[code].values["found"] == pytest.approx(found, rel=5e-3), code
        assert published[code].values["expected"] == pytest.approx(expected, rel=5e-3), code
        assert published[code].severity == "warning"


@pytest.mark.parametrize(
    ("code", "numbers"),
    [
        ("peak-above-series-resistance", ["205 ± 4.1 mA", "62.5 ± 3.7 mA"]),
        ("prefix-disagrees", ["205 ± 4.1 mA", "180 ± 3.6 mA"]),
        ("two-states", ["205 ± 4.1 mA", "67 ± 1.3 mA"]),
    ],
)
def test_also_in_brief_a_conflict_holds_both_its_numbers(published, code: str, numbers: list[str]) -> None:
    (line,), _ = in_brief([published[code]])
    assert [number for number in numbers if number not in line.text] == []


def test_the_messages_on_sample_2_hold_both_numbers_with_their_units(published) -> None:
    said = {
        "density-against-mass": ["0.19 ± 0.0072 mm", "0.245 ± 0.005 mm", "3965 kg/m^3", "3075 kg/m^3"],
        "thickness-against-membrane": ["0.245 ± 0.005 mm", "0.183 mm"],
        "dry-mass-against-layers": ["103 ± 1 mg", "84 ± 4.8 mg"],
        "capacitance-out-of-range": ["2450 ± 110 F/m^2", "120 to 180 F/m^2"],
        "motion-against-stiffness": ["0.351 ± 0.013 N/m", "2.88 ± 0.4 N/m", "177 MPa", "388 MPa", "336 MPa"],
        "peak-above-series-resistance": ["205 ± 4.1 mA", "62.5 ± 3.7 mA", "16 ohm"],
        "two-states": ["205 ± 4.1 mA", "67 ± 1.3 mA", "3.1 times"],
        "sine-against-step": ["0.386 ± 0.011", "0.83 ± 0.041", "3.8 s"],
    }
    for code, texts in said.items():
        for text in texts:
            assert text in published[code].message, (code, text)
    assert "38.3 Hz" in published["motion-against-stiffness"].repair
    assert "13.4 Hz" in published["motion-against-stiffness"].repair


def test_a_step_rings_below_what_the_laser_resolves(published) -> None:
    assert "it rings by 0.028 to 1.2 um, where a laser resolves 1.25 um" in published["motion-against-stiffness"].repair


@pytest.mark.parametrize(("number", "dry", "layers"), [(1, 90e-6, 60e-6), (4, 86e-6, 69e-6)])
def test_dry_masses_of_other_published_samples(number: int, dry: float, layers: float) -> None:
    found = the(cross_check(load_actuator("friend-2"), sample=published_sample(number)), "dry-mass-against-layers")
    assert (found.values["found"], found.values["expected"]) == pytest.approx((dry, layers))


def test_sample_5_took_up_too_little_water() -> None:
    found = the(cross_check(load_actuator("friend-2"), sample=published_sample(5)), "water-uptake")
    assert found.values["found"] == pytest.approx(8.0 / 75.0)


def test_humidities_are_not_mixed() -> None:
    room, humid = published_facts(2), published_facts(2, conditions="20 degC, 80 %RH")
    found = the(cross_check(load_actuator("friend-2"), facts=(*room, *humid)), "motion-against-stiffness")
    assert found.values["found"] == pytest.approx(1.3 / 3.7, rel=1e-3)
    alone = the(cross_check(load_actuator("friend-2"), facts=humid), "motion-against-stiffness")
    assert alone.values["implied_modulus"] == pytest.approx(329e6, rel=5e-3)


# --- how sure --------------------------------------------------------------------------------------------------------


def test_uncertainties_spread_as_a_product_of_powers_does() -> None:
    actuator = load_actuator("friend-2")
    stated = {
        "beam.modulus": 0.02,
        "geometry.thickness": 0.01,
        "geometry.width": 0.005,
        "geometry.sensing_length": 0.004,
    }
    known = KnownStrip(replace(actuator, standard_uncertainties={n: part * actuator[n] for n, part in stated.items()}))
    relative = math.sqrt(0.02**2 + (3 * 0.01) ** 2 + 0.005**2 + (3 * 0.004) ** 2)
    standard_uncertainty = known.standard_uncertainty(stiffness, stated) / stiffness(known.values)
    assert standard_uncertainty == pytest.approx(relative, rel=1e-3)


def test_a_stated_uncertainty_counts_and_is_not_called_taken() -> None:
    actuator = load_actuator("friend-2")
    sample = published_sample(2)
    loose = replace(actuator, standard_uncertainties={"geometry.thickness": 3e-5})
    codes = {finding.code for finding in cross_check(loose, sample=sample)}
    assert "density-against-mass" not in codes
    assert "thickness-against-membrane" not in codes
    tight = replace(actuator, standard_uncertainties={"geometry.thickness": 1e-6})
    found = the(cross_check(tight, sample=sample), "density-against-mass")
    assert "0.245 ± 0.001 mm" in found.message
    assert "thickness 0.005 mm" not in found.message


def test_the_uncertainty_of_a_fit_counts(strip: Strip) -> None:
    """A fit's errors stand for what it fitted; what the readings leave open contradicts nothing."""
    run = strip.runs["step displacement"]
    fit = identify(strip.actuator, [run], free=["electrical"])
    assert cross_check(fit.actuator, [run], fit=fit) == ()
    thick = fit.actuator.replace(
        **{"circuit.branches.0.permittivity": 20 * fit.actuator["circuit.branches.0.permittivity"]}
    )
    assert [one.code for one in cross_check(thick, fit=fit)] == ["capacitance-out-of-range"]
    open_errors = {name: replace(one, standard_error=math.inf) for name, one in fit.parameters.items()}
    assert cross_check(thick, fit=replace(fit, parameters=open_errors)) == ()


@pytest.mark.parametrize(
    ("free", "origin", "severity"),
    [
        ("electrical", "simulated", "info"),
        ("circuit.dc_resistivity", "measured", "info"),
        ("electrical", "measured", "warning"),
    ],
)
def test_a_capacitance_of_the_file_is_no_mistake_of_who_fits(free: str, origin: str, severity: str) -> None:
    actuator = load_actuator("friend-2")
    run = simulate(actuator, "step 1 V", duration=20.0, rate=20.0)
    run = replace(run, metadata=replace(run.metadata, origin=origin))
    found = the(identify(actuator, [run], free=free).findings, "capacitance-out-of-range")
    assert found.severity == severity
    assert found.message.startswith("friend-2 itself has this value") is (severity == "info")


def three_runs(signals: tuple[str, str, str], zeros: dict[str, float], rng: np.random.Generator) -> list[Run]:
    """Two steps and a sine with everything measured; the sensors of the first have zeros."""
    runs = []
    for place, signal in enumerate(signals):
        clean = simulate(load_actuator("friend-2"), signal, duration=40.0, rate=50.0)
        sizes = {"current": 1e-4, "displacement": 2e-6, "force": 1e-5}
        channels = {
            name: clean.channels[name] + size * rng.standard_normal(len(clean)) + (0.0 if place else zeros[name])
            for name, size in sizes.items()
        }
        about = RunMetadata(signal=signal)
        runs.append(
            Run.from_arrays(time=clean.time, voltage=clean.voltage, hold=clean.hold, metadata=about, **channels)
        )
    return runs


ZEROS = {"current": 1e-3, "displacement": 2e-3, "force": 1e-3}


def test_a_zero_that_no_record_shows_is_told_as_a_cause() -> None:
    """Runs that begin with the voltage on: what the zeros of laser, load cell and shunt do is not laid on the strip."""
    strip = load_actuator("friend-2")
    runs = three_runs(("step 1 V", "step 1 V", "sine 1 V 0.1 Hz"), ZEROS, np.random.default_rng(SEED))
    found = [one for one in cross_check(strip, runs) if one.code != "capacitance-out-of-range"]
    assert {one.code for one in found} == {"motion-against-stiffness", "prefix-disagrees", "sine-against-step"}
    for one in found:
        assert "run 0 (step 1 V)" in one.message
        assert "too short before the voltage to show the zero of" in one.message
        assert "5 s at 0 V before the first edge" in one.repair
    assert {one.channel for one in found if one.code == "prefix-disagrees"} == set(ZEROS)
    told = {
        (one.code, one.channel): float(re.search(r"one of ([\d.]+) m[mNA] explains", one.message)[1]) for one in found
    }
    for code in ("prefix-disagrees", "sine-against-step"):
        assert told[code, "displacement"] == pytest.approx(2.0, rel=0.1)
        assert told[code, "force"] == pytest.approx(1.0, rel=0.2)
    # With the zeros at rest the same sensors contradict nothing.
    signals = ("step 1 V delay=5 s", "step 1 V delay=5 s", "sine 1 V 0.1 Hz delay=5 s")
    shown = cross_check(strip, three_runs(signals, ZEROS, np.random.default_rng(SEED)))
    assert {one.code for one in shown} == {"capacitance-out-of-range"}


def test_a_push_names_the_zero_that_would_bring_force_over_displacement_to_it() -> None:
    strip = load_actuator("friend-2")
    rng = np.random.default_rng(SEED)
    (run, *_) = three_runs(("step 1 V", "step 1 V", "sine 1 V 0.1 Hz"), ZEROS, rng)
    found = the(cross_check(strip, [run, pushed(strip, rng)]), "push-against-motion")
    assert run.force is not None
    # The force that the push foretells of this displacement, less the force that was read.
    foretold = stiffness(strip.parameter_values) * float(np.max(run.displacement))
    zero = float(re.search(r"zero of its force: one of ([\d.]+) mN", found.message)[1])
    assert 1e-3 * zero == pytest.approx(foretold - float(np.max(run.force)), rel=0.05)
    assert "5 s at 0 V before the first edge" in found.repair


def test_no_zero_is_blamed_where_the_record_shows_it_or_it_explains_nothing(strip: Strip) -> None:
    signals = ("step 1 V delay=5 s", "step 1 V delay=5 s", "sine 1 V 0.1 Hz delay=5 s")
    runs = three_runs(signals, dict.fromkeys(ZEROS, 0.0), np.random.default_rng(SEED))
    runs[0] = replace(runs[0], force=2.0 * runs[0].force, displacement=0.5 * runs[0].displacement)
    found = [one for one in cross_check(load_actuator("friend-2"), runs) if one.code != "capacitance-out-of-range"]
    assert len(found) > 3
    assert not [one for one in found if "zero" in one.message or "zero" in one.repair]
    # Another gain is no zero: the difference is not the same all the time.
    gained = changed(strip, "step force", force=0.5)
    ones = [one for one in strip.findings(runs=gained) if one.code == "prefix-disagrees"]
    assert not [one for one in ones if "zero" in one.message]
    published = cross_check(load_actuator("friend-2"), facts=published_facts(2))
    assert published
    assert not [one for one in published if "show the zero" in one.message]


def test_richer_strips_are_read_as_they_are() -> None:
    """With slow modes and a line, force over displacement and the first current are no longer 2 R_e and a stiffness."""
    strip = load_actuator("friend-2+relaxation.displacement+clamp").replace(**{"clamp.direct_share": 1.0})
    runs = []
    for measured in ("displacement", "force"):
        run = simulate(strip, "step 1 V", duration=20.0, rate=50.0)
        channels = {name: run.channels[name] for name in ("current", measured)}
        runs.append(Run.from_arrays(time=run.time, voltage=run.voltage, **channels))
    assert {one.code for one in cross_check(strip, runs)} == {"capacitance-out-of-range"}


@pytest.mark.parametrize(
    "stages", ["viscoelastic", "relaxation.displacement+relaxation.force", "clamp", "leak.exponential"]
)
def test_richer_strips_agree_with_their_pushes_and_flicks(stages: str) -> None:
    strip = load_actuator(f"friend-2+{stages}").replace(**{"circuit.branches.1.permittivity": 0.1})
    rng = np.random.default_rng(SEED)
    runs = [
        recorded(simulate(strip, signal, duration=20.0, rate=50.0), measured, rng)
        for measured in ("displacement", "force")
        for signal in SIGNALS.values()
    ]
    runs += [flicked(strip, rng), pushed(strip, rng)]
    assert (len(flicks(runs)), len(pushes(runs))) == (1, 1)
    assert cross_check(strip, runs) == ()


def test_the_codes_are_listed() -> None:
    assert len(set(CHECKS)) == len(CHECKS) == 14


def test_a_file_with_sample_and_uncertainties_is_read_and_checked(tmp_path, strip: Strip) -> None:
    stated = replace(strip.actuator, standard_uncertainties={"geometry.thickness": 2e-6})
    write_actuator(stated, tmp_path / "strip.toml")
    assert cross_check(load_actuator(tmp_path / "strip.toml"), list(strip.runs.values())) == ()


def test_the_page_lists_every_check_once() -> None:
    page = (Path(__file__).parents[2] / "docs" / "consistency.md").read_text(encoding="utf-8")
    assert tuple(re.findall(r"^\| `([\w-]+)` \|", page, flags=re.MULTILINE)) == CHECKS


# --- the numbers of a careful reader of the thesis, one of each check -------------------------------------------------


def test_each_of_the_checks_finds_a_conflict_of_the_published_samples_with_its_two_numbers(published) -> None:
    """Sample 2's own; where it agrees, or nothing was measured, what its other numbers say would have been measured."""
    strip = load_actuator("friend-2")
    ratio = 1.3e-3 / 3.7e-3  # force over displacement, as measured [N/m]
    push = Fact("friend-2", "push", "stiffness", ratio, 0.03 * ratio, where="a push as the runs say")
    flick = Fact("friend-2", "flick", "resonance", 13.4, 0.13, where="a flick as the runs say")
    found = {one.code: one for one in cross_check(strip, facts=[push, flick])} | published
    # What was measured against what the modulus says would have been.
    stiff = replace(push, value=stiffness(strip.parameter_values), conditions="room")
    fast = replace(flick, value=38.29, conditions="room")
    measured = cross_check(strip, facts=[*published_facts(2), stiff, fast])
    found |= {one.code: one for one in measured if one.code.endswith("-against-motion")}
    found["water-uptake"] = the(cross_check(strip, sample=published_sample(5)), "water-uptake")
    numbers = PUBLISHED | {
        "push-against-stiffness": (0.351, 2.878),
        "resonance-against-stiffness": (13.4, 38.29),
        "push-against-motion": (0.351, 2.878),
        "resonance-against-motion": (38.29, 13.37),
        "water-uptake": (8.0 / 75.0, 12.0 * 18.015 / 1100.0),  # water molecules for each acid group
    }
    assert set(found) >= set(CHECKS) == set(numbers)
    for code, (one, other) in numbers.items():
        assert found[code].values["found"] == pytest.approx(one, rel=5e-3), code
        assert found[code].values["expected"] == pytest.approx(other, rel=6e-3), code
        assert found[code].repair.startswith("cheapest experiment that decides: "), code
        assert "differ by" in found[code].message, code
    assert found["resonance-against-stiffness"].values["implied_modulus"] == pytest.approx(177e6, rel=0.01)


def test_a_fit_is_held_against_what_else_is_known_of_its_strip(strip: Strip) -> None:
    runs = list(strip.runs.values())[:2]
    fit = identify(strip.actuator, runs, free="electrical")
    assert not {finding.code for finding in fit.findings} & set(CHECKS)
    assert strip.actuator.sample is not None
    heavy = replace(strip.actuator.sample, hydrated_mass=1.4 * strip.actuator.sample.hydrated_mass)
    wrong = identify(replace(strip.actuator, sample=heavy), runs, free="electrical")
    found = the(tuple(one for one in wrong.findings if one.code in CHECKS and one.code != "water-uptake"), MASS)
    assert found.values["found"] == pytest.approx(1.4 * found.values["expected"], rel=1e-6)


def test_runs_say_of_what_sample_they_are_where_the_actuator_does_not(strip: Strip) -> None:
    assert strip.actuator.sample is not None
    heavy = replace(strip.actuator.sample, hydrated_mass=1.4 * strip.actuator.sample.hydrated_mass)
    alone = replace(strip.actuator, sample=None)
    runs = [replace(run, metadata=RunMetadata(sample=heavy)) for run in list(strip.runs.values())[:2]]
    assert MASS in {one.code for one in cross_check(alone, runs)}
    # Two samples in one call are no sample.
    other = replace(runs[1], metadata=RunMetadata(sample=replace(heavy, id="another")))
    assert MASS not in {one.code for one in cross_check(alone, [runs[0], other])}


@pytest.mark.parametrize("kind", ["step", "sine", "square", "a sine that is cut"])
def test_a_rest_behind_the_signal_leaves_its_facts(kind: str) -> None:
    """Every run of the recorder ends with one."""
    shape = {"a sine that is cut": "sine 1 V 0.1 Hz"}.get(kind) or SIGNALS[kind]
    lasts = 33.0 if kind == "a sine that is cut" else 40.0
    plain = simulate(load_actuator("friend-2"), shape, duration=lasts, rate=50.0)
    rested = simulate(
        load_actuator("friend-2"), f"{shape} for {lasts} s then step 0 V", duration=lasts + 7.0, rate=50.0
    )
    for run in (rested, replace(rested, metadata=RunMetadata(sample=rested.metadata.sample))):
        told = {fact.metric: fact for fact in facts_of_runs([run])}
        alone = {fact.metric: fact for fact in facts_of_runs([plain])}
        assert told.keys() == alone.keys() != set()
        for metric, fact in told.items():
            assert fact.signal.split()[:3] == alone[metric].signal.split()[:3]
            assert fact.value == pytest.approx(alone[metric].value, rel=0.02)
            assert fact.time == pytest.approx(alone[metric].time, abs=0.1)


def test_two_steps_are_no_fact_of_one() -> None:
    run = simulate(load_actuator("friend-2"), "step 1 V for 10 s then step 0.5 V for 10 s", duration=25.0, rate=50.0)
    assert facts_of_runs([run]) == ()
