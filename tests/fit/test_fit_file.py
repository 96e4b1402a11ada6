"""A fit on disk: an actuator that simulate accepts, and everything a report needs."""

from __future__ import annotations

import gc
import math
import pickle
import re
import tomllib
import weakref
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import Fit, InputError, Run, identify, load_actuator, read_fit, simulate, write_fit
from ipmclab.fit.fit import FittedParameter
from ipmclab.fit.fit_file import fit_of
from ipmclab.fit.fit_table import changed
from ipmclab.model.actuator_file import actuator_from_text, actuator_to_text

FRIEND = load_actuator("friend-2")


@pytest.fixture(scope="module")
def fit() -> Fit:
    generator = np.random.default_rng(20261121)
    clean = simulate(FRIEND, "step 1 V", duration=40.0, rate=50.0)
    assert clean.current is not None
    noisy = clean.current + 1e-4 * generator.standard_normal(2000)
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=noisy)
    return identify(FRIEND, [run], free=["electrical", "circuit.sheet_resistance"], labels=["a step"])


def test_everything_but_the_residuals_comes_back(fit: Fit, tmp_path: Path) -> None:
    path = tmp_path / "fitted.toml"
    write_fit(fit, path)
    again = read_fit(path)
    assert again.parameters == fit.parameters
    assert again.undetermined == fit.undetermined
    assert again.observations == fit.observations
    assert again.findings == fit.findings
    for what in ("rank", "singular_values", "converged", "message", "evaluations", "software_version", "runs", "noise"):
        assert getattr(again, what) == getattr(fit, what)
    assert set(again.correlations) == set(fit.correlations)
    for name, row in fit.correlations.items():
        np.testing.assert_array_equal([*again.correlations[name].values()], [*row.values()])
    assert again.actuator.parameter_values == fit.actuator.parameter_values
    assert again.residuals == ()
    assert again.runs[0][0] == "a step"


def test_an_actuator_tells_of_its_fit_and_keeps_none_of_its_records() -> None:
    clean = simulate(FRIEND, "step 1 V", duration=10.0, rate=20.0)
    fit = identify(FRIEND, [clean], free="circuit.dc_resistivity")
    strip, findings, estimate = fit.actuator, [one.code for one in fit.findings], weakref.ref(fit.estimate)
    del fit
    gc.collect()
    assert estimate() is None
    assert strip.fit_table is not None
    assert [one["code"] for one in strip.fit_table["findings"]] == findings
    copied = deepcopy(strip.fit_table)
    assert isinstance(copied, dict)
    assert copied == strip.fit_table == pickle.loads(pickle.dumps(strip)).fit_table


def test_the_file_is_an_actuator(fit: Fit, tmp_path: Path) -> None:
    path = tmp_path / "fitted.toml"
    write_fit(fit, path)
    predicted = simulate(load_actuator(path), "step 1 V", duration=1.0, rate=50.0)
    straight = simulate(fit.actuator, "step 1 V", duration=1.0, rate=50.0)
    np.testing.assert_array_equal(predicted.current, straight.current)
    with pytest.raises(InputError, match="exists"):
        write_fit(fit, path)
    write_fit(fit, path, overwrite=True)


def test_an_open_direction_is_never_a_number_with_a_small_error(fit: Fit, tmp_path: Path) -> None:
    path = tmp_path / "fitted.toml"
    write_fit(fit, path)
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    open_ones = [entry for entry in table["fit"]["parameters"] if not entry["determined"]]
    assert len(open_ones) == 6
    assert all(math.isinf(entry["standard_error"]) for entry in open_ones)
    # A later fit must not take them for known either.
    assert not load_actuator(path).standard_uncertainties


def test_errors_of_a_first_fit_reach_the_second(tmp_path: Path) -> None:
    generator = np.random.default_rng(20261121)
    runs = []
    for signal in ("step 1 V", "square 1 V 0.3 Hz"):
        clean = simulate(FRIEND, signal, duration=40.0, rate=50.0)
        assert clean.current is not None
        assert clean.force is not None
        runs.append(
            Run.from_arrays(
                time=clean.time,
                voltage=clean.voltage,
                current=clean.current + 1e-4 * generator.standard_normal(2000),
                force=clean.force + 1e-5 * generator.standard_normal(2000),
            )
        )
    first = identify(FRIEND, runs, free="electrical")
    known = first.actuator.standard_uncertainties["circuit.dc_resistivity"]
    assert known == first.parameters["circuit.dc_resistivity"].standard_error
    second = identify(first.actuator, runs, free="coupling.p1,coupling.p2")
    assert "fixed-uncertainty" in {finding.code for finding in second.findings}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"no \[fit\] table"),
        ("[fit]\nrank = 5\n", r"not one that identify writes"),
        (
            '[fit]\nparameters = [{ name = "circuit.dc_resistivity", interval = [1] }]\n',
            r"not one that identify writes",
        ),
    ],
)
def test_what_is_not_a_fit_is_refused(text: str, words: str, tmp_path: Path) -> None:
    from ipmclab import write_actuator

    path = tmp_path / "strip.toml"
    write_actuator(FRIEND, path)
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")
    with pytest.raises(InputError, match=words) as caught:
        read_fit(path)
    assert str(path) in str(caught.value)


