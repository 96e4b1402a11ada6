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
