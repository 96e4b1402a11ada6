"""The library's strips of chapter 5, made from the headline numbers that the thesis prints.

Run ``python -m benchmarks.published`` to see how near each comes, with ``--write`` to write the files of the library
(``model/library/friend-*-measured*.toml``) and the tables beside the published ones (``data/measured_*.csv``), with
``--record`` to write the result. Nothing is random: the same numbers and the same code give the same files.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import ipmclab
from benchmarks.harness import finish
from benchmarks.printed.headline_fit import HeadlineFit, Prior, compare_all, fit_headlines
from benchmarks.printed.measured import table
from benchmarks.printed.passive import linear_one_port
from benchmarks.printed.passive_steps import leaking_one_port, one_strip
from ipmclab.data import ParameterSource, published_sample
from ipmclab.model import Actuator, load_actuator
from ipmclab.model.actuator_file import actuator_to_text
from ipmclab.model.variants import with_stages
from ipmclab.prediction.headline import HeadlineRun, headline_runs
from ipmclab.procedure.two_sets import SCRIPT, read_set, two_sets
from ipmclab.units import Quantity

SOURCES = (
    "src/ipmclab/model",
    "src/ipmclab/identification",
    "src/ipmclab/statespace",
    "src/ipmclab/fit",
    "src/ipmclab/prediction",
    "src/ipmclab/data",
    "benchmarks/printed",
)

N117, N1110 = 0.183e-3, 0.254e-3
"""Nominal thickness of the membranes [m]: 7 and 10 thousandths of an inch."""

THICKNESS_N117 = 0.245e-3
"""Of the plated, wet strip of sample 2 [m] (Friend, appendix A.1)."""

DIGITS = 4
_MODULUS = {"beam.modulus": 1.0}

SOURCE = Path(ipmclab.__file__).parent


@dataclass(frozen=True)
class Case:
    """One file of the library."""

    name: str
    sample: int
    measured: str | None = None
    stages: tuple[str, ...] = ()

    @property
    def runs(self) -> tuple[HeadlineRun, ...]:
        return headline_runs(self.sample, self.measured)

    @property
    def is_thick(self) -> bool:
        return str(published_sample(self.sample).membrane).endswith("N1110")


CASES = (
    Case("friend-1-measured", 1, None, ("leak.exponential",)),
    # The currents of sample 2 cannot be those of one strip, whatever its contacts: see ``one_strip``.
    Case("friend-2-measured-displacement", 2, "displacement", ("clamp",)),
    Case("friend-2-measured-force", 2, "force"),
    Case("friend-3-measured", 3, None, ("leak.exponential",)),
    Case("friend-4-measured", 4, None, ("leak.exponential",)),
    Case("friend-5-measured", 5, None, ("relaxation.force",)),
    Case("friend-6-measured", 6),
    Case("friend-7-measured", 7, None, ("leak.exponential",)),
)

OF_THE_SCRIPT = ("geometry.free_length", "geometry.clamped_length", "geometry.sensing_length")
"""Given in appendix A.1 alone, which is the script of sample 2: its density and modulus are those of Table 4.2."""


def start_of(case: Case) -> Actuator:
    """friend-2 with the sample's membrane and mass, and the stages that its numbers ask for."""
    sample = replace(published_sample(case.sample), nominal_membrane_thickness=N1110 if case.is_thick else N117)
    thickness = round(THICKNESS_N117 * (N1110 / N117 if case.is_thick else 1.0), 6)
    assert sample.hydrated_mass is not None
    density = round(sample.hydrated_mass / (30e-3 * 5e-3 * thickness))
    base = with_stages(load_actuator("friend-2"), *case.stages)
    base = base.replace(**{"geometry.thickness": thickness, "beam.density": density})
    return Actuator(name=case.name, parameter_values=base.parameter_values, sample=sample)


