"""A folder as an RO-Crate: what was put in comes out, and the metadata say of every file what it is."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ipmclab import (
    InputError,
    RunMetadata,
    Sample,
    export_crate,
    identify,
    load_actuator,
    read_fit,
    read_run,
    simulate,
    write_fit,
    write_run,
)

STRIP = load_actuator("friend-2")
ADA = "Ada Example <0000-0002-1825-0097>"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("publication") / "runs"
    (place / "more").mkdir(parents=True)
    clean = simulate(STRIP, "step 1 V", duration=10, rate=25)
    about = RunMetadata(
        sample=Sample("strip 1", membrane="Nafion N117", dry_mass=1.03e-4),
        signal="step 1 V",
        operator="Ada Example",
        rig="rig 7",
        mounting_id="strip-1-a",
        recorded_at="2026-11-23T07:00:00+00:00",
        temperature=20.0,
    )
    run = replace(clean, time=clean.time + 5.0, metadata=about)
    write_run(run, place / "step.nc")
    write_run(simulate(STRIP, "sine 1 V 0.5 Hz", duration=10, rate=25), place / "more" / "sine.nc")
    write_fit(identify(STRIP, run, free="circuit.dc_resistivity"), place / "fit.toml")
    (place / "notes.md").write_text("of a strip\n", encoding="utf-8")
    (place / "other.nc").write_bytes(b"no run")
    (place / ".hidden.md").write_text("not for others", encoding="utf-8")
    (place / "journal.ipmcj").write_bytes(b"state of this program")
    return place


def opened(path: Path) -> tuple[zipfile.ZipFile, dict[str, dict[str, Any]]]:
    archive = zipfile.ZipFile(path)
    graph = json.loads(archive.read("ro-crate-metadata.json"))["@graph"]
    return archive, {entity["@id"]: entity for entity in graph}


def test_every_file_is_there_unchanged_and_described(folder: Path, tmp_path: Path) -> None:
    export_crate(
        folder,
        tmp_path / "crate.zip",
        title="A strip",
        licence="CC-BY-4.0",
        people=[ADA],
        organisation="Example University",
    )
    archive, entities = opened(tmp_path / "crate.zip")
    context = json.loads(archive.read("ro-crate-metadata.json"))["@context"]
    assert any("sha256" in one for one in context if isinstance(one, dict))  # or nobody knows what it means
    made = {"tables/runs.csv", "tables/metrics.csv", "tables/parameters.csv", "manifest-sha256.txt"}
    given = {"step.nc", "more/sine.nc", "fit.toml", "notes.md", "other.nc"}
    assert set(archive.namelist()) == given | made | {"ro-crate-metadata.json"}
    parts = entities["./"]["hasPart"]
    assert {part["@id"] for part in parts} == given | made
    sums = dict(line.split("  ")[::-1] for line in archive.read("manifest-sha256.txt").decode().splitlines())
    for name in sorted(given | made - {"manifest-sha256.txt"}):
        content, entity = archive.read(name), entities[name]
        assert entity["@type"] == "File"
        assert entity["sha256"] == sums[name] == hashlib.sha256(content).hexdigest()
        assert int(entity["contentSize"]) == len(content)
        assert entity["encodingFormat"].count("/") == 1
    archive.extractall(tmp_path / "back")
    again, once = read_run(tmp_path / "back" / "step.nc"), read_run(folder / "step.nc")
    assert (again.content_sha256, again.metadata) == (once.content_sha256, once.metadata)
    assert read_fit(tmp_path / "back" / "fit.toml").parameters == read_fit(folder / "fit.toml").parameters


def test_what_the_profile_requires(folder: Path, tmp_path: Path) -> None:
    # RO-Crate 1.1, sections "RO-Crate Metadata File Descriptor", "Root Data Entity" and "Contextual Entities".
    from rocrate.rocrate import ROCrate

    export_crate(folder, tmp_path / "crate.zip", title="A strip", licence="CC0-1.0", people=[ADA])
    _, entities = opened(tmp_path / "crate.zip")
    descriptor, root = entities["ro-crate-metadata.json"], entities["./"]
    assert descriptor["@type"] == "CreativeWork"
    assert descriptor["about"] == {"@id": "./"}
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert root["@type"] == "Dataset"
    assert root["name"] == "A strip"
    assert root["description"].startswith("2 runs of strip 1 and 1 fits")
    assert len(root["datePublished"]) == 10
    assert entities[root["license"]["@id"]]["name"] == "CC0 1.0 Universal"
    for entity in entities.values():
        for value in entity.values():
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, dict) and not one["@id"].startswith("https://w3id.org"):
                    assert one["@id"] in entities, one
    (tmp_path / "back").mkdir()
    zipfile.ZipFile(tmp_path / "crate.zip").extractall(tmp_path / "back")
    crate = ROCrate(tmp_path / "back")
    assert crate.name == "A strip"
    assert len(crate.data_entities) == 9


def test_who_recorded_what_with_what(folder: Path, tmp_path: Path) -> None:
    export_crate(
        folder,
        tmp_path / "crate.zip",
        title="A strip",
        licence="CC-BY-4.0",
        people=[ADA, "Bo Example"],
        organisation="Example",
    )
    _, entities = opened(tmp_path / "crate.zip")
    actions = {one["result"]["@id"]: one for one in entities.values() if one["@type"] == "CreateAction"}
    recorded = actions["step.nc"]
    assert recorded["startTime"] == "2026-11-23T07:00:00+00:00"
    assert entities[recorded["agent"]["@id"]]["@id"] == "https://orcid.org/0000-0002-1825-0097"
    assert entities[recorded["instrument"]["@id"]]["name"] == "rig 7"
    assert entities[recorded["object"]["@id"]]["material"] == "Nafion N117"
    assert entities[actions["more/sine.nc"]["instrument"]["@id"]]["@type"] == "SoftwareApplication"
    assert [entities[one["@id"]]["name"] for one in entities["./"]["author"]] == ["Ada Example", "Bo Example"]
    assert entities[entities["./"]["publisher"]["@id"]]["@type"] == "Organization"


def test_names_of_any_script_and_equal_files(folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "runs"
    place.mkdir()
    run = read_run(folder / "step.nc")
    for name, operator in (("erster Lauf.nc", "Öse, B."), ("zweiter.nc", "李"), ("dritter.nc", "Ada <not an address>")):
        write_run(replace(run, metadata=replace(run.metadata, operator=operator)), place / name)
    (place / "again.nc").write_bytes((place / "zweiter.nc").read_bytes())
    export_crate(place, tmp_path / "crate.zip", title="Names", licence="CC-BY-4.0")
    archive, entities = opened(tmp_path / "crate.zip")
    actions = [one for one in entities.values() if one["@type"] == "CreateAction"]
    assert len({one["result"]["@id"] for one in actions}) == 4
    agents = [entities[one["agent"]["@id"]]["name"] for one in actions]
    assert sorted(set(agents)) == ["Ada <not an address>", "Öse, B.", "李"]
    assert "erster Lauf.nc" in archive.namelist()
    assert "erster%20Lauf.nc" in entities


def test_the_tables_say_what_runs_and_fits_say(folder: Path, tmp_path: Path) -> None:
    export_crate(folder, tmp_path / "crate.zip", title="A strip", licence="CC-BY-4.0")
    archive, _ = opened(tmp_path / "crate.zip")

    def rows(name: str) -> list[dict[str, str]]:
        return list(csv.DictReader(io.StringIO(archive.read(f"tables/{name}.csv").decode())))

    run = read_run(folder / "step.nc")
    (row,) = [one for one in rows("runs") if one["file"] == "step.nc"]
    assert row["content_sha256"] == run.content_sha256
    assert (row["sample"], float(row["temperature (degC)"]), int(row["rows"])) == ("strip 1", 20.0, len(run))
    assert float(row["duration (s)"]) == pytest.approx(run.time[-1] - run.time[0])
    said = ("signal", "origin", "recorded_at", "operator", "mounting")
    assert [row[name] for name in said] == [*(getattr(run.metadata, name) for name in said[:4]), "strip-1-a"]
    (parameter,) = rows("parameters")
    found = read_fit(folder / "fit.toml").parameters[parameter["parameter"]]
    assert float(parameter["value (SI)"]) == found.value
    assert {one["file"] for one in rows("metrics")} == {"step.nc", "more/sine.nc"}


def test_the_same_folder_gives_the_same_bytes_and_a_crate_a_crate(folder: Path, tmp_path: Path) -> None:
    for name in ("one.zip", "other.zip"):
        export_crate(folder, tmp_path / name, title="A strip", licence="CC-BY-4.0")
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "other.zip").read_bytes()
    zipfile.ZipFile(tmp_path / "one.zip").extractall(tmp_path / "back")
    export_crate(tmp_path / "back", tmp_path / "again.zip", title="A strip", licence="CC-BY-4.0")
    sums = [zipfile.ZipFile(tmp_path / name).read("manifest-sha256.txt") for name in ("one.zip", "again.zip")]
    assert sums[0] == sums[1]


@pytest.mark.parametrize("name", [b"gr\xf6sse.md", b"two\nlines.md", b"back\\slash.md", b"in\\side/notes.md"])
def test_a_name_that_other_computers_cannot_hold_is_refused(tmp_path: Path, name: bytes) -> None:
    """Bytes that are no text were a UnicodeEncodeError, and a checksum of two lines checks nothing."""
    path = os.path.join(os.fsencode(tmp_path), b"runs", name)
    os.makedirs(os.path.dirname(path))
    try:
        with open(path, "w", encoding="utf-8"):
            pass
    except OSError:
        pytest.skip("this file system has no such name")
    with pytest.raises(InputError, match="other computers cannot hold a file with the name"):
        export_crate(tmp_path / "runs", tmp_path / "crate.zip", title="Names", licence="CC-BY-4.0")


def test_no_file_is_lost_to_a_crate(folder: Path, tmp_path: Path) -> None:
    """A link that is called like a crate may lead to a run: it was left out, and written over."""
    place = tmp_path / "runs"
    place.mkdir()
    run = (folder / "step.nc").read_bytes()
    (place / "step.nc").write_bytes(run)
    (tmp_path / "crate.zip").symlink_to(place / "step.nc")
    with pytest.raises(InputError, match="exists already"):  # before anything is read
        export_crate(tmp_path / "no such folder", tmp_path / "crate.zip", title="A strip", licence="CC-BY-4.0")
    with pytest.raises(InputError, match="which is read here"):
        export_crate(place, tmp_path / "crate.zip", title="A strip", licence="CC-BY-4.0", overwrite=True)
    assert (place / "step.nc").read_bytes() == run


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"licence": "CC-BY"}, "no licence is called 'CC-BY' here"),
        ({"people": ["<0000>"]}, "is not the name of a person"),
        ({"people": ["Ada <https://example.org>"]}, "is not the name of a person"),
        ({"people": ["Ada <0000-0002-1825-0079>"]}, "0000-0002-1825-0079 is no ORCID, one of its digits is wrong"),
        ({"people": ["Ada <https://example.org/0000-0002-1825-0097>"]}, "is not the name of a person"),
        ({"organisation": "Example <1234-5678>"}, "not the name of an organisation.*'Example University <https:"),
        ({"title": " "}, "the title is empty"),
    ],
)
def test_what_is_refused(folder: Path, tmp_path: Path, asked: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        export_crate(folder, tmp_path / "crate.zip", **{"title": "A strip", "licence": "CC-BY-4.0", **asked})
    assert re.search(message, f"{caught.value.message}; {caught.value.repair}")
    assert not list(tmp_path.iterdir())
    # What the message asks for is taken.
    if caught.value.code == "bad-name":
        told = caught.value.repair.split("'")[1].replace("...", "example")
        asked = {name: [told] if isinstance(value, list) else told for name, value in asked.items()}
        export_crate(folder, tmp_path / "crate.zip", title="A strip", licence="CC-BY-4.0", **asked)


def test_nobody_chooses_the_licence_but_who_publishes(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from ipmclab.cli.app import run

    assert run(["export", str(folder), "--to", "ro-crate", "--out", str(tmp_path / "crate.zip")]) == 2
    assert "--licence: no licence is given; add the licence under which" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_places_that_are_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for given, path, message in (
        (tmp_path / "none", tmp_path / "crate.zip", "there is no such folder"),
        (tmp_path / "empty", tmp_path / "crate.zip", "there is no run, fit, table or report"),
        (folder, tmp_path / "crate.tar", "an RO-Crate is written as a zip file"),
        (folder, Path(), "this is a folder; name a file in it"),
    ):
        with pytest.raises(InputError, match=message):
            export_crate(given, path, title="A strip", licence="CC-BY-4.0")


def test_at_the_command_line(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from ipmclab.cli.app import run

    words = ["export", str(folder), "--to", "ro-crate", "--out", str(tmp_path / "crate.zip"), "--person", ADA]
    words += ["--licence", "CC-BY-4.0"]
    assert run([*words, "--title", "A strip", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert "step.nc" in document["files"]
    assert run(words) == 2
    assert "the file exists already" in capsys.readouterr().err


def test_a_table_of_other_runs_is_not_published_as_theirs(folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "runs"
    (place / "tables").mkdir(parents=True)
    (place / "step.nc").write_bytes((folder / "step.nc").read_bytes())
    (place / "tables" / "runs.csv").write_text("run\nanother\n")
    with pytest.raises(InputError, match="not that of the runs in its folder"):
        export_crate(place, tmp_path / "crate.zip", title="Steps", licence="CC-BY-4.0")


def test_it_is_made_where_it_goes_and_nothing_else_is_left_there(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder of the system for temporary files may be too small for it, or on another disk."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    (tmp_path / "here").mkdir()
    export_crate(folder, tmp_path / "here" / "crate.zip", title="Here", licence="CC-BY-4.0")
    assert [one.name for one in (tmp_path / "here").iterdir()] == ["crate.zip"]
