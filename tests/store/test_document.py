"""What a run carries beside its arrays: as texts for people, and as one table for programs."""

from __future__ import annotations

from ipmclab.run import Finding, Mark, RunMetadata, ZeroReading
from ipmclab.sample import Sample
from ipmclab.store.document import attributes_of, metadata_table, parse_metadata


def test_what_people_read_of_every_kind_of_fact() -> None:
    zeros = (
        ZeroReading("force", "zero", "before", 0.001, 0.0002),
        ZeroReading("force", "tare", "after", 0.002, 0.0002, 1e-6),
    )
    told = attributes_of(
        "first",
        RunMetadata(
            run_number=0,
            starts_from_rest=False,
            mass=131e-6,
            clamp_pressure=2e5,
            temperature=21.0,
            relative_humidity=0.0,
            minutes_out_of_water=30.0,
            marks=(Mark(1.5, "lamp"), Mark(2.0, "door")),
            zeros=zeros,
            ranges={"current": (-0.2, 0.2)},
            uncertainties={"force": 1e-4},
            calibrations={"force": "cell 3"},
            limits={"current": "0.2 A"},
            parameters={"beam.modulus": 1e8},
        ),
        "0",
    )
    assert told == {
        "hold": "first",
        "content_sha256": "0",
        "origin": "measured",
        "run_number": "0",
        "starts_from_rest": "False",
        "mass": "0.000131 kg",
        "clamp_pressure": "200000.0 Pa",
        "temperature": "21.0 degC",
        "relative_humidity": "0.0 percent",
        "minutes_out_of_water": "30.0 min",
        "marks": "1.5 s: lamp; 2.0 s: door",
        "zeros": "force: zero before 0.001 N, standard uncertainty 0.0002 N; "
        "force: tare after 0.002 N, standard uncertainty 0.0002 N, drift 1e-06 N/s",
        "ranges": "current: -0.2 to 0.2 A",
        "uncertainties": "force: 0.0001 N",
        "calibrations": "force: cell 3",
        "limits": "current: 0.2 A",
        "parameters": "beam.modulus = 100000000.0",
        "sampling_period_known": "True",
    }


def test_what_an_older_ipmclab_does_not_know_stands_only_where_it_says_something() -> None:
    finding = Finding(code="a", severity="info", message="b", repair="c")
    bare = metadata_table(RunMetadata(sample=Sample(id="2")))
    assert "findings" not in bare
    assert bare["sample"] == {"id": "2"}
    full = RunMetadata(sample=Sample(id="2", micrographs=("a.png", "b.png")), findings=(finding,))
    assert metadata_table(full)["sample"] == {"id": "2", "micrographs": ["a.png", "b.png"]}
    assert parse_metadata(metadata_table(full), where="metadata") == full
