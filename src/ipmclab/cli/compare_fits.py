"""``ipmclab compare`` of fits: the parameters of several strips side by side, and what the next strip will have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ipmclab.cli.output import print_json, print_paragraph, print_table, progress, significant
from ipmclab.errors import InputError

if TYPE_CHECKING:
    from ipmclab.comparison.fits import ParameterOfStrips
    from ipmclab.units import Quantity


def compare_fits_of(paths: Sequence[Path], others: Sequence[object], *, posterior: bool, as_json: bool) -> None:
    """Compare fits, and print what the next strip will have.

    Parameters
    ----------
    paths : sequence of Path
    others : sequence of object
        Options that only runs have: none may be given.
    posterior, as_json : bool
    """
    from ipmclab import read_fit
    from ipmclab.comparison.fits import compare_fits

    if any(path.suffix != ".toml" for path in paths) or any(others):
        raise InputError(
            "fits (.toml) are compared by themselves, with --posterior and --json alone",
            code="usage",
            where="compare",
            repair="give fits, or runs (.nc) and folders of them",
        )
    with progress("comparing fits"):
        fits = [read_fit(path) for path in paths]
        found = compare_fits(fits, posterior=posterior)
    if as_json:
        print_json({"fits": paths, "parameters": [asdict(one) for one in found]})
        return
    known = {name: one.quantity for fit in fits for name, one in fit.actuator.parameters().items()}
    _print(found, known)


def _print(found: Sequence[ParameterOfStrips], known: dict[str, Quantity]) -> None:
    sampled = any(one.sampled for one in found)
    rows = []
    for one in found:
        factor = known[one.name].to_display(1.0)
        size = f"factor {significant(math.exp(one.between), 3)}" if one.is_log else significant(factor * one.between, 3)
        posterior = None if one.sampled is None else one.sampled.next_strip
        rows.append(
            [
                one.name,
                str(len(one.strips)),
                significant(factor * one.typical, 4),
                size,
                f"{one.p_value:.2g}",
                _ends(one.next_strip, factor),
                *([_ends(posterior, factor)] if sampled else []),
                known[one.name].display_unit,
            ]
        )
    by = ["95 % of strips", *(["by the posterior"] if sampled else [])]
    print_table(["parameter", "strips", "typical", "between strips", "p (alike)", *by, "unit"], rows)
    if any(one.next_strip is None for one in found):
        print_paragraph("The next strip is estimated where three strips or more determine a parameter.")
    agreed = [one.sampled.convergence for one in found if one.sampled is not None]
    if agreed:
        worst, least = max(one.r_hat for one in agreed), min(min(one.bulk, one.tail) for one in agreed)
        print_paragraph(f"The chains agree: R-hat is at most {worst:.4f}, with {least:.0f} effective samples or more.")


def _ends(ends: tuple[float, float] | None, factor: float) -> str:
    return "not known" if ends is None else " to ".join(significant(factor * end, 3) for end in ends)