def priors_of(case: Case) -> list[Prior]:
    """Usual values, about those of Tables 4.1 and 4.2, and how far a strip may be from them."""
    priors = [
        Prior("circuit.dc_resistivity", 100.0, 5.0),
        Prior("circuit.branches.0.resistivity", 1.0, 5.0),
        Prior("circuit.branches.0.permittivity", 0.1, 5.0),
        Prior("circuit.branches.1.resistivity", 25.0, 5.0),
        Prior("circuit.branches.1.permittivity", 0.3, 5.0),
        Prior("coupling.gain", 5e-9, 10.0),
        Prior("coupling.p2", 6.0, 3.0),
        Prior("beam.modulus", 5e8, 3.0),
    ]
    if case.sample != 2:  # whose electrodes were measured
        priors.insert(0, Prior("circuit.sheet_resistance", 0.6, 2.0))
    if "leak.exponential" in case.stages:
        priors.append(Prior("leak.exponential.current_density", 30.0, 10.0))
    if "relaxation.force" in case.stages:
        # A slow part of the force that goes along with the fast one, not against it: a ratio below 0.
        priors.append(Prior("relaxation.force.0.ratio", -0.5, 3.0))
        priors.append(Prior("relaxation.force.0.time_constant", 6.0, 2.0))
    return priors


def fit(case: Case) -> HeadlineFit:
    """The strip as its file has it: the search, and what it found rounded to what the file shows."""
    found = fit_headlines(start_of(case), case.runs, priors_of(case))
    free = [prior.name for prior in priors_of(case)]
    values = {name: float(f"{found.actuator[name]:.{DIGITS}g}") for name in free}
    # What is known within a factor, as a standard uncertainty: of first order in the logarithm of the factor.
    spreads = {known.name: math.log(known.spread) for known in found.constraints if known.name in values}
    actuator = replace(
        found.actuator.replace(**values),
        standard_uncertainties={name: float(f"{abs(values[name]) * spreads[name]:.2g}") for name in free},
    )
    contacts = {figure: round(ohms, 2) for figure, ohms in found.contacts.items()}
    return replace(found, actuator=actuator, contacts=contacts, comparisons=compare_all(actuator, case.runs, contacts))


def sources(case: Case, found: HeadlineFit) -> Iterator[ParameterSource]:
    """Where each parameter of the file comes from."""
    constraints = {constraint.name: constraint for constraint in found.constraints}
    usual = {prior.name: prior.usual for prior in priors_of(case)}
    for name in found.actuator.parameter_values:
        if name in constraints:
            known = constraints[name]
            if known.determined:
                role, reason = "determined", ", ".join(known.by) or "several numbers together"
            else:
                role, reason = "free", f"narrowed by {', '.join(known.by)}" if known.by else "no number narrows it"
            yield ParameterSource(name, role, usual[name], known.before, known.spread, reason)
            continue
        role, reason = _fixed(case, name)
        yield ParameterSource(name, role, None, None, None, reason)


def _fixed(case: Case, name: str) -> tuple[str, str]:
    if name in OF_THE_SCRIPT:
        if case.sample == 2:
            return "stated", "appendix A.1"
        return "assumed", "appendix A.1 has it for sample 2; of this one 30 mm x 5 mm are stated"
    if name == "geometry.width":
        return "stated", "section 5.1"
    if name == "circuit.sheet_resistance":
        return "stated", "8 ohm were measured on one electrode, section 5.1.2"
    if name == "beam.density":
        return "computed", "hydrated mass over 30 mm x 5 mm x thickness"
    if name == "geometry.thickness":
        of_2 = "appendix A.1 has 0.245 mm for sample 2"
        return (
            ("stated", of_2)
            if case.sample == 2
            else (
                "assumed",
                f"{of_2}; scaled by the membranes' nominal thickness" if case.is_thick else f"{of_2}, as N117",
            )
        )
    reasons = {
        "circuit.contact_resistance": "each run has its own, in data/measured_contacts.csv",
        "coupling.zero": "Table 4.2",
        "coupling.p1": "Table 4.2; the slow pole is then about p2/p1",
        "beam.damping_ratio": "nothing printed shows the resonance",
        "clamp.direct_share": "the clamped section is fed by the contacts: without it no current passes 62.5 mA",
        "leak.exponential.threshold": "electrolysis of water",
        "leak.exponential.voltage_scale": "one current above the threshold cannot tell a slope",
    }
    return "assumed", reasons[name]


