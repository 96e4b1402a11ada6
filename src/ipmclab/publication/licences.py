"""Licences that data are given, by their SPDX names."""

from __future__ import annotations

from typing import Final

from ipmclab.errors import InputError, suggest

LICENCES: Final = {
    "CC0-1.0": ("https://creativecommons.org/publicdomain/zero/1.0/", "CC0 1.0 Universal"),
    "CC-BY-4.0": ("https://creativecommons.org/licenses/by/4.0/", "Creative Commons Attribution 4.0 International"),
    "CC-BY-SA-4.0": (
        "https://creativecommons.org/licenses/by-sa/4.0/",
        "Creative Commons Attribution Share Alike 4.0 International",
    ),
    "CC-BY-NC-4.0": (
        "https://creativecommons.org/licenses/by-nc/4.0/",
        "Creative Commons Attribution Non Commercial 4.0 International",
    ),
    "ODC-By-1.0": ("https://opendatacommons.org/licenses/by/1-0/", "Open Data Commons Attribution License 1.0"),
    "ODbL-1.0": ("https://opendatacommons.org/licenses/odbl/1-0/", "Open Data Commons Open Database License 1.0"),
    "PDDL-1.0": ("https://opendatacommons.org/licenses/pddl/1-0/", "Open Data Commons Public Domain Dedication 1.0"),
    "MIT": ("https://spdx.org/licenses/MIT.html", "MIT License"),
}
"""Address and name of each."""


def licence_of(text: str) -> tuple[str, str]:
    """Address and name of a licence that is given by its SPDX name or its address.

    Raises
    ------
    InputError
        Neither.

    Examples
    --------
    >>> licence_of("CC0-1.0")[0]
    'https://creativecommons.org/publicdomain/zero/1.0/'
    """
    if text.startswith(("https://", "http://")):
        return text, text
    if text not in LICENCES:
        raise InputError(
            f"no licence is called {text!r} here",
            code="unknown-licence",
            where="licence",
            repair=f"{suggest(text, LICENCES)}; or give the address of its text",
        )
    return LICENCES[text]
