"""Runs of different length, rate and outputs in one fit, each with its own noise; shared parameters and own ones."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from ipmclab import Fit, InputError, Run, RunMetadata, identify, simulate
from ipmclab.model import Actuator
from tests.identification.brief import brief
from tests.identification.many import CONTACT, FRIEND

SEED = 20261121
POLE = 0.9
SHARED = (
    "circuit.dc_resistivity",
    "circuit.branches.0.permittivity",
    "circuit.branches.1.resistivity",
    "circuit.branches.1.permittivity",
    "coupling.gain",
)
RUNS = (
    # signal, seconds, rows a second, contact [ohm], noise of each output [SI]
    ("step 1 V", 30.0, 25.0, 0.5, {"current": 1e-4}),
    ("sine 1 V 0.3 Hz", 12.0, 80.0, 1.5, {"current": 3e-4}),
    ("square 1 V 0.2 Hz", 20.0, 40.0, 1.0, {"current": 2e-4, "force": 5e-6}),
)
COLOURED = (1, "current")
"""The run and output whose noise is an AR(1)."""


def answers(strip: Actuator, place: int) -> Run:
    signal, duration, rate, _, _ = RUNS[place]
    return simulate(strip, signal, duration=duration, rate=rate)


def strip_of(place: int, moved: dict[str, float]) -> Actuator:
    contact = f"{CONTACT}[{place}]"
    values = {name: FRIEND[name] * np.exp(moved.get(name, 0.0)) for name in SHARED}
    return FRIEND.replace(**values, **{CONTACT: RUNS[place][3] + moved.get(contact, 0.0)})


def least_errors() -> dict[str, float]:
    """Cramer and Rao's bound: of logarithms, and of the contacts [ohm]; noise known, by central differences."""
    names = [*SHARED, *(f"{CONTACT}[{place}]" for place in range(len(RUNS)))]
    information = np.zeros((len(names), len(names)))
    step = 1e-5
    for place, (*_, noise) in enumerate(RUNS):
        sides = [[answers(strip_of(place, {name: sign * step}), place) for sign in (1.0, -1.0)] for name in names]
        for output, size in noise.items():
            jacobian = np.stack(
                [(up.channels[output] - down.channels[output]) / (2.0 * step * size) for up, down in sides], axis=1
            )
            white = jacobian
            if (place, output) == COLOURED:
                white = scipy.linalg.solve_toeplitz(POLE ** np.arange(len(jacobian)), jacobian)
            information += jacobian.T @ white
    errors = np.sqrt(np.linalg.inv(information).diagonal())
    return dict(zip(names, errors.tolist(), strict=True))


def drawn(generator: np.random.Generator) -> list[Run]:
    runs = []
    for place, (signal, *_, noise) in enumerate(RUNS):
        clean = answers(strip_of(place, {}), place)
        readings = {}
        for output, size in noise.items():
            white = generator.standard_normal(len(clean))
            if (place, output) == COLOURED:
                driven = np.sqrt(1.0 - POLE**2) * white
                driven[0] = white[0]
                white = scipy.signal.lfilter([1.0], [1.0, -POLE], driven)
            readings[output] = clean.channels[output] + size * white
        runs.append(
            Run.from_arrays(
                time=clean.time,
                voltage=clean.voltage,
                current=readings.get("current"),
                force=readings.get("force"),
                metadata=RunMetadata(signal=signal, starts_from_rest=True),
            )
        )
    return runs


@pytest.fixture(scope="module")
def fits() -> list[Fit]:
    """Each run with a contact of its own, drawn four times."""
    generator = np.random.default_rng(SEED)
    return [brief(FRIEND, drawn(generator), SHARED, per_run=CONTACT) for _ in range(4)]


def test_each_run_counts_with_its_own_noise_and_has_its_own_contact(fits: list[Fit]) -> None:
    """Errors at the bound of the true noises, and estimates that scatter by as much."""
    bound = least_errors()
    away, told = [], []
    for fit in fits:
        found = fit.parameters
        assert set(found) == set(bound)
        truth = {name: FRIEND[name] for name in SHARED} | {f"{CONTACT}[{k}]": RUNS[k][3] for k in range(len(RUNS))}
        scale = {name: bound[name] * (FRIEND[name] if name in SHARED else 1.0) for name in bound}
        away.append([(found[name].value - truth[name]) / scale[name] for name in bound])
        told.append([found[name].standard_error / scale[name] for name in bound])
        coloured = fit.observations[COLOURED[0]]
        assert coloured.noise_model["current"].coefficients[0] == pytest.approx(POLE, abs=0.08)
        assert coloured.noise["current"] == pytest.approx(3e-4, rel=0.35)
        assert fit.observations[0].noise["current"] == pytest.approx(1e-4, rel=0.1)
        assert fit.observations[2].noise["force"] == pytest.approx(5e-6, rel=0.1)
    # An offset and a trend that a noise may have cost a little.
    assert np.median(told) == pytest.approx(1.0, abs=0.25)
    # Four trials of eight parameters.
    assert np.sqrt(np.mean(np.square(away))) == pytest.approx(1.1, abs=0.4)


def test_one_value_for_all_is_not_what_each_run_has(fits: list[Fit]) -> None:
    """The same runs with one contact for all of them: what differs is found in what is left."""
    fit = identify(FRIEND, drawn(np.random.default_rng(SEED)), free=[*SHARED, CONTACT])
    # The step, whose peak shows the contact.
    assert fit.observations[0].noise["current"] > 1.5 * fits[0].observations[0].noise["current"]


@pytest.mark.parametrize(
    ("labels", "where", "words"),
    [
        (["a"], "labels", r"1 label\(s\) for 2 run\(s\).*give 2, one for each run"),
        (["a", "b", "c"], "labels", r"3 label\(s\) for 2 run\(s\)"),
        ("ab", "labels", r"1 label\(s\) for 2 run\(s\)"),
        (["a", 2], r"labels[1]", "this is an int, not a text; give a text in quotes"),
    ],
)
def test_labels_that_are_not_one_for_each_run_are_refused(labels: list[str], where: str, words: str) -> None:
    runs = [simulate(FRIEND, signal, duration=2.0, rate=20.0) for signal in ("step 1 V", "sine 1 V 1 Hz")]
    with pytest.raises(InputError, match=words) as caught:
        identify(FRIEND, runs, free="circuit.dc_resistivity", labels=labels)
    assert (caught.value.code, caught.value.where) == ("not-a-text" if "[" in where else "bad-labels", where)
