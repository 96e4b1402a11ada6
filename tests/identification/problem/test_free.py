"""Names of free parameters: groups, dotted names, comma lists, and the messages for wrong ones."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, load_actuator
from ipmclab.identification.problem.free import OBSERVATION_NAMES, parse_free

KNOWN = list(load_actuator("friend-2").parameters())
ELECTRICAL = [
    "circuit.dc_resistivity",
    *(f"circuit.branches.{i}.{what}" for i in (0, 1) for what in ("resistivity", "permittivity")),
]


def test_groups_are_those_of_the_design() -> None:
    assert list(parse_free(KNOWN, "electrical").shared) == ELECTRICAL
    assert parse_free(KNOWN, "coupling").shared == ("coupling.gain", "coupling.zero", "coupling.p1", "coupling.p2")


@given(
    st.lists(st.sampled_from([*KNOWN, *OBSERVATION_NAMES]), min_size=1, unique=True),
    st.lists(st.sampled_from(KNOWN), unique=True),
    st.randoms(),
)
def test_order_spelling_and_repetition_do_not_matter(names: list[str], own: list[str], random: object) -> None:
    expected = parse_free(KNOWN, names, own)
    shuffled = [*names, names[0]]
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert parse_free(KNOWN, " , ".join(shuffled), ",".join(own)) == expected
    assert parse_free(KNOWN, [",".join(shuffled[:1]), ",".join(shuffled[1:])], own) == expected
    # Every name appears once, in file order, and a per-run one is not shared.
    assert set(expected.shared) == {n for n in names if n in KNOWN} - set(own)
    assert set(expected.per_run) == set(own)
    assert list(expected.shared) == sorted(expected.shared, key=KNOWN.index)


@given(st.text(max_size=40))
def test_any_text_is_read_or_refused_with_a_repair(text: str) -> None:
    refused: InputError | None = None
    try:
        assert set(parse_free(KNOWN, text).actuator) <= set(KNOWN)
    except InputError as error:
        refused = error
    assert refused is None or (refused.repair and refused.where == "free")


@pytest.mark.parametrize(
    ("free", "per_run", "where", "words"),
    [
        (
            "circuit.sheet_resistence",
            (),
            "free",
            ["circuit.sheet_resistence", "did you mean 'circuit.sheet_resistance'"],
        ),
        ("electric", (), "free", ["did you mean 'electrical'"]),
        ("circuit.branches.2.resistivity", (), "free", ["circuit.branches.2.resistivity"]),
        ("electrical", "circuit.contact_resistance[0]", "per_run", ["'circuit.contact_resistance' as per_run"]),
        ("observation.delay", (), "free", ["found without being named"]),
        (
            "offset",
            (),
            "free",
            ["'observation.offset.current', 'observation.offset.displacement' or 'observation.offset.force'"],
        ),
        ("observation.drift", (), "free", ["'observation.drift.current'", "or 'observation.drift.force'"]),
        ("", (), "free", ["nothing is free", "electrical"]),
        ([3], (), "free", ["3", "is not a name"]),
    ],
)
def test_messages(free: object, per_run: object, where: str, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        parse_free(KNOWN, free, per_run)  # type: ignore[arg-type]
    assert caught.value.where == where
    for word in words:
        assert word in str(caught.value)
