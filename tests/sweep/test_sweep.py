"""Sweeps: designs in parts, metrics against single simulations, Sobol indices against a closed form."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, IpmclabError, load_actuator, read_sweep, run_sweep, simulate
from ipmclab.platform import lock_file
from ipmclab.reporting.figures.sweep import _power
from ipmclab.sweep import design as design_module
from ipmclab.sweep.design import KINDS, Range, Sampled, Table
from ipmclab.sweep.effects import morris_effects
from ipmclab.sweep.indices import sobol_indices
from ipmclab.sweep.sweep_file import _read_columns, sweep_from_text
from ipmclab.sweep.template import TEMPLATE
from ipmclab.units import LENGTH, NUMBER
from tests.engine.awkward import Awkward
from tests.profiles import costly

RANGES = {"beam.modulus": Range(8e8, 2e9, log=True), "coupling.gain": Range(5e-9, 9e-9), "coupling.p1": Range(10, 20)}
SMALL = TEMPLATE.replace("base = 512", "base = 8").replace("\n[design]", "\nsets_per_file = 7\n[design]")
FILES = 6  # of its 40 sets


@costly(4)
@given(kind=st.sampled_from(KINDS), cuts=st.lists(st.integers(0, 80), max_size=4), seed=st.integers(0, 99))
def test_a_design_in_parts_is_the_whole_design(kind: str, cuts: list[int], seed: int) -> None:
    design = Sampled(kind, RANGES, 16, seed)
    edges = sorted({0, design.count, *(cut for cut in cuts if cut < design.count)})
    parts = [design.sets(begin, end) for begin, end in itertools.pairwise(edges)]
    whole = design.sets(0, design.count)
    for name, one in RANGES.items():
        assert np.array_equal(np.concatenate([part[name] for part in parts]), whole[name])
        assert len(whole[name]) == design.count
        assert np.all((one.low <= whole[name]) & (whole[name] <= one.high))


@pytest.mark.parametrize("kind", ["sobol", "latin-hypercube"])
def test_each_slice_of_each_parameter_has_one_set(kind: str) -> None:
    sets = Sampled(kind, RANGES, 64, seed=3).sets(0, 64)
    for name, one in RANGES.items():
        way = np.log(sets[name] / one.low) / np.log(one.high / one.low) if one.log else sets[name] - one.low
        part = way if one.log else way / (one.high - one.low)
        assert sorted(np.floor(64 * part).astype(int)) == list(range(64))


def test_sobol_indices_of_ishigami_are_those_of_its_closed_form() -> None:
    """sin x1 + a sin^2 x2 + b x3^4 sin x1 over -pi to pi (Ishigami and Homma 1990)."""
    a, b = 7.0, 0.1
    ranges = {name: Range(-np.pi, np.pi) for name in ("x1", "x2", "x3")}
    design = Sampled("saltelli", ranges, 4096, seed=1)
    sets = design.sets(0, design.count)
    values = np.sin(sets["x1"]) + a * np.sin(sets["x2"]) ** 2 + b * sets["x3"] ** 4 * np.sin(sets["x1"])
    one, two = 0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0
    both = b**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    variance = one + two + both
    first = np.array([one, two, 0.0]) / variance
    total = np.array([one + both, two, both]) / variance
    found = sobol_indices(values + 1e3, 3)  # a mean that is far from 0 takes no digits
    for index, expected_first, expected_total in zip(found, first, total, strict=True):
        assert abs(index.first - expected_first) < 0.01
        assert abs(index.total - expected_total) < 0.01
        assert index.first_interval[0] <= index.first <= index.first_interval[1]
    without = np.where(np.arange(len(values)) % 500 == 0, np.nan, values)
    assert abs(sobol_indices(without, 3)[1].first - first[1]) < 0.02
    assert np.isnan(sobol_indices(np.ones(20), 3)[0].first)


def test_effects_of_morris_are_those_of_a_plane_and_a_product() -> None:
    """Of 3 x - 2 y the effects are 3 and -2 on every way; what two parameters do together is spread."""
    design = Sampled("morris", {name: Range(0.0, 1.0) for name in ("x", "y", "z")}, 50, seed=1)
    ways = design.ways(0, design.count)
    plane = morris_effects(ways, 3.0 * ways[:, 0] - 2.0 * ways[:, 1], design.names)
    assert [(round(one.mean, 9), round(one.magnitude, 9)) for one in plane] == [(3.0, 3.0), (-2.0, 2.0), (0.0, 0.0)]
    assert all(one.standard_deviation < 1e-9 for one in plane)
    values = ways[:, 0] * ways[:, 1]
    x, y, z = morris_effects(ways, np.where(np.arange(200) % 40 == 0, np.nan, values), design.names)
    assert min(x.standard_deviation, y.standard_deviation) > 0.2
    assert z.magnitude == 0.0
    assert x.magnitude_interval[0] < 0.5 < x.magnitude_interval[1]
    assert np.isnan(morris_effects(ways, np.full(200, np.nan), design.names)[0].mean)


def test_a_table_is_swept_by_others_with_its_values_on_the_way(tmp_path: Path) -> None:
    (tmp_path / "strips.csv").write_text("beam.modulus [GPa]\n" + "\n".join(f"{1 + k / 50}" for k in range(30)))
    (tmp_path / "sweep.toml").write_text(f'table = "strips.csv"\nsets_per_file = 7\n{TABLE}')
    sweep, folder = read_sweep(tmp_path / "sweep.toml"), tmp_path / "there"
    here = run_sweep(sweep, tmp_path / "here")
    run_sweep(sweep, folder, engine=Awkward())
    for part in (0, 2, 3):
        (folder / f"part-{part:08d}.parquet").unlink()
    there = run_sweep(sweep, folder, engine=Awkward())
    assert (there.found, there.parts.files) == (2, 5)
    for part in range(5):
        assert there.parts.path(part).read_bytes() == here.parts.path(part).read_bytes()
    below = replace(sweep, design=Table({"beam.modulus": np.full(30, -1.0)}))
    with pytest.raises(IpmclabError, match=r"beam\.modulus\[0\]: sets \d+ to \d+: the value -1 Pa"):
        run_sweep(below, tmp_path / "more", engine=Awkward())


def test_each_set_is_simulated_and_none_is_lost(tmp_path: Path) -> None:
    sweep = sweep_from_text(SMALL)
    said: list[tuple[str, float]] = []
    swept = run_sweep(sweep, tmp_path / "out", progress=lambda sentence, done: said.append((sentence, done)))
    assert swept.parts.files == FILES
    assert said[1] == ("7 of 40 sets", 1 / FILES)
    found = swept.columns("set", *sweep.design.names, *sweep.metrics.names)
    assert np.array_equal(found["set"], np.arange(40))
    for k in (0, 6, 7, 39):
        strip = sweep.actuator.replace(**{name: float(found[name][k]) for name in sweep.design.names})
        run = simulate(strip, sweep.signal, duration="10 s", rate="50 Hz")
        peak = run.displacement[np.argmax(np.abs(run.displacement))]
        assert found["displacement.peak"][k] == pytest.approx(peak, rel=1e-12)
        assert found["current.rms"][k] == pytest.approx(np.sqrt(np.mean(run.current**2)), rel=1e-12)
    spread = swept.distributions()["force.rms"]
    assert spread.mean == pytest.approx(found["force.rms"].mean(), rel=1e-13)
    assert spread.standard_deviation == pytest.approx(found["force.rms"].std(), rel=1e-12)
    assert (spread.smallest, spread.largest) == (found["force.rms"].min(), found["force.rms"].max())
    with pytest.raises(InputError, match="did you mean 'force.rms'".replace(".", r"\.")):
        swept.columns("force.rmss")


def test_what_was_stopped_goes_on_where_it_was(tmp_path: Path) -> None:
    sweep, folder = sweep_from_text(SMALL), tmp_path / "out"
    whole = run_sweep(sweep, tmp_path / "whole").columns("force.rms")["force.rms"]

    def stop(sentence: str, done: float) -> None:
        if done >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(sweep, folder, progress=stop)
    parts = sorted(path.name for path in folder.glob("*.parquet"))
    (folder / parts[1]).unlink()
    (folder / ".part-00000001.parquet.0badcafe.part").write_bytes(b"half of a file")
    swept = run_sweep(sweep, folder)
    assert swept.found == 2
    assert np.array_equal(swept.columns("force.rms")["force.rms"], whole)
    assert not list(folder.glob(".*"))


def test_a_folder_belongs_to_one_sweep_and_one_program(tmp_path: Path) -> None:
    sweep, folder = sweep_from_text(SMALL), tmp_path / "out"
    run_sweep(sweep, folder)
    with pytest.raises(InputError, match="holds another sweep"):
        run_sweep(sweep_from_text(SMALL.replace("seed = 1", "seed = 2")), folder)
    with (folder / "_lock").open("ab") as stream:
        assert lock_file(stream.fileno())
        with pytest.raises(InputError, match="another program works on this sweep"):
            run_sweep(sweep, folder)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"something else in this folder: 'notes\.txt'|'out'"):
        run_sweep(sweep, tmp_path)
    with pytest.raises(InputError, match="does not exist; make the folder"):
        run_sweep(sweep, tmp_path / "no" / "out")
    with pytest.raises(InputError, match="cannot be a folder here"):
        run_sweep(sweep, tmp_path / "notes.txt")


def test_a_file_that_was_spoiled_is_named_and_made_again(tmp_path: Path) -> None:
    sweep, folder = sweep_from_text(SMALL), tmp_path / "out"
    whole = run_sweep(sweep, folder).columns("force.rms")["force.rms"]
    spoiled = folder / "part-00000002.parquet"
    spoiled.write_bytes(b"PAR1")
    with pytest.raises(IpmclabError, match=r"part-00000002\.parquet: this file of the sweep cannot be read.*remove it"):
        run_sweep(sweep, folder).columns("force.rms")
    spoiled.unlink()
    assert np.array_equal(run_sweep(sweep, folder).columns("force.rms")["force.rms"], whole)
    (folder / "_sweep.json").write_bytes(b"\xff{")
    with pytest.raises(InputError, match="holds another sweep"):
        run_sweep(sweep, folder)


TABLE = TEMPLATE[: TEMPLATE.index("[design]")]


def test_a_table_has_units_in_its_head(tmp_path: Path) -> None:
    (tmp_path / "strips.csv").write_text("beam.modulus [GPa],coupling.gain\n1.2,6e-9\n\n1.4,7e-9\n")
    (tmp_path / "sweep.toml").write_text(f'table = "strips.csv"\n{TABLE}')
    sweep = read_sweep(tmp_path / "sweep.toml")
    found = run_sweep(sweep, tmp_path / "out").columns("set", "beam.modulus", "displacement.peak")
    assert found["beam.modulus"].tolist() == [1.2e9, 1.4e9]
    assert found["set"].tolist() == [0, 1]


@pytest.mark.parametrize(
    "text",
    [
        "beam.modulus[GPa];coupling.gain\n1.2;6e-9\n1.4;7e-9\n",
        "# from the lab\ncoupling.gain\tbeam.modulus (GPa)\n6e-9\t1.2\n7e-9\t1.4\n",
        '"beam.modulus  [GPa]", "coupling.gain",\n1.2, "6e-9",,\n , ,\n1.4, 7e-9\n',
    ],
)
def test_a_table_is_read_as_other_programs_write_it(tmp_path: Path, text: str) -> None:
    (tmp_path / "strips.csv").write_text(text, encoding="utf-8-sig")
    sets = sweep_from_text(f'table = "strips.csv"\n{TABLE}', folder=tmp_path).design.sets(0, 2)
    assert {name: values.tolist() for name, values in sets.items()} == {
        "beam.modulus": [1.2e9, 1.4e9],
        "coupling.gain": [6e-9, 7e-9],
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("beam.modulos\n1e9\n", "no parameter is called 'beam.modulos'; did you mean"),
        ("beam.modulus [mm]\n1e9\n", "is not a modulus|is not a Young"),
        ("beam.modulus\n1,5\n", "line 2: '1,5' is not one number for each of 1 columns"),
        ("beam.modulus\n", "there is no parameter set"),
        ("beam.modulus\n1e9\n-1\n", r"strips\.csv: beam\.modulus\[1\]: the value -1 Pa is outside"),
        ("beam.modulus,beam.modulus\n1e9,1e9\n", "a parameter has two columns"),
        ("beam.modulus;coupling.gain\n1,5;6e-9\n", "line 2: '1,5;6e-9' is not one number .* decimal point"),
        ("beam.modulus [GPa\n1\n", "no parameter is called 'beam.modulus .GPa'"),
        (b"beam.modulus\n\xb5\n", "cannot be read as text.* save it as CSV in UTF-8"),
    ],
)
def test_tables_that_cannot_be(tmp_path: Path, text: str | bytes, message: str) -> None:
    (tmp_path / "strips.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=message):
        sweep_from_text(f'table = "strips.csv"\n{TABLE}', folder=tmp_path)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('"beam.modulus"', '"beam.modulos"', "sweep: beam.modulos: unknown parameter"),
        ('low = "0.8 GPa"', 'low = "0.8"', "sweep: ranges.beam.modulus: '0.8' has no unit"),
        ('low = "0.8 GPa"', 'low = "3 GPa"', "give a high that is above low"),
        ('low = "0.8 GPa"', 'low = "0.1 Pa"', "sweep: beam.modulus.*outside the allowed"),
        ("base = 512", "base = 500", "give a power of two, such as 256 or 512"),
        ("base = 512", "base = 0", "0 is below 1"),
        ("base = 512", "base = 1 ", "one pair of points does not show how sure an index is"),
        ('kind = "saltelli"', 'kind = "fourier"', "'fourier' is not"),
        ("force.rms", "force.rmss", r"sweep: metrics: .*did you mean 'force\.rms'"),
        ("sine 1 V 0.5 Hz", "sine 1 V 80 Hz", "rows at 50 Hz follow it to 25 Hz"),
        ("friend-2", "friend-99", "there is no actuator"),
        ("[ranges]", "[range]", "unknown key 'range'"),
        ("[ranges]", "[[ranges]]", "is not a table"),
        ('"coupling.gain" = {', "beam.modulus = {",
         "sweep: ranges.beam.modulus: this parameter has two ranges"),
        ('low = "0.8 GPa"', "low = nan", "ranges.beam.modulus.low: nan"),
        ('low = "0.8 GPa"', "low = true", "ranges.beam.modulus.low: True"),
        ("base = 512", "base = 10000000000000000000000", "allowed|too large|at most|digits|whole number"),
        ('metrics = ["displacement.peak", "force.rms", "current.rms"]', "metrics = []", "name each once"),
        ("seed = 1", "seed = -1", "-1 is below 0"),
        ('hold = "zero" ', 'hold = "one" ', "'one' is not"),
        ('rate = "50 Hz"', 'rate = "50"', "has no unit"),
        ('actuator = "friend-2"', 'actuator = "friend-2"\ntable = "a.csv"', "keep one of them"),
        ('"beam.modulus" = {', '"geometry.sensing_length" = { low = "20 mm", high = "30 mm" }\n"beam.modulus" = {',
         "beyond the free length"),
        ('scale = "log"', 'scale = "ln"', "'ln' is not"),
        ('{ low = "5e-9 m/V/s", high', '{ low = "0 m/V/s", scale = "log", high', "a logarithm needs numbers above 0"),
    ],
)  # fmt: skip
def test_sweeps_that_cannot_be(before: str, after: str, message: str) -> None:
    assert before in TEMPLATE
    with pytest.raises(InputError, match=message):
        sweep_from_text(TEMPLATE.replace(before, after))


def test_names_without_quotes_are_names() -> None:
    text = TEMPLATE.replace('"beam.modulus"', "beam.modulus").replace('"coupling.gain"', "coupling.gain")
    assert sweep_from_text(text).design.names == sweep_from_text(TEMPLATE).design.names


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("beam.modulus,coupling.p1\n1.2e9,16\n\n1.3e9\n", "line 4"),
        ('beam.modulus,coupling.p1\n1.2e9,"16\n', "line 2"),
        ("beam.modulus,coupling.p1\n1.2e9,16,3\n", "line 2"),
    ],
)
def test_a_line_of_a_table_has_one_number_for_each_column(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "sets.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        _read_columns(tmp_path / "sets.csv", load_actuator("friend-2"))


def test_a_whole_number_is_not_drawn_from_a_range() -> None:
    text = SMALL.replace('actuator = "friend-2"', 'actuator = "friend-2+line.segments=4"')
    text += '[ranges."line.segments"]\nlow = 4\nhigh = 8\n'
    with pytest.raises(InputError, match="whole number"):
        sweep_from_text(text)


def test_one_pair_of_points_tells_no_index() -> None:
    """Drawn anew it is always itself: its interval had no width."""
    both = [[1.0, 2.0, 3.0, 4.0], [2.0, 1.0, 5.0, 3.0], [np.nan, 1.0, 1.0, 1.0]]
    assert all(np.isnan([one.first, *one.total_interval]).all() for one in sobol_indices([*both[0], *both[2]], 2))
    assert all(np.isfinite([one.first, *one.total_interval]).all() for one in sobol_indices([*both[0], *both[1]], 2))


def test_ways_of_another_version_are_another_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    ways, points = (sweep_from_text(SMALL.replace('"saltelli"', f'"{kind}"')) for kind in ("morris", "sobol"))
    before = ways.digest(), points.digest()
    monkeypatch.setattr(design_module, "version", lambda _: "99")
    assert ways.digest() != before[0]
    assert points.digest() == before[1]


def test_numbers_of_an_axis_share_a_power_of_ten_where_they_are_large_or_small() -> None:
    assert _power(np.array([2e4, 1.2e5]), NUMBER) == (5, "10⁵")
    assert _power(np.array([2e4, -9.9e4]), NUMBER) == (0, "")
    assert _power(np.array([2e-4, 9e-4]), NUMBER) == (-4, "10⁻⁴")
    assert _power(np.array([2e-6, 0.01]), LENGTH) == (0, "mm")
    assert _power(np.zeros(2), NUMBER) == (0, "")
