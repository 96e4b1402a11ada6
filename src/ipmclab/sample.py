"""A sample: one strip, and what it is made of."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, fields
from typing import Any, Final

from ipmclab.errors import InputError, unknown_name
from ipmclab.units import AREAL_MASS, LENGTH, MASS, TIME, Quantity, format_quantity, parse_quantity

_QUANTITIES: Final[dict[str, Quantity]] = {
    "nominal_membrane_thickness": LENGTH,
    "plating_loading": AREAL_MASS,
    "dry_mass": MASS,
    "hydrated_mass": MASS,
    "soak_time": TIME,
    "electrode_thickness": LENGTH,
}
_LISTS: Final = ("micrographs",)
"""Keys with several texts: a list in a TOML file, and one text with ``;`` in between wherever a sample is kept."""


_BETWEEN: Final = "; "

_WATER: Final = re.compile(r"water|aqueous|[hd]2o", re.IGNORECASE)
"""What a solvent with water in it is called by."""

_NO_WATER: Final = re.compile(
    r"ionic liquid|imidazolium|pyrrolidinium|[eb]mim?\b|tfsi|triflate|bf4|pf6|"
    r"glycol|glycerol|(?:prop|eth)ylene carbonate|dmso|formamide|\w+anol\b|crown ether",
    re.IGNORECASE,
)
"""What solvents without it are called by; of any other name nobody knows."""


@dataclass(frozen=True)
class Sample:
    """One strip: its id, membrane, plating and chemistry. Its geometry is in its actuator.

    Parameters
    ----------
    id : str
        What the laboratory calls the strip.
    membrane : str, optional
        For example ``"Nafion N117"``.
    nominal_membrane_thickness : float [m], optional
        Thickness of the membrane by its data sheet.
    electrode : str, optional
        Metal of the electrodes, for example ``"platinum"``.
    plating_loading : float [kg/m^2], optional
        Metal per area of one face.
    plated_by : str, optional
    counter_ion : str, optional
        For example ``"Li+"``.
    solvent : str, optional
        For example ``"water"``.
    coating : str, optional
        For example ``"parylene"``.
    dry_mass, hydrated_mass : float [kg], optional
    soak_time : float [s], optional
        How long the strip lay in its solvent before it was weighed wet and tested.
    electrode_thickness : float [m], optional
        Of one electrode, from a micrograph.
    micrographs : tuple of str
        Files of pictures: surface, cross-section.
    source : str, optional
        Where these facts come from.
    """

    id: str
    membrane: str | None = None
    nominal_membrane_thickness: float | None = None
    electrode: str | None = None
    plating_loading: float | None = None
    plated_by: str | None = None
    counter_ion: str | None = None
    solvent: str | None = None
    coating: str | None = None
    dry_mass: float | None = None
    hydrated_mass: float | None = None
    soak_time: float | None = None
    electrode_thickness: float | None = None
    micrographs: tuple[str, ...] = ()
    source: str | None = None

    @property
    def has_no_water(self) -> bool:
        """Whether its solvent is one that is known to hold no water, as an ionic liquid or a glycol does not.

        Examples
        --------
        >>> [Sample("a", solvent=one).has_no_water for one in ("EMIM-TFSI", "deionised water", "PBS", None)]
        [True, False, False, False]
        """
        name = unicodedata.normalize("NFKC", self.solvent or "")
        return bool(_NO_WATER.search(name)) and not _WATER.search(name)

    @classmethod
    def from_table(cls, table: dict[str, Any], *, where: str = "sample") -> Sample:
        """Read a sample from a ``[sample]`` table whose quantities are texts with units.

        Raises
        ------
        InputError
            For an unknown key, a wrong unit, a value that is no text, or no id.

        Examples
        --------
        >>> Sample.from_table({"id": "strip-1", "dry_mass": "103 mg"}).dry_mass
        0.000103
        """
        known = [field.name for field in fields(cls)]
        values: dict[str, Any] = {}
        for key, value in table.items():
            place = f"{where}.{key}"
            if key not in known:
                raise unknown_name("key", key, known, where=place)
            if key in _LISTS:
                values[key] = _texts(value, place)
                continue
            if not isinstance(value, str):
                raise InputError(
                    f"{value!r} is not a text", code="bad-value", where=place, repair="put it in quotes, with its unit"
                )
            if key not in _QUANTITIES:
                values[key] = value
                continue
            number = parse_quantity(value, _QUANTITIES[key], where=place)
            if not number > 0:
                raise InputError(
                    f"{value!r} is not above 0",
                    code="out-of-range",
                    where=place,
                    repair="give the measured value, or leave it out",
                )
            values[key] = number
        if not values.get("id"):
            raise InputError("a sample needs an id", code="missing-key", where=f"{where}.id", repair='add id = "..."')
        return cls(**values)

    def to_table(self) -> dict[str, str]:
        """The sample as ``from_table`` reads it."""
        table: dict[str, str] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in _LISTS:
                if value:
                    table[field.name] = _BETWEEN.join(value)
            elif value is not None:
                table[field.name] = (
                    format_quantity(value, _QUANTITIES[field.name]) if field.name in _QUANTITIES else value
                )
        return table


def _texts(value: Any, place: str) -> tuple[str, ...]:
    """Several texts, from a list or from one text."""
    given = value.split(";") if isinstance(value, str) else value
    if not isinstance(given, (list, tuple)) or not all(isinstance(one, str) and ";" not in one for one in given):
        raise InputError(
            f"{value!r} is no list of texts",
            code="bad-value",
            where=place,
            repair='write ["surface.png", "section.png"]; a name has no semicolon',
        )
    return tuple(one.strip() for one in given if one.strip())