_OTHER_AIR = (
    "# No law of water or temperature is in here: none was found that gives the three numbers at 60, 70 and 80 %RH.",
    "# friend-chapter-5 sets gain and modulus to the number that is printed at each: there nothing is predicted.",
)


def file_text(case: Case, found: HeadlineFit) -> str:
    """The actuator file, with what each parameter comes from beside it."""
    told = {source.name: source for source in sources(case, found)}
    parameters = found.actuator.parameters()
    lines, place, counts = [], "", dict[str, int]()
    for line in actuator_to_text(found.actuator).splitlines():
        if line.startswith("[["):
            array = line.strip("[]")
            counts[array] = counts.get(array, -1) + 1
            place = f"{array}.{counts[array]}"
        elif line.startswith("["):
            place = line.strip("[]")
        source = told.get(f"{place}.{line.partition(' = ')[0]}")
        lines.append(line if source is None else f"{line}  # {_words(source, parameters[source.name].quantity)}")
    state = f", its runs of {case.measured}" if case.measured else ""
    by = {"coupling.gain": 1.0, "coupling.p2": -1.0}
    head = [
        f"# Sample {case.sample} of Friend's thesis, chapter 5{state}: identified from the numbers printed there.",
        "# python -m benchmarks.published --write makes this file; docs/published.md holds it against them.",
        "# x/1.2: known within a factor of 1.2 (one standard deviation, the numbers as uncertain as their tolerance).",
        "# determined: the numbers at least halve (in the logarithm) what was taken before; free: they do not.",
        f"# d(0) = gain zero/p2 is known to x/{found.factor(by):.2f}{_product(case, found, by)}.",
        "# No printed number is of back relaxation, hence none is in here.",
        *(_OTHER_AIR if case.sample == 2 else ()),
        "# Contact resistance of each run [ohm]: "
        + ", ".join(f"{ohms:.2f} in {figure}" for figure, ohms in found.contacts.items()),
        "# What each number constrains: unknowns that would be less certain by a tenth or more without it.",
        *_constrained(found),
    ]
    return "\n".join([*head, *lines]) + "\n"


def _constrained(found: HeadlineFit) -> Iterator[str]:
    for row in found.comparisons:
        label = f"{row.run.figure} {row.run.waveform} {row.metric.replace('_', ' ')}"
        names = [constraint.name for constraint in found.constraints if label in constraint.by]
        number = f"{row.quantity.to_display(row.published):g} {row.quantity.display_unit}"
        bound = "at least " if row.lower_bound else ""
        yield f"#   {label}, {bound}{number}: {', '.join(names) or 'none by itself'}"


def _product(case: Case, found: HeadlineFit, by: dict[str, float]) -> str:
    if not any(row.metric == "max_force" for run in case.runs for row in run.numbers):
        return "; no force was printed, the modulus is free"
    return f", d(0) times the modulus, to which the force is proportional, to x/{found.factor(by | _MODULUS):.2f}"


def _words(source: ParameterSource, quantity: Quantity) -> str:
    if source.usual is None or source.factor is None or source.usual_factor is None:
        return f"{source.role}: {source.reason}"
    before = f"{quantity.to_display(source.usual):.4g} {quantity.display_unit}".strip()
    return f"{source.role}, x/{source.factor:.2f} (before: {before} x/{source.usual_factor:g}): {source.reason}"


def tables(found: Sequence[tuple[Case, HeadlineFit]]) -> dict[str, str]:
    """The two tables of ``data/`` as text."""
    parameters, contacts = io.StringIO(), io.StringIO()
    of_parameters = csv.writer(parameters, lineterminator="\n")
    of_contacts = csv.writer(contacts, lineterminator="\n")
    of_parameters.writerow(["actuator", "parameter", "role", "usual_si", "usual_factor", "factor", "reason"])
    of_contacts.writerow(["actuator", "figure", "contact_resistance_ohm", "standard_uncertainty_ohm"])
    for case, fitted in found:
        for source in sources(case, fitted):
            numbers = (source.usual, source.usual_factor, source.factor)
            texts = ["" if number is None else f"{number:.3g}" for number in numbers]
            of_parameters.writerow([case.name, source.name, source.role, *texts, source.reason])
        spreads = {constraint.name: constraint.spread for constraint in fitted.constraints}
        for figure, ohms in fitted.contacts.items():
            spread = spreads[f"circuit.contact_resistance[{figure}]"]
            of_contacts.writerow([case.name, figure, f"{ohms:.2f}", f"{spread:.1f}"])
    return {"measured_parameters.csv": parameters.getvalue(), "measured_contacts.csv": contacts.getvalue()}


