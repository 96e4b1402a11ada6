"""What the catalogue keeps of a run file is what was written into it."""

from __future__ import annotations

import hashlib

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.errors import InputError
from ipmclab.store import heap
from ipmclab.store.catalogue import facts as catalogue_facts
from ipmclab.store.catalogue.facts import read_facts, signal_facts, storable
from ipmclab.store.document import to_document
from ipmclab.store.run_file import read_run

UUID = "3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee"


def test_every_fact_of_a_run(write) -> None:
    humidity = np.array([79.0, 81.0, np.nan])
    path = write(
        "a.nc",
        sample="S2",
        uuid=UUID,
        mounting_id="m7",
        run_number=3,
        purpose="signal",
        signal="sine -1 V 0.1 Hz",
        state="complete",
        operator="Ada",
        rig="bench 1",
        temperature=21.5,
        relative_humidity=50.0,
        minutes_out_of_water=12.5,
        recorded_at="2026-11-21T14:32:05+01:00",
        channels={
            "force": np.zeros(50),
            "relative_humidity": humidity,
            "time_environment": np.array([0.0, 0.4, 0.8]),
            "temperature": np.full(3, np.nan),
        },
    )
    found = read_facts(path)
    assert found.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert found.size == path.stat().st_size
    document = dict(found.run["document"])
    assert document["operator"] == "Ada"
    facts = {name: value for name, value in found.run.items() if name != "document" and value is not None}
    assert facts == {
        "identity": f"{UUID} {hashlib.sha256(to_document(read_run(path)).encode()).hexdigest()}",
        "uuid": UUID,
        "content_sha256": read_run(path).content_sha256,
        "state": "complete",
        "recorded_at": "2026-11-21T14:32:05+01:00",
        "recorded": 1795267925.0,  # date --date 2026-11-21T14:32:05+01:00 +%s
        "rows": 50,
        "duration": pytest.approx(1.0),
        "rate": 50.0,
        "origin": "measured",
        "sample": "S2",
        "mounting": "m7",
        "run_number": 3,
        "purpose": "signal",
        "signal": "sine -1 V 0.1 Hz",
        "drive": "sine -1 V 0.1 Hz",
        "signal_words": " sine ",
        "amplitude": -1.0,
        "frequency": 0.1,
        "channels": " voltage current force temperature relative_humidity ",
        "temperature": 21.5,  # the channel has no reading
        "relative_humidity": 80.0,  # measured goes before noted
        "minutes_out_of_water": 12.5,
        "operator": "Ada",
        "rig": "bench 1",
    }


def test_the_quick_way_and_the_whole_way_agree(write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write("a.nc", sample="S2", signal="step 1 V", temperature=20.0)
    quick = read_facts(path)
    monkeypatch.setattr(catalogue_facts, "_quick_facts", lambda path: None)
    assert read_facts(path) == quick


def test_runs_without_uuid_differ_when_their_metadata_do(write) -> None:
    one, other = write("a.nc", sample="S1"), write("b.nc", sample="S2")
    assert read_facts(one).run["content_sha256"] == read_facts(other).run["content_sha256"]
    assert read_facts(one).run["identity"] != read_facts(other).run["identity"]


@pytest.mark.parametrize("cut", [0, 5, 100, 5000])
def test_a_truncated_file_is_told(write, cut: int) -> None:
    path = write("a.nc")
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(InputError) as caught:
        read_facts(path)
    assert caught.value.code in ("empty-file", "truncated-file", "damaged-file")


def test_changed_metadata_are_told(write) -> None:
    path = write("a.nc", sample="S2")
    with h5py.File(path, "r+") as file:
        file.attrs["metadata_json"] = str(file.attrs["metadata_json"]).replace("S2", "S3")
    with pytest.raises(InputError, match="checksum of the metadata"):
        read_facts(path)


@pytest.mark.parametrize(
    ("text", "drive", "words", "amplitude", "frequency"),
    [
        (None, None, (), None, None),
        ("step 1 V", "step 1 V", ("step",), 1.0, None),
        ("square 0.5 V 0.1 Hz delay=1 s", "square 0.5 V 0.1 Hz delay=1 s", ("square",), 0.5, 0.1),
        ("step 0 V for 5 s then sine -1 V 2 Hz for 9 s", "sine -1 V 2 Hz", ("sine",), -1.0, 2.0),
        ("step 0 V for 5 s then step 0 V for 9 s", "step 0 V", ("step",), 0.0, None),
        ("sine 1 V 1 Hz for 5 s then sine 2 V 1 Hz for 5 s", "sine 1 V 1 Hz for ...", ("sine",), 2.0, 1.0),
        ("sine 1 V 1 Hz for 5 s then square -2 V 2 Hz", "sine 1 V 1 Hz for ...", ("sine", "square"), -2.0, None),
        ("samples 0 s 0 V 1 s -3 V 2 s 1 V", "samples 0 s 0 V ...", ("samples",), -3.0, None),
        ("file gone.csv", "file gone.csv", ("file",), None, None),
        ("step 1 V for 2 s then file gone.csv", "step 1 V ...", ("file",), None, None),
        ("0.1 Hz by the generator", "0.1 Hz by the generator", (), None, None),
    ],
)
def test_the_facts_of_a_signal(text: str | None, drive: str | None, words, amplitude, frequency) -> None:
    found = signal_facts(text)
    assert (found.words, found.amplitude, found.frequency) == (words, amplitude, frequency)
    assert found.drive == (text if drive and drive.endswith("...") else drive)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.characters(categories=["Cs"]),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(json_values)
def test_whatever_is_stored_is_text_and_finite_numbers(value) -> None:
    def walk(one) -> None:
        if isinstance(one, str):
            assert "\0" not in one.encode("utf-8").decode()
        elif isinstance(one, dict):
            for key, item in one.items():
                walk(key)
                walk(item)
        elif isinstance(one, list):
            for item in one:
                walk(item)
        else:
            assert one is None or isinstance(one, int) or np.isfinite(one)

    walk(storable(value))


def test_a_heap_without_an_end_is_damage(write, monkeypatch: pytest.MonkeyPatch) -> None:
    """HDF5 would walk it for ever: it is looked for before the library sees the file."""
    path = write("endless.nc")
    opened: list[object] = []
    monkeypatch.setattr(h5py, "File", lambda *given: opened.append(given))
    monkeypatch.setattr(heap, "_is_endless", lambda *_: True)
    with pytest.raises(InputError, match="the ends of its texts are lost"):
        read_facts(path)
    assert not opened
