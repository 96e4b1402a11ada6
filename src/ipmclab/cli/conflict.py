"""What the demo finds: which published numbers the thesis's tables reproduce, which not, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ipmclab.cli.output import read
from ipmclab.cli.published import Comparison
from ipmclab.data import published_measurements
from ipmclab.model import Actuator
from ipmclab.prediction.headline import BACK_RELAXATION_FROM, DURATION
from ipmclab.procedure.two_sets import two_sets
from ipmclab.units import CURRENT, FORCE, LENGTH, MASS, MODULUS

STEP_VOLTAGE: Final = 1.0
"""Of the thesis's runs [V]."""


def finding(actuator: Actuator, comparisons: Sequence[Comparison], *, hydrated_mass: float) -> tuple[str, ...]:
    """What a comparison with the thesis says, in plain words.

    Parameters
    ----------
    actuator : Actuator
        The model that was compared.
    comparisons : sequence of Comparison
        From ``compare_with_thesis``.
    hydrated_mass : float [kg]
        Of the strip, as weighed.

    Returns
    -------
    paragraphs : tuple of str
        What agrees; what does not; why; what the other set of the thesis, that of its script, gives.
    """
    found = {(row.measured, row.name): row for row in comparisons}
    return (_agreement(comparisons), _disagreement(found), _reason(actuator, found, hydrated_mass), _other_set())


def _agreement(comparisons: Sequence[Comparison]) -> str:
    early = [row for row in comparisons if row.measured == "force" and row.agrees]
    percent = max(abs(row.difference) for row in early) * 100.0
    listed = ", ".join(f"{row.name} {row.against}" for row in early)
    return f"The thesis's tables reproduce the early part of its force runs within {percent:.0f} %: {listed}."


def _disagreement(found: dict[tuple[str, str], Comparison]) -> str:
    steady = found["force", "step steady current"]
    half_period = found["force", "square half period end current"]
    final = found["force", "step final force"]
    displacement = found["displacement", "step max displacement"]
    return (
        f"They do not reproduce the steady current ({steady.against}), the current at the end of a half period "
        f"({half_period.against}) or the force after back relaxation (the model reaches {read(final.model, FORCE)}, "
        f"the measured force decreases from {read(final.published, FORCE)} after a few seconds), "
        f"and not the displacement of the same sample ({displacement.against})."
    )


def _reason(actuator: Actuator, found: dict[tuple[str, str], Comparison], hydrated_mass: float) -> str:
    length = actuator["geometry.free_length"] + actuator["geometry.clamped_length"]
    width, thickness = actuator["geometry.width"], actuator["geometry.thickness"]
    density, modulus = actuator["beam.density"], actuator["beam.modulus"]
    electrodes = 2.0 * actuator["circuit.sheet_resistance"] * length / width  # eq. 4.1, twice in series
    most = STEP_VOLTAGE / electrodes

    current_force_run = found["force", "step peak current"].published
    current_displacement_run = found["displacement", "step peak current"].published
    # f/delta = Y w h^3 / (4 L_s^3), from eqs 4.7 and 4.8.
    stiffness = found["force", "step max force"].published / found["displacement", "step max displacement"].published
    measured_modulus = 4.0 * actuator["geometry.sensing_length"] ** 3 * stiffness / (width * thickness**3)
    weighed_thickness = hydrated_mass / (density * length * width)
    return (
        "Why: the published numbers contradict each other, and no fit can mend that. "
        f"(1) At the same {STEP_VOLTAGE:g} V step the displacement run drew {read(current_displacement_run, CURRENT)} "
        f"and the force run {read(current_force_run, CURRENT)}: the actuator was in two different states. Through "
        f"electrodes of {electrodes:.3g} ohm in all, {STEP_VOLTAGE:g} V cannot draw more than {read(most, CURRENT)}, "
        "less than either. "
        f"(2) Measured force over measured displacement is {stiffness:.2g} N/m, which means a Young's modulus of "
        f"{read(measured_modulus, MODULUS, digits=3)}; the table has {read(modulus, MODULUS)}. The coupling is fitted "
        "to force alone, so a modulus that is too large makes the displacement too small by the same factor. "
        f"(3) {read(hydrated_mass, MASS)} of {density:.4g} kg/m^3 on {read(length, LENGTH)} x {read(width, LENGTH)} "
        f"is a strip {read(weighed_thickness, LENGTH, digits=3)} thick, not {read(thickness, LENGTH)}; stiffness goes "
        "with the cube of the thickness."
    )


def _other_set() -> str:
    tables, script, soft = two_sets()
    measured = {(row.waveform, row.metric): row.number for row in published_measurements(2)}
    ratio = script.dc_coupling / tables.dc_coupling
    return (
        "The thesis has a second set for this strip, in the script of its appendix A.1 (friend-2-appendix). "
        f"d(0) is {ratio:.1f} times that of the tables. With the circuit of the tables it bends the strip by "
        f"{read(script.displacement, LENGTH, digits=3)} within {BACK_RELAXATION_FROM:g} s of the step, where "
        f"{measured['step', 'max_displacement']} were measured and the tables give "
        f"{read(tables.displacement, LENGTH, digits=3)}. Under the sine it gives "
        f"{read(script.sine, LENGTH, digits=2)}, where {measured['sine', 'max_displacement']} were measured and the "
        f"tables give {read(tables.sine, LENGTH, digits=2)}. "
        "Section 5.2 says of its own simulation that the maxima of the step correspond and that the sine is predicted "
        "far too large: so the script does, and the tables do not. Section 6.3 says that it stays constant after its "
        f"maximum: neither does; up to {DURATION:g} s the displacement rises by another {100.0 * tables.drift:.0f} % "
        f"and {100.0 * script.drift:.0f} %. With the modulus in the comment of the script, "
        f"{read(soft.modulus, MODULUS)}, the force is {read(soft.force, FORCE, digits=2)} "
        f"({measured['step', 'max_force']} measured). The script calls its numbers values to start an estimation from. "
        "That they meet the displacement suggests, and does not prove, that the conflict between force and "
        "displacement is for the larger part one of which set was printed."
    )