FINITE = st.floats(1e-12, 1e12)
OR_OPEN = st.one_of(FINITE, st.just(math.inf))


@st.composite
def parameters_of(draw: st.DrawFn, parameter: FittedParameter) -> FittedParameter:
    """A parameter as a fit may leave it: known, open to one side or both, with or without what else may stand there."""
    value = draw(FINITE)
    error = draw(OR_OPEN)
    low, high = draw(st.sampled_from([0.0, value / 2.0, value])), draw(st.sampled_from([value, value * 2.0, math.inf]))
    following = draw(st.none() | st.tuples(FINITE, FINITE).map(lambda ends: (min(ends), max(ends))))
    return replace(
        parameter,
        value=value,
        standard_error=error,
        interval=(low, high),
        determined=draw(st.booleans()) and math.isfinite(error),
        at_bound=draw(st.booleans()),
        interval_next_mounting=following,
        prior=draw(st.none() | st.tuples(FINITE, FINITE)),
    )


@st.composite
def fits(draw: st.DrawFn, fit: Fit) -> Fit:
    """The fit with other numbers, each such as a fit may have."""
    parameters = {name: draw(parameters_of(one)) for name, one in fit.parameters.items()}
    correlations = {name: dict.fromkeys(parameters, 0.0) for name in parameters}
    for one, parameter in parameters.items():
        for other, second in parameters.items():
            is_open = math.isinf(parameter.standard_error) or math.isinf(second.standard_error)
            value = 1.0 if one == other else draw(st.just(math.nan) if is_open else st.floats(-1.0, 1.0))
            correlations[one][other] = correlations[other][one] = value
    return changed(
        fit,
        parameters=parameters,
        correlations=correlations,
        rank=draw(st.integers(0, len(parameters))),
        converged=draw(st.booleans()),
        evaluations=draw(st.integers(0, 10**6)),
        message=draw(st.text(st.characters(exclude_categories=("Cs", "Cc")))),
    )


def _through_text(fit: Fit) -> Fit:
    return fit_of(actuator_from_text(actuator_to_text(fit.actuator)), where="fitted.toml")


@given(st.data())
def test_whatever_a_fit_may_say_comes_back(fit: Fit, data: st.DataObject) -> None:
    other = data.draw(fits(fit))
    again = _through_text(other)
    assert again.parameters == other.parameters
    for what in ("rank", "converged", "evaluations", "message", "covariance", "undetermined", "findings"):
        assert getattr(again, what) == getattr(other, what)
    for name, row in other.correlations.items():
        np.testing.assert_array_equal([*again.correlations[name].values()], [*row.values()])


