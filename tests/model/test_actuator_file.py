"""Actuators and their files: exact round trips, and a message for everything that cannot be right."""

from __future__ import annotations

import dataclasses
import math
import re
import sys
import tomllib
from importlib import resources
from pathlib import Path

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, IpmclabError, Sample, load_actuator, write_actuator
from ipmclab.model import OUTPUTS, Actuator, actuator_from_text, actuator_to_text, library_names
from ipmclab.model.structure import Structure
from tests.independent.thesis import FRIEND_2

FRIEND_2_TEXT = (resources.files("ipmclab.model") / "library" / "friend-2.toml").read_text(encoding="utf-8")


def test_friend_2_is_the_published_tables(friend_2: Actuator) -> None:
    assert "friend-2" in library_names()
    for name, value in FRIEND_2.dotted().items():
        assert friend_2[name] == pytest.approx(value, rel=1e-15), name
    assert list(friend_2.parameters()) == list(Structure(2).declarations)
    # Tables 4.1 and 4.2 and the appendix, digit by digit.
    assert friend_2["coupling.gain"] == 6.79e-9
    assert friend_2["geometry.thickness"] == 0.245e-3
    elements = friend_2.circuit_elements()
    assert elements.electrode == pytest.approx(8.0, rel=1e-15)
    assert elements.series == pytest.approx(16.0, rel=1e-15)
    assert elements.dc == pytest.approx(70.92, rel=1e-15)
    assert elements.branch_resistances == pytest.approx((0.58366, 39.594), rel=2e-5)
    assert elements.branch_capacitances == pytest.approx((73.457e-3, 294.53e-3), rel=2e-5)
    assert not friend_2.standard_uncertainties


def test_library_file_reads_back_from_its_own_writing(friend_2: Actuator) -> None:
    assert tomllib.loads(actuator_to_text(friend_2))["geometry"] == tomllib.loads(FRIEND_2_TEXT)["geometry"]
    assert actuator_from_text(actuator_to_text(friend_2)).parameter_values == friend_2.parameter_values


@st.composite
def actuators(draw: st.DrawFn) -> Actuator:
    values, uncertainties = {}, {}
    for name, declaration in Structure(draw(st.integers(1, 4))).declarations.items():
        if declaration.transform == "log":
            low, high = math.log(declaration.lower), math.log(declaration.upper)
            value = math.exp(draw(st.floats(low, high)))
        else:
            value = draw(st.floats(declaration.lower, declaration.upper))
        values[name] = min(max(value, declaration.lower), declaration.upper)
        if draw(st.booleans()):
            uncertainties[name] = draw(st.floats(1e-300, 1e300))
    values["geometry.sensing_length"] = min(values["geometry.sensing_length"], values["geometry.free_length"])
    text = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)
    sample = draw(st.none() | st.builds(Sample, id=text, membrane=text, dry_mass=st.floats(1e-9, 1e3)))
    leaf = st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | text
    nested = st.recursive(
        leaf, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(text, inner, max_size=3), max_leaves=8
    )
    fit = draw(st.none() | st.dictionaries(text, nested, max_size=4))
    return Actuator(draw(text), values, uncertainties, sample, fit)


@given(actuators())
def test_round_trip_is_exact(actuator: Actuator) -> None:
    again = actuator_from_text(actuator_to_text(actuator))
    assert dataclasses.asdict(again) == dataclasses.asdict(actuator)


