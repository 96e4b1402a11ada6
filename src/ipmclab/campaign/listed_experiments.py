"""The experiments that a campaign file lists, each with its samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from ipmclab.campaign.campaign import ROOM, Part, Strip
from ipmclab.errors import InputError, missing_key, suggest
from ipmclab.rig.experiments.experiment import Experiment
from ipmclab.rig.experiments.experiment_file import experiment_from_table
from ipmclab.toml_file import parse_table, read_text

OF_THE_CAMPAIGN: Final = ("sample", "actuator", "rig", "folder", "title", "mounting_id")
"""Keys of an experiment file that a campaign states for all of its experiments, or makes."""


def part_of(
    table: Mapping[str, Any], at: int, method: Mapping[str, Any], strips: Sequence[Strip], folder: Path
) -> Part:
    """An experiment with its samples: what it states, over its file, over what the campaign states for all.

    Parameters
    ----------
    table : mapping
        Its table in the campaign file.
    at : int
        Its place among them.
    method : mapping
        Keys that all experiments share.
    strips : sequence of Strip
        Those of the campaign.
    folder : Path
        Of the campaign file.

    Raises
    ------
    InputError
        Its ``where`` is a key of the campaign file.
    """
    place = f"experiments.{at}"
    own = dict(table)
    name, wanted, file = (own.pop(key, None) for key in ("name", "samples", "file"))
    if not isinstance(name, str) or not name.strip() or "/" in name:
        raise InputError(
            "an experiment of a campaign needs a name without '/'",
            code="missing-key",
            where=f"{place}.name" if name is not None else place,
            repair='add name = "displacement"',
        )
    _refuse_campaign_keys(own, place)
    _refuse_campaign_keys(method, "method")
    from_file = {} if file is None else _of_file(folder / str(file), f"{place}.file")
    keys = _merged(method, from_file, own)
    experiments = {}
    for strip in strips if wanted is None else _named(wanted, strips, f"{place}.samples"):
        experiments[strip.sample.id] = _experiment(keys, strip, folder, place, set(method) - set(own))
    return Part(name, experiments)


def _merged(*tables: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of an experiment, each table over those before it: limits and environment key by key."""
    keys = {name: value for table in tables for name, value in table.items()}
    for name in ("limits", "environment"):
        found = [table[name] for table in tables if name in table]
        if found and all(isinstance(one, dict) for one in found):
            keys[name] = {key: value for one in found for key, value in one.items()}
    if keys.get("environment") == ROOM:
        del keys["environment"]
    for one, other in (("signal", "signals"), ("signals", "signal")):
        if one in tables[-1] and other not in tables[-1]:
            keys.pop(other, None)
    return keys


def _experiment(keys: Mapping[str, Any], strip: Strip, folder: Path, place: str, shared: set[str]) -> Experiment:
    """The experiment of one strip; a mistake in a key that all experiments share is reported for the shared table."""
    table = {**keys, "sample": strip.sample.id}
    if strip.actuator is not None:
        table["actuator"] = strip.actuator
    for key, why in (("rate", "50 Hz"), ("duration", "40 s")):
        if key not in table:
            raise missing_key(place, f'add {key} = "{why}", here or in [method]')
    try:
        experiment = experiment_from_table(table, folder=folder, where="", name=place)
    except InputError as error:
        inside = error.where.removeprefix(":").strip()
        at = "method" if inside.partition(".")[0] in shared else place
        raise error.at(f"{at}.{inside}".strip(".")) from error
    return replace(experiment, sample=strip.sample, where=place)


def _refuse_campaign_keys(table: Mapping[str, Any], place: str) -> None:
    for key in OF_THE_CAMPAIGN:
        if key in table:
            raise InputError(
                f"{key!r} is the campaign's, not an experiment's",
                code="needless-key",
                where=f"{place}.{key}",
                repair="state it for the campaign, or in [[samples]]",
            )


def _of_file(path: Path, place: str) -> dict[str, Any]:
    """What an experiment file states, without what the campaign states for all."""
    missing = InputError(
        f"there is no experiment file {str(path)!r}",
        code="no-such-file",
        where=place,
        repair="name an experiment file in the folder of the campaign file",
    )
    table = parse_table(read_text(path, kind="an experiment", missing=missing), where=str(path))
    return {key: value for key, value in table.items() if key not in OF_THE_CAMPAIGN}


def _named(wanted: Any, strips: Sequence[Strip], place: str) -> list[Strip]:
    known = {strip.sample.id: strip for strip in strips}
    if not isinstance(wanted, list) or not wanted:
        raise InputError(
            "this is not a list of sample ids", code="bad-value", where=place, repair='write ["strip-1", "strip-2"]'
        )
    for at, id_ in enumerate(wanted):
        if not isinstance(id_, str) or id_ not in known:
            raise InputError(
                f"no sample {id_!r} is listed",
                code="unknown-sample",
                where=f"{place}.{at}",
                repair=suggest(str(id_), known),
            )
    return [known[id_] for id_ in dict.fromkeys(wanted)]