def _places(value: Any, way: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """The way to every value in a table."""
    below = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [way, *(place for key, one in below for place in _places(one, (*way, key)))]


ANYTHING = st.one_of(
    st.text(max_size=5),
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.lists(st.floats(), max_size=3),
    st.dictionaries(st.sampled_from(["name", "x"]), st.floats(), max_size=2),
    st.just(datetime(2026, 11, 21, tzinfo=UTC)),
)


@given(st.data(), ANYTHING, st.booleans())
def test_an_edited_table_is_read_or_refused_in_plain_words(
    fit: Fit, data: st.DataObject, value: Any, gone: bool
) -> None:
    table = deepcopy(fit.actuator.fit_table)
    assert table is not None
    *way, last = data.draw(st.sampled_from(_places(table)[1:]))
    at: Any = table
    for key in way:
        at = at[key]
    if gone:
        del at[last]
    else:
        at[last] = value
    refused = None
    try:
        again = fit_of(replace(fit.actuator, fit_table=table), where="fitted.toml")
    except InputError as error:
        refused = error
    if refused is not None:
        assert refused.code == "bad-fit"
        assert refused.where.startswith("fitted.toml")
        assert "Error" not in refused.message
        return
    str(again)
    for parameter in again.parameters.values():
        assert parameter.interval[0] <= parameter.interval[1]
        assert parameter.standard_error >= 0.0
    assert 0 <= again.rank <= len(again.parameters)


@pytest.mark.parametrize(
    ("edit", "key", "words"),
    [
        (lambda t: t["parameters"][1]["interval"].reverse(), "parameters[1].interval", "the lower end comes first"),
        (
            lambda t: t["parameters"][1].update(interval=[0.0, t["parameters"][1]["value"] / 2.0]),
            "parameters[1].interval",
            "does not hold the value of circuit.dc_resistivity",
        ),
        (
            lambda t: t["parameters"][1].update(interval_next_mounting=[2.0, 1.0]),
            "parameters[1].interval_next_mounting",
            "from 2 down to 1",
        ),
        (lambda t: t["parameters"][1].update(standard_error=-1.0), "parameters[1].standard_error", "it must be 0 or"),
        (lambda t: t["parameters"][1].update(standard_error=math.nan), "parameters[1].standard_error", "is nan"),
        (lambda t: t["parameters"][1].update(unit="kohm m"), "parameters[1].unit", "is in ohm m, not in kohm m"),
        (lambda t: t["parameters"][1].update(unit=""), "parameters[1].unit", "is in ohm m, not in none"),
        (lambda t: t["parameters"][1].update(determined="yes"), "parameters[1].determined", "neither true nor false"),
        (lambda t: t["parameters"][1].update(eror=1.0), "parameters[1].eror", "unknown key 'eror'"),
        (lambda t: t["parameters"][1].update(t["parameters"][0]), "parameters[1].name", "is there twice"),
        (lambda t: t["runs"][0].update(series_resistance="2 ohm"), "runs[0].series_resistance", "is not a number"),
        (lambda t: t["runs"][0].update(mounting=3), "runs[0].mounting", "3 is not a text"),
        (lambda t: t.update(rank=-3), "rank", "-3 is not a whole number from 0 to 6, the number of parameters"),
        (lambda t: t.update(rank=7), "rank", "7 is not"),
        (lambda t: t.update(rank=5.0), "rank", "5 is not a whole number"),
        (lambda t: t.update(rank=True), "rank", "true is not a whole number"),
        (lambda t: t.pop("rank"), "rank", "this key is missing"),
        (lambda t: t.update(converged="yes"), "converged", "'yes' is neither true nor false"),
        (lambda t: t["correlations"][0].__setitem__(0, 0.5), "correlations[0][0]", "with itself is 0.5, not 1"),
        (lambda t: t["correlations"].pop(), "correlations", "one row and one column for each of the 6 parameters"),
        (lambda t: t["covariance"]["rows"][0].__setitem__(1, 1.0), "covariance.rows[0][1]", "the other way"),
        (lambda t: t["covariance"]["rows"][1].__setitem__(1, -1.0), "covariance.rows[1][1]", "must be 0 or more"),
        (lambda t: t["runs"][0].update(noise=3.0), "runs[0].noise", "3 is not a table"),
        (lambda t: t["runs"][0]["noise"].update(nan=0.0), "runs[0].noise.nan", "unknown output 'nan'"),
    ],
)
def test_what_no_fit_can_say_is_refused_at_its_key(
    fit: Fit, edit: Callable[[dict[str, Any]], object], key: str, words: str
) -> None:
    table = deepcopy(fit.actuator.fit_table)
    assert table is not None
    edit(table)
    with pytest.raises(InputError) as caught:
        fit_of(replace(fit.actuator, fit_table=table), where="fitted.toml")
    assert (caught.value.code, caught.value.where) == ("bad-fit", f"fitted.toml: fit.{key}")
    assert words in caught.value.message
    assert "identify again" in caught.value.repair


def test_correlations_of_what_is_known_are_numbers_and_alike_both_ways() -> None:
    fit = identify(
        FRIEND,
        simulate(FRIEND, "step 1 V", duration=20.0, rate=50.0),
        free="circuit.branches.1.resistivity,circuit.branches.1.permittivity",
    )
    for value, other, words in (
        (0.5, -0.3, "is 0.5, the other way -0.3"),
        (2.0, 2.0, "is 2: it must lie from -1 to 1"),
        (math.nan, math.nan, "is nan, and both are determined"),
    ):
        table = deepcopy(fit.actuator.fit_table)
        assert table is not None
        table["correlations"][0][1], table["correlations"][1][0] = value, other
        with pytest.raises(InputError, match=re.escape(words)):
            fit_of(replace(fit.actuator, fit_table=table), where="fitted.toml")


def test_what_belongs_to_one_run_has_the_unit_of_its_sensor() -> None:
    clean = simulate(FRIEND, "step 1 V", duration=40.0, rate=50.0)
    assert clean.current is not None
    shifted = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + 1e-4)
    fit = identify(
        FRIEND, [shifted], free="circuit.dc_resistivity,observation.offset.current,observation.drift.current"
    )
    assert {"A", "A/s"} <= {one.unit for one in _through_text(fit).parameters.values()}
    table = deepcopy(fit.actuator.fit_table)
    assert table is not None
    place = [entry["unit"] for entry in table["parameters"]].index("A/s")
    table["parameters"][place]["unit"] = "A"
    with pytest.raises(InputError, match="is in A/s, not in A"):
        fit_of(replace(fit.actuator, fit_table=table), where="fitted.toml")


def test_a_fit_of_before_the_values_were_kept_is_read(fit: Fit) -> None:
    table = deepcopy(fit.actuator.fit_table)
    assert table is not None
    del table["values"]
    assert fit_of(replace(fit.actuator, fit_table=table), where="fitted.toml").parameters == fit.parameters