@given(
    st.lists(
        st.tuples(st.integers(0, len(FRIEND_2_TEXT) - 1), st.characters(min_codepoint=9, max_codepoint=126)),
        min_size=1,
        max_size=3,
    )
)
def test_a_damaged_file_gives_a_message_or_an_actuator(edits: list[tuple[int, str]]) -> None:
    text = list(FRIEND_2_TEXT)
    for place, character in edits:
        text[place] = character
    try:
        actuator = actuator_from_text("".join(text), where="strip.toml")
    except InputError:
        return
    assert all(math.isfinite(value) for value in actuator.parameter_values.values())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'zero = "210.5 1/s"',
            'zeroo = "210.5 1/s"',
            "strip.toml: coupling.zeroo: unknown key 'coupling.zeroo'; did you mean 'coupling.zero'?",
        ),
        ("[coupling]", "[couplng]", "strip.toml: couplng: unknown key 'couplng'; did you mean 'coupling'?"),
        (
            'gain = "6.79e-9 m/V/s"\n',
            "",
            'strip.toml: coupling.gain: this key is missing; add gain = "... m/V/s" (K_d)',
        ),
        ('name = "friend-2"', "", 'strip.toml: name: an actuator needs a name; add name = "..." at the top'),
        (
            '"25 mm"',
            '"-25 mm"',
            "strip.toml: geometry.free_length: the value -0.025 m is outside the allowed 0.0001 to 1 m",
        ),
        ('"0.245 mm"', '"0.245 m"', "geometry.thickness: the value 0.245 m is outside the allowed 1e-06 to 0.01 m"),
        ('"21 mm"', '"26 mm"', "geometry.sensing_length: the sensing length 0.026 m is beyond the free length 0.025 m"),
        ('"25 mm"', '"25 V"', "geometry.free_length: '25 V' is not a length: the unit 'V' is not one of m, cm, mm"),
        ('"25 mm"', '"25"', "geometry.free_length: '25' has no unit"),
        ('"25 mm"', "25", 'geometry.free_length: 25 has no unit; write "... mm"'),
        ('"25 mm"', "true", "geometry.free_length: True is not a length"),
        ('"25 mm"', '"2,5 mm"', "has a comma; write a decimal point"),
        ('"25 mm"', '"nan mm"', "geometry.free_length: 'nan mm' is not a number with a unit"),
        ("= 0.05 ", "= nan ", "beam.damping_ratio: the value nan is outside the allowed"),
        ("= 0.05 ", '= "0.05 mm" ', "beam.damping_ratio: '0.05 mm' has the unit 'mm', this is a bare number"),
        ('"0.11998 F/m"', '"0 F/m"', "circuit.branches.0.permittivity: the value 0 F/m is outside the allowed"),
        ('permittivity = "0.48106 F/m"', "", "circuit.branches.1.permittivity: this key is missing"),
        (
            '"25 mm"',
            '{ value = "25 mm", uncertainty = "1 mm" }',
            "geometry.free_length.uncertainty: unknown key 'uncertainty'; did you mean 'standard_uncertainty'?",
        ),
        ('"25 mm"', '{ standard_uncertainty = "1 mm" }', "geometry.free_length.value: this key is missing"),
        (
            '"25 mm"',
            '{ value = "25 mm", standard_uncertainty = "-1 mm" }',
            "geometry.free_length.standard_uncertainty: '-1 mm' is not 0 or more; give one standard deviation",
        ),
        (
            "= 0.05 ",
            "= { value = 0.05, standard_uncertainty = nan } ",
            "beam.damping_ratio.standard_uncertainty: nan is not 0 or more",
        ),
        ("= 0.05 ", f"= 1{'0' * 400} ", "beam.damping_ratio: the value inf is outside the allowed"),
        ("= 0.05 ", f"= 1{'0' * 5000} ", "strip.toml: not a TOML file: Exceeds the limit"),
        ("[geometry]", f"deep = {'[' * 100_000}", "strip.toml: not a TOML file: "),
        ("[geometry]", "[geometry", "strip.toml: not a TOML file"),
        ("[beam]", "[fit]\n[sample]\n[beam]", "strip.toml: sample.id: a sample needs an id"),
        ("[geometry]", "fit = 3\n[geometry]", "strip.toml: fit: 3 is not a table; write it below [fit]"),
    ],
)
def test_messages(old: str, new: str, message: str) -> None:
    assert old in FRIEND_2_TEXT
    with pytest.raises(InputError) as caught:
        actuator_from_text(FRIEND_2_TEXT.replace(old, new, 1), where="strip.toml")
    assert message in str(caught.value)


def test_optional_keys_and_uncertainties() -> None:
    text = "\n".join(line for line in FRIEND_2_TEXT.splitlines() if "optional" not in line)
    text = text.replace('"1.3333333333333333 ohm"', '{ value = "8 ohm", standard_uncertainty = "100 mohm" }')
    actuator = actuator_from_text(text + '\n[sample]\nid = "s-1"\ndry_mass = "103 mg"\n[fit]\nnote = "kept"\n')
    assert actuator["beam.damping_ratio"] == 0.05
    assert actuator["circuit.contact_resistance"] == 0.0
    assert actuator.parameters()["circuit.sheet_resistance"].standard_uncertainty == 0.1
    assert actuator.sample is not None
    assert actuator.sample.dry_mass == 103e-6
    assert actuator.fit_table == {"note": "kept"}
    changed = actuator.replace(**{"circuit.sheet_resistance": 9.0})
    assert changed.fit_table is None  # another actuator than the one that was fitted
    assert not changed.standard_uncertainties


