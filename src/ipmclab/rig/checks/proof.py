"""The report of ``rig prove``: what the hardware of a rig was found to do, next to the rig file."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Literal

from ipmclab.destination import write_text
from ipmclab.errors import InputError
from ipmclab.rig.channels import Rig, VirtualStrip
from ipmclab.rig.files.text import rig_to_text

Status = Literal["passed", "failed", "noted", "not done"]
"""``noted``: what was found is a fact of this hardware, for which there is no right or wrong."""

WITHIN: Final = 1.0
"""The output is at 0 V so soon [s] after whatever ends the recorder."""

UNPROVEN: Final = "not proven on this hardware"


@dataclass(frozen=True)
class Item:
    """One thing that was tried.

    Parameters
    ----------
    name : str
        Stable name for programs.
    what : str
        What was tried.
    status : Status
    found : str
        What was found, with numbers and units.
    repair : str
        What to do where it failed.
    """

    name: str
    what: str
    status: Status
    found: str
    repair: str = ""


@dataclass(frozen=True)
class Proof:
    """A hardware check list that was gone through.

    Parameters
    ----------
    rig : str
        Name of the rig.
    fingerprint : str
        SHA-256 of what the rig file says of the hardware: see ``rig_fingerprint``.
    date : str
        ISO 8601, with the time zone.
    bench : str
        The bench as a text.
    simulated : bool
        Whether it was a stand-in.
    operator : str
    items : tuple of Item
    software_version : str
    """

    rig: str
    fingerprint: str
    date: str
    bench: str
    simulated: bool
    operator: str
    items: tuple[Item, ...]
    software_version: str

    @property
    def passed(self) -> bool:
        """Whether everything was done, and nothing failed."""
        return bool(self.items) and all(item.status in ("passed", "noted") for item in self.items)


def rig_fingerprint(rig: Rig) -> str:
    """SHA-256 of what a rig file says of the hardware: its wiring, ranges, scales and resistances.

    The address of a server, the line to a chamber, dates of calibration and the virtual strip are no part of it.
    """
    chamber = None if rig.chamber is None else replace(rig.chamber, port=None, address=None, patience=None, table=None)
    channels = tuple(replace(channel, calibrated=None, uncertainty=0.0) for channel in rig.channels)
    plain = replace(rig, name="", channels=channels, address=None, virtual=VirtualStrip(), chamber=chamber)
    return hashlib.sha256(rig_to_text(plain).encode()).hexdigest()


def proof_path(rig_path: str | Path) -> Path:
    """Where the report of a rig file is.

    Examples
    --------
    >>> proof_path("bench/rig.toml").name
    'rig.proof.toml'
    """
    path = Path(rig_path)
    return path.with_name(f"{path.stem}.proof.toml")


def write_proof(proof: Proof, path: Path) -> None:
    """Write a report over the one before.

    Raises
    ------
    IpmclabError
    """
    import tomli_w

    document: dict[str, Any] = {
        "rig": proof.rig,
        "rig_sha256": proof.fingerprint,
        "date": proof.date,
        "passed": proof.passed,
        "bench": proof.bench,
        "simulated": proof.simulated,
        "operator": proof.operator,
        "software_version": proof.software_version,
        "items": [
            {"name": one.name, "what": one.what, "status": one.status, "seen": one.found, "repair": one.repair}
            for one in proof.items
        ],
    }
    write_text(tomli_w.dumps(document), path, overwrite=True)


def read_proof(path: Path) -> Proof:
    """Read a report.

    Raises
    ------
    InputError
        No file, or not a report.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        items = tuple(
            Item(str(one["name"]), str(one["what"]), one["status"], str(one["seen"]), str(one["repair"]))
            for one in document["items"]
        )
        datetime.fromisoformat(document["date"])
        return Proof(
            rig=str(document["rig"]),
            fingerprint=str(document["rig_sha256"]),
            date=str(document["date"]),
            bench=str(document["bench"]),
            simulated=bool(document["simulated"]),
            operator=str(document["operator"]),
            items=items,
            software_version=str(document["software_version"]),
        )
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(
            f"this is no report of rig prove: {error}", code="bad-proof", where=str(path), repair="run rig prove again"
        ) from error


def proof_of(rig: Rig, rig_path: str | Path) -> str:
    """What a run says of the rig that it was recorded on, for ``RunMetadata.rig_proof``.

    Parameters
    ----------
    rig : Rig
    rig_path : str or Path
        Its file, or its name in the library.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> proof_of(THESIS_RIG, "thesis")
    'virtual bench: no hardware to prove'
    """
    if rig.bench == "virtual":
        return "virtual bench: no hardware to prove"
    path = proof_path(rig_path)
    if not path.exists():
        return f"{UNPROVEN}: ipmclab rig prove has not been run"
    try:
        proof = read_proof(path)
    except InputError as error:
        return f"{UNPROVEN}: {error.where}: {error.message}"
    day, name = proof.date[:10], path.name
    if proof.fingerprint != rig_fingerprint(rig):
        return f"{UNPROVEN}: the rig file changed after its proof of {day} ({name})"
    open_items = [item.name for item in proof.items if item.status in ("failed", "not done")]
    if not proof.passed:
        return f"{UNPROVEN}: on {day} it did not pass {', '.join(open_items) or 'anything'} ({name})"
    if proof.simulated:
        return f"{UNPROVEN}: proved against a stand-in on {day} ({name})"
    return f"proved on {day} ({name}, sha256 {hashlib.sha256(path.read_bytes()).hexdigest()[:12]})"