def impossible() -> Iterator[str]:
    """Every set of runs of one sample whose currents no model of a class can join within their tolerances."""
    yield "| sample | figures | class of models | smallest possible error | within the tolerances |"
    yield "|---|---|---|---|---|"
    for sample in range(1, 8):
        found = []
        for measured in ("displacement", "force"):
            runs = [run for run in headline_runs(sample, measured) if run.amplitude == 1.0]
            for size in range(2, len(runs) + 1):
                found += [("linear", linear_one_port(chosen)) for chosen in combinations(runs, size)]
        steps = [run for run in headline_runs(sample) if run.waveform == "step"]
        low, high = ([run for run in steps if run.amplitude == amplitude] for amplitude in (1.0, 3.0))
        found += [("series resistance and leak", leaking_one_port(one, other)) for one in low for other in high]
        if len(low) > 1:
            found.append(("linear, contact free", one_strip(low)))
        for name, joined in found:
            figures = ", ".join(f"{run.figure} {run.waveform} {run.amplitude:g} V" for run in joined.runs)
            verdict = "yes" if joined.possible else "**no**"
            yield f"| {sample} | {figures} | {name} | {100 * joined.error:.1f} % | {verdict} |"


def both_sets() -> Iterator[str]:
    """Sample 2 by the tables of the thesis and by its script, against what its runs gave at 1 V."""
    tables, script, soft = two_sets()
    whole = read_set(load_actuator(SCRIPT))
    yield "| numbers | d(0) [nm/V] | modulus [MPa] | step [mm] | sine [mm] | step [mN] | square [mN] |"
    yield "|---|---|---|---|---|---|---|"
    yield "| measured | | | 3.7 | 1.43 | 1.3 | 1.2 |"
    for name, one in (
        ("Tables 4.1 and 4.2", tables),
        ("the script's d(s) on the circuit of Table 4.1", script),
        ("the same with the modulus of the script's comment", soft),
        ("the script", whole),
    ):
        numbers = [1e9 * one.dc_coupling, 1e-6 * one.modulus, 1e3 * one.displacement, 1e3 * one.sine]
        numbers += [1e3 * one.force, 1e3 * one.square_force]
        yield f"| {name} | {' | '.join(f'{number:.3g}' for number in numbers)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="a part of the name")
    parser.add_argument("--write", action="store_true", help="write the library's files and the tables of data/")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/published.md")
    options = parser.parse_args()
    began = time.perf_counter()
    found = []
    for case in CASES:
        if options.only in case.name:
            found.append((case, fit(case)))
            print(f"{case.name}\n{table(found[-1][1].comparisons, found[-1][1].contacts)}", flush=True)
    if options.only:
        return
    if options.write:
        for case, fitted in found:
            path = SOURCE / "model" / "library" / f"{case.name}.toml"
            path.write_text(file_text(case, fitted), encoding="utf-8", newline="\n")
        for name, text in tables(found).items():
            (SOURCE / "data" / name).write_text(text, encoding="utf-8", newline="\n")
    seconds = time.perf_counter() - began
    parts = ["## Published against model", ""]
    for case, fitted in found:
        outside = sum(not row.agrees for row in fitted.comparisons)
        parts += [
            f"`{case.name}`: {len(fitted.comparisons)} numbers, {outside} outside their tolerance.",
            f"\n```text\n{table(fitted.comparisons, fitted.contacts)}\n```\n",
        ]
    parts += [
        "## Currents of one sample in one state",
        "",
        *impossible(),
        "",
        "## Two sets of sample 2",
        "",
        "Steps up to 5 s.",
        "",
        *both_sets(),
        "",
        f"The eight searches took {seconds:.0f} s.",
    ]
    finish("published", "The strips of chapter 5", "\n".join(parts), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