def test_files_are_not_overwritten_without_leave(friend_2: Actuator, tmp_path: Path) -> None:
    path = tmp_path / "strip.toml"
    write_actuator(friend_2, path)
    with pytest.raises(InputError, match="the file exists already; choose another name, or allow overwriting"):
        write_actuator(friend_2, path)
    write_actuator(friend_2.replace(**{"beam.modulus": 2e8}), path, overwrite=True)
    assert load_actuator(path)["beam.modulus"] == 2e8
    assert load_actuator(str(path)).name == "friend-2"
    with pytest.raises(InputError, match=r"the folder '.*missing' does not exist; make the folder, or write elsewhere"):
        write_actuator(friend_2, tmp_path / "missing" / "strip.toml")
    with pytest.raises(InputError, match="this is a folder"):
        write_actuator(friend_2, tmp_path, overwrite=True)


def test_a_failure_leaves_the_old_file(friend_2: Actuator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "strip.toml"
    write_actuator(friend_2, path)

    def fail(file: Path, text: str, **_: object) -> None:
        file.write_bytes(text[:100].encode())
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(IpmclabError, match="the file cannot be written: No space left on device"):
        write_actuator(friend_2.replace(**{"beam.modulus": 2e8}), path, overwrite=True)
    assert load_actuator(path)["beam.modulus"] == 1.45e9
    assert list(tmp_path.iterdir()) == [path]


def test_actuators_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match="there is no actuator 'freind-2', neither in the library nor as a file; did you mean 'friend-2'",
    ):
        load_actuator("freind-2")
    binary = tmp_path / "strip.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot be read as text"):
        load_actuator(binary)
    with pytest.raises(InputError, match="this is a folder, not an actuator; name a file in it"):
        load_actuator(tmp_path)
    with pytest.raises(InputError, match="cannot be read as text: embedded null byte"):
        load_actuator("strip\0.toml")
    binary.write_text(FRIEND_2_TEXT, encoding="utf-8-sig")
    assert load_actuator(binary).name == "friend-2"
    binary.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="an actuator needs a name"):
        load_actuator(binary)


def test_unknown_parameters_are_named(friend_2: Actuator) -> None:
    with pytest.raises(InputError, match=re.escape("unknown parameter 'beam.module'; did you mean 'beam.modulus'")):
        friend_2.replace(**{"beam.module": 1.0})
    with pytest.raises(InputError, match=re.escape("unknown parameter 'circuit.branches.2.resistivity'")):
        friend_2.values(["circuit.branches.2.resistivity"])
    with pytest.raises(InputError, match=re.escape("unknown parameter 'circuit.branches.9.resistivity'")):
        Actuator("x", {**friend_2.parameter_values, "circuit.branches.9.resistivity": 1.0})
    with pytest.raises(InputError, match=re.escape("beam.modulus: the value -1 Pa is outside the allowed")):
        friend_2.replace(**{"beam.modulus": -1.0})
    with pytest.raises(InputError, match=r"beam\.modulus: '2 GPa' is not a number; give it as a number in Pa"):
        friend_2.replace(**{"beam.modulus": "2 GPa"})
    with pytest.raises(InputError, match="this parameter is missing"):
        Actuator("x", {})


def test_exports_agree_in_frequency_response(friend_2: Actuator, monkeypatch: pytest.MonkeyPatch) -> None:
    frequency = np.array([0.0, 0.01, 0.3, 5.0, 38.0, 300.0])
    own = friend_2.frequency_response(frequency)
    exported = friend_2.to_control()
    assert exported.input_labels == ["voltage"]
    assert tuple(exported.output_labels) == OUTPUTS
    assert exported.state_labels[4] == "beam_displacement"
    by_control = control.frequency_response(exported, 2 * np.pi * frequency[1:]).complex.reshape(4, -1)
    np.testing.assert_allclose(by_control, own[:, 1:], rtol=1e-10)
    system = friend_2.to_scipy()
    for index, hertz in enumerate(frequency):
        s = 2j * np.pi * hertz
        by_scipy = system.C @ np.linalg.inv(s * np.eye(6) - system.A) @ system.B + system.D
        np.testing.assert_allclose(by_scipy[:, 0], own[:, index], rtol=1e-10)
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(InputError, match="python-control is not installed; in the folder of ipmclab, write"):
        friend_2.to_control()


def test_a_name_longer_than_a_file_system_knows_is_no_actuator() -> None:
    for name in ("a" * 300, "a" * 300 + "+leak.cubic"):
        with pytest.raises(InputError):
            load_actuator(name)
