"""What is known of a sample from its earlier runs in a laboratory folder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from ipmclab.rig.experiments.fingerprint import Fingerprint
from ipmclab.store.catalogue.catalogue import Catalogue, RunQuery, safely
from ipmclab.store.journal.laboratory import Laboratory

_MOST: Final = 20
"""Fingerprints that are looked at, the newest ones: a strip ages."""


PATIENCE: Final = 1.0
"""How long [s] a run waits for the catalogue: the sweep after it catches up from the files."""


@dataclass(frozen=True)
class Earlier:
    """What earlier runs show of a sample.

    Parameters
    ----------
    fingerprints : tuple of Fingerprint
        Oldest first.
    mounting_id : str, optional
        Of its last run.
    """

    fingerprints: tuple[Fingerprint, ...] = ()
    mounting_id: str | None = None


def earlier_runs(laboratory: Laboratory, sample: str) -> Earlier:
    """What the catalogue knows of a sample; nothing where the catalogue cannot be asked."""
    found: dict[str, Any] = {}

    def look() -> None:
        catalogue = Catalogue(laboratory.root, patience=PATIENCE)
        rows = catalogue.query(RunQuery(sample=sample))
        found["mounting"] = next((row.mounting for row in reversed(rows) if row.mounting), None)
        taken = [row for row in rows if row.purpose == "fingerprint" and row.state == "complete"][-_MOST:]
        findings = catalogue.findings(taken)
        found["fingerprints"] = tuple(
            fingerprint for row in taken if (fingerprint := _fingerprint(findings.get(row.id, ()))) is not None
        )

    safely(look)
    return Earlier(found.get("fingerprints", ()), found.get("mounting"))


def _fingerprint(findings: Any) -> Fingerprint | None:
    for finding in findings:
        if finding.code == "fingerprint":
            numbers = finding.values
            try:
                return Fingerprint(
                    series_resistance=float(numbers["series_resistance"]),
                    capacitance=float(numbers["capacitance"]),
                    drift=float(numbers["drift"]),
                    drift_of=str(numbers["drift_of"]),
                    drift_uncertainty=float(numbers["drift_uncertainty"]),
                )
            except (KeyError, TypeError, ValueError):
                return None
    return None
