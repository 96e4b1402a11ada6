"""Published facts that ipmclab compares itself with.

``published_measurements.csv`` and ``published_samples.csv`` hold what chapter 5 of
P. J. Friend's thesis, "Modelling and experimental characterization of an ionic polymer
metal composite actuator", states in words about its seven samples: peak currents,
steady currents, largest displacements and forces, masses and platings. Of a figure whose numbers are in
no sentence it holds what is said of it (``published_in_words``): the curves themselves are not at hand.

``measured_parameters.csv`` and ``measured_contacts.csv`` say where the parameters of the library's
``friend-1-measured`` and its neighbours come from; ``python -m benchmarks.published --write`` makes them.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from importlib.resources import files
from typing import Final, Literal

from ipmclab.sample import Sample
from ipmclab.units import Quantity, parse_quantity

SOURCE: Final = (
    'P. J. Friend, "Modelling and experimental characterization of an ionic polymer metal composite '
    'actuator", chapter 5'
)


@dataclass(frozen=True)
class PublishedMeasurement:
    """One number that the thesis states about one run.

    Parameters
    ----------
    sample : int
        The thesis's number of the sample, 1 to 7.
    figure : str
        The figure that shows the run.
    measured : "displacement" or "force"
        What was measured in addition to the current.
    waveform : "step", "sine" or "square"
    amplitude : float [V]
    frequency : float [Hz], optional
        None for a step.
    conditions : str
        ``"room"``, or temperature and relative humidity.
    metric : str
        For example ``"peak_current"``.
    number : str
        The number with its unit, as published.
    qualifier : "stated" or "lower_bound"
        ``lower_bound`` where the instrument probably clipped.
    """

    sample: int
    figure: str
    measured: str
    waveform: str
    amplitude: float
    frequency: float | None
    conditions: str
    metric: str
    number: str
    qualifier: Literal["stated", "lower_bound"]

    def value(self, quantity: Quantity) -> float:
        """The number in the SI unit of a quantity."""
        return parse_quantity(self.number, quantity, where=f"{SOURCE}, figure {self.figure}")


def published_measurements(sample: int, *, conditions: str = "room") -> tuple[PublishedMeasurement, ...]:
    """The runs with one amplitude, of which the thesis states a number.

    Parameters
    ----------
    sample : int
        The thesis's number of the sample, 1 to 7.
    conditions : str
        ``"room"``, or for example ``"20 degC, 80 %RH"``.

    Examples
    --------
    >>> [row.number for row in published_measurements(2) if row.figure == "5.18"]
    ['1.3 mN', '67.01 mA', '7 mA']
    """
    rows = []
    for row in _table("published_measurements.csv"):
        where = _conditions(row)
        qualifier = row["qualifier"]
        if row["sample"] != str(sample) or where != conditions or qualifier not in ("stated", "lower_bound"):
            continue
        rows.append(
            PublishedMeasurement(
                sample=sample,
                figure=row["figure"],
                measured=row["measured"],
                waveform=row["waveform"],
                amplitude=float(row["amplitude_V"]),
                frequency=float(row["frequency_Hz"]) if row["frequency_Hz"] else None,
                conditions=where,
                metric=row["metric"],
                number=f"{row['value']} {row['unit']}",
                qualifier="stated" if qualifier == "stated" else "lower_bound",
            )
        )
    return tuple(rows)


@dataclass(frozen=True)
class PublishedInWords:
    """A figure of chapter 5 of which the text gives no exact number.

    Parameters
    ----------
    figure : str
        Empty where the text speaks of a run that no figure shows.
    samples : tuple of int
        The thesis's numbers of the samples.
    measured : str
        ``"displacement"`` or ``"force"``.
    signal : str
        Such as ``"sine 1 V 0.1 Hz"``; ``"no voltage"``; empty where the text does not say it.
    conditions : str
        ``"room"``, temperature and relative humidity; empty where the text does not say them.
    metric : str
    number : str, optional
        With its unit, where the text has about one.
    qualifier : str
        ``"figure_only"``, ``"approximate"`` or ``"below_noise"``.
    words : str
        What the text says of it.
    """

    figure: str
    samples: tuple[int, ...]
    measured: str
    signal: str
    conditions: str
    metric: str
    number: str | None
    qualifier: str
    words: str


def published_in_words(metric: str | None = None) -> tuple[PublishedInWords, ...]:
    """What chapter 5 shows in a figure, or says in words, without an exact number.

    Parameters
    ----------
    metric : str, optional
        Only these, for example ``"baseline_drift"``.

    Examples
    --------
    >>> [(row.samples, row.conditions, row.number) for row in published_in_words("baseline_drift") if row.number]
    [((5,), 'room', '2 mm')]
    """
    return tuple(
        PublishedInWords(
            figure=row["figure"],
            samples=tuple(int(number) for number in row["sample"].split(";")),
            measured=row["measured"],
            signal=_signal(row),
            conditions=_conditions(row),
            metric=row["metric"],
            number=f"{row['value']} {row['unit']}" if row["value"] else None,
            qualifier=row["qualifier"],
            words=row["note"],
        )
        for row in _table("published_measurements.csv")
        if row["qualifier"] not in ("stated", "lower_bound") and metric in (None, row["metric"])
    )


def _signal(row: dict[str, str]) -> str:
    if row["waveform"] in ("", "none"):
        return "no voltage" if row["waveform"] else ""
    return f"{row['waveform']} {row['amplitude_V']} V" + (f" {row['frequency_Hz']} Hz" if row["frequency_Hz"] else "")


def _conditions(row: dict[str, str]) -> str:
    temperature, humidity = row["temperature_C"], row["relative_humidity_pct"]
    if temperature in ("", "room"):
        return temperature
    return f"{temperature} degC, {humidity} %RH"


def published_sample(number: int) -> Sample:
    """What the thesis says about the strip itself.

    Parameters
    ----------
    number : int
        The thesis's number of the sample, 1 to 7.

    Examples
    --------
    >>> published_sample(2).hydrated_mass
    0.000113
    """
    (row,) = (row for row in _table("published_samples.csv") if row["sample"] == str(number))
    return Sample.from_table(
        {
            "id": f"friend-{number}",
            "membrane": row["membrane"],
            "electrode": "platinum",
            "plating_loading": f"{row['platinum_loading_mg_per_cm2']} mg/cm^2",
            "dry_mass": f"{row['dry_mass_mg']} mg",
            "hydrated_mass": f"{row['hydrated_mass_mg']} mg",
            "source": SOURCE,
        }
        | ({"plated_by": row["plated_by"]} if row["plated_by"] else {})
        # In deionized water. Of sample 2 the text does not say how long.
        | ({"solvent": "water", "soak_time": f"{row['soak_h']} h"} if row["soak_h"] else {})
    )


@dataclass(frozen=True)
class ParameterSource:
    """Where one parameter of a strip in the library comes from.

    Parameters
    ----------
    name : str
        Dotted name.
    role : str
        ``"stated"`` in the thesis, ``"computed"`` from what is stated, ``"assumed"``, ``"determined"`` by the printed
        numbers, or ``"free"``: the numbers hardly narrow what was taken before.
    usual : float [SI], optional
        What was taken before any number, for a parameter that was searched for.
    usual_factor, factor : float, optional
        One standard deviation before and with the numbers, as factors above 1.
    reason : str
        The numbers that determine it, or why it has its value.
    """

    name: str
    role: str
    usual: float | None
    usual_factor: float | None
    factor: float | None
    reason: str


def measured_names() -> tuple[str, ...]:
    """Names of the library's strips that were identified from printed numbers.

    Examples
    --------
    >>> measured_names()[:2]
    ('friend-1-measured', 'friend-2-measured-displacement')
    """
    return tuple(sorted({row["actuator"] for row in _table("measured_contacts.csv")}))


def measured_contacts(actuator: str) -> dict[str, float]:
    """The contact resistance [ohm] of each run, by figure, with which a strip gives its printed numbers.

    Examples
    --------
    >>> sorted(measured_contacts("friend-6-measured"))
    ['5.54', '5.55', '5.56']
    """
    rows = [row for row in _table("measured_contacts.csv") if row["actuator"] == actuator]
    return {row["figure"]: float(row["contact_resistance_ohm"]) for row in rows}


def measured_parameters(actuator: str) -> tuple[ParameterSource, ...]:
    """Where each parameter of a strip that was identified from printed numbers comes from.

    Examples
    --------
    >>> {source.role for source in measured_parameters("friend-6-measured")} >= {"stated", "free", "determined"}
    True
    """

    def number(text: str) -> float | None:
        return float(text) if text else None

    return tuple(
        ParameterSource(
            row["parameter"],
            row["role"],
            number(row["usual_si"]),
            number(row["usual_factor"]),
            number(row["factor"]),
            row["reason"],
        )
        for row in _table("measured_parameters.csv")
        if row["actuator"] == actuator
    )


def _table(name: str) -> list[dict[str, str]]:
    text = (files("ipmclab.data") / name).read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines()))
