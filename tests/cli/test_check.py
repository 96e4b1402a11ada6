"""``ipmclab check``: with a model of the strip it foretells what the rate cannot show."""

from __future__ import annotations


def codes(document) -> set[str]:
    return {finding["code"] for finding in document["runs"][0]["findings"]}


def test_a_model_foretells_an_aliased_resonance(command) -> None:
    words = ("simulate", "friend-2", "--signal", "square 1 V 0.1 Hz", "--duration", "20 s", "--out")
    assert command(*words, "slow.nc", "--rate", "50 Hz").status == 0
    assert command(*words, "fast.nc", "--rate", "500 Hz").status == 0
    assert "resonance-aliased" not in codes(command("check", "slow.nc", "--json").document)
    assert "resonance-aliased" in codes(command("check", "slow.nc", "--actuator", "friend-2", "--json").document)
    assert "resonance-aliased" not in codes(command("check", "fast.nc", "--actuator", "friend-2", "--json").document)
    refused = command("check", "slow.nc", "--actuator", "freind-2")
    assert refused.status == 2
    assert "did you mean 'friend-2'" in refused.err


def test_an_actuator_is_held_against_what_is_known_of_it(command, tmp_path) -> None:
    words = ("--signal", "step 1 V", "--duration", "10 s", "--rate", "50 Hz", "--out", "s.nc")
    assert command("simulate", "friend-2", *words).status == 0
    both = command("check", "friend-2", "s.nc", "--json")
    assert both.status == 0
    assert [one["run"] for one in both.document["runs"]] == ["s.nc"]
    (strip,) = both.document["actuators"]
    assert strip["actuator"] == "friend-2"
    found = {finding["code"]: finding["values"] for finding in strip["findings"]}
    assert abs(found["two-states"]["found"] - 0.2048) < 1e-9
    assert abs(found["two-states"]["expected"] - 0.06701) < 1e-9
    assert both.document["worst"] == "warning"
    text = command("check", "friend-2", "--fail-on", "warning")
    assert text.status == 1
    assert "friend-2: 9 findings" in text.out
    assert "cheapest experiment that decides" in text.out
    # A variant of it is the same strip; a file that does not say what the strip is made of has few facts to compare.
    variant = command("check", "friend-2+relaxation.displacement", "--json").document["actuators"][0]
    assert "density-against-mass" in {finding["code"] for finding in variant["findings"]}


def test_a_strip_of_ones_own_is_checked_from_its_file_and_runs(command, tmp_path) -> None:
    from ipmclab import load_actuator, write_actuator

    strip = load_actuator("friend-2")
    layers = {f"circuit.branches.{i}.permittivity": 0.1 * strip[f"circuit.branches.{i}.permittivity"] for i in (0, 1)}
    write_actuator(strip.replace(**layers), tmp_path / "mine.toml")
    words = ("--signal", "step 1 V", "--duration", "10 s", "--rate", "50 Hz", "--out", "s.nc")
    assert command("simulate", "mine.toml", *words).status == 0
    assert command("check", "mine.toml", "s.nc", "--json").document["actuators"][0]["findings"] == []
    assert "mine.toml: no findings" in command("check", "mine.toml", "s.nc").out


def test_a_recorded_push_is_held_against_the_strip_and_its_runs(command, tmp_path) -> None:
    import numpy as np

    from ipmclab import Run, write_run

    words = ("--signal", "step 1 V", "--duration", "20 s", "--rate", "50 Hz", "--out", "s.nc")
    assert command("simulate", "friend-2", *words).status == 0
    time = np.arange(0.0, 22.0, 0.02)
    travel = 0.5e-3 * np.interp(time, [1.0, 11.0, 21.0], [0.0, 1.0, 0.0])
    noise = 1e-5 * np.random.default_rng(20261121).standard_normal(len(time))
    for name, stiffness in (("right.nc", 2.878), ("soft.nc", 0.9)):
        run = Run.from_arrays(
            time=time, voltage=np.zeros(len(time)), displacement=travel, force=stiffness * travel + noise
        )
        write_run(run, tmp_path / name)
    pushed = {"push-against-stiffness", "push-against-motion"}

    def found(run: str) -> set[str]:
        (strip,) = command("check", "friend-2", run, "s.nc", "--json").document["actuators"]
        return {finding["code"] for finding in strip["findings"]}

    assert pushed <= found("soft.nc")
    assert not pushed & found("right.nc")


def test_the_strips_identified_from_printed_numbers_are_checked_with_those_of_their_figures(command) -> None:
    """What each says is a conflict of the printed numbers or of the thickness that the thesis gives one sample of."""
    expected = {
        "friend-1-measured": {"thickness-against-membrane", "dry-mass-against-layers"},
        "friend-2-measured-force": {"thickness-against-membrane", "dry-mass-against-layers"},
        "friend-3-measured": {"thickness-against-membrane", "dry-mass-against-layers", "prefix-disagrees"},
        "friend-5-measured": {"thickness-against-membrane", "water-uptake", "two-states"},
        "friend-6-measured": {"thickness-against-membrane"},
    }
    strips = command("check", *expected, "--json").document["actuators"]
    assert {one["actuator"]: {finding["code"] for finding in one["findings"]} for one in strips} == expected
    # The first edge of a square is a step: 78.71 mA in figure 5.31, 88 mA in 5.29.
    (prefix,) = (finding for finding in strips[2]["findings"] if finding["code"] == "prefix-disagrees")
    assert abs(prefix["values"]["found"] - 78.71e-3) < 1e-9
    assert abs(prefix["values"]["expected"] - 88e-3) < 1e-9
