"""Look at what a fit leaves, and say what the model cannot explain."""

from __future__ import annotations

from collections.abc import Sequence

from ipmclab.fit.output_diagnosis import OutputDiagnosis, Verdict
from ipmclab.identification.diagnostics.left import Left
from ipmclab.identification.diagnostics.residuals import output_diagnosis
from ipmclab.identification.diagnostics.stages import CLEAR, SHARE, Tried, named, tried_stages
from ipmclab.identification.noise.pieces import imitated
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.record import READ_OUTPUTS
from ipmclab.identification.solved import Estimate
from ipmclab.model import Actuator
from ipmclab.model.declared import MOTION, in_group
from ipmclab.model.kinds import kind_named
from ipmclab.model.variants import line_of
from ipmclab.run import Finding


def diagnose(
    actuator: Actuator, names: FreeParameters, estimate: Estimate
) -> tuple[tuple[OutputDiagnosis, ...], list[Finding]]:
    """What is left of each output of each run, and findings where that is more than noise.

    Parameters
    ----------
    actuator : Actuator
        That was given.
    names : FreeParameters
        That were free.
    estimate : Estimate

    Returns
    -------
    diagnoses : tuple of OutputDiagnosis
        One for each output of each run.
    findings : list of Finding
        ``stage-missing`` where a stage that the actuator lacks would explain it, ``model-incomplete`` where it follows
        the voltage and none would.
    """
    problem = estimate.correlated.problem
    if not problem.unknowns:
        return (), []
    read = [output for output in READ_OUTPUTS if any(output in record.readings for record in problem.records)]
    every = [Left.of(estimate, output) for output in read]
    verdicts = {left.output: _verdict(left) for left in every}
    basis = imitated(estimate.correlated.whitened)
    found = []
    for record in problem.records:
        for left in every:
            if left.output in record.readings:
                verdict = verdicts[left.output] if record.place in left.coloured_in else "white"
                found.append(output_diagnosis(estimate.correlated, record, left.output, verdict, basis))
    tried = tried_stages(actuator, names, every)
    fixed, chosen = _fixed_motion(actuator, names, read), named(tried)
    if chosen:
        return tuple(found), [_missing(actuator, chosen, fixed)]
    return tuple(found), [_incomplete(left, tried, fixed) for left in every if left.follows or left.bends]


def _fixed_motion(actuator: Actuator, names: FreeParameters, read: Sequence[str]) -> str:
    """The fixed values on which the motion rests, where it is fitted: wrong ones leave what a missing stage leaves."""
    coupling = in_group(MOTION, actuator.parameter_values) if {"displacement", "force"} & set(read) else []
    fixed = [name for name in coupling if name not in names.actuator]
    return f"{MOTION}.*" if fixed and fixed == coupling else ", ".join(fixed)


def _verdict(left: Left) -> Verdict:
    if not left.coloured_in:
        return "white"
    if left.follows:
        return "follows the voltage"
    return "bends with the voltage" if left.bends else "autocorrelated"


def _missing(actuator: Actuator, chosen: Sequence[Tried], fixed: str) -> Finding:
    best, *others = chosen
    # A relaxing displacement lets the circuit of a joint fit go back to the current, yet the displacement shows it.
    outputs = kind_named(best.stage).outputs
    own = [one for one, share in best.shares.items() if one in outputs and share > SHARE] or [*best.shares]
    output = max(own, key=lambda one: best.shares[one])
    explained = best.shares[output]
    also = "".join(f"; as well, {kind_named(one.stage).shows}: {one.stage}" for one in others)
    models = " or ".join(line_of(actuator, one.stage) for one in chosen)
    free = dict.fromkeys(group for one in chosen if (group := kind_named(one.stage).group))
    with_free = f" with {' or '.join(free)} free too" if free else ""
    return Finding(
        "stage-missing",
        "warning",
        f"what is left of the {output} shows {kind_named(best.stage).shows}: a stage {best.stage} would take away "
        f"{100.0 * explained:.0f} % of its power beyond noise{also}{_or_wrong(fixed)}",
        f"identify {models}{with_free}, and compare both by choose",
        channel=output,
        values={"stage": best.stage, "explained": explained, "evidence": best.evidence},
    )


def _or_wrong(fixed: str) -> str:
    said = f". A wrong fixed value ({fixed}) can look the same: free it or measure it before you believe a stage"
    return said if fixed else ""


def _incomplete(left: Left, tried: Sequence[Tried], fixed: str) -> Finding:
    how = "follows the voltage" if left.follows else "follows the voltage, not in proportion to it"
    # What a chance fit of its parameters would give as well, a stage does not explain.
    some = [one for one in tried if one.evidence > 0.0 and one.shares[left.output] > 0.0]
    found, explained, names = "none explains any of it", 0.0, ", ".join(one.stage for one in tried)
    if some:
        best = max(some, key=lambda one: one.shares[left.output])
        explained = best.shares[left.output]
        found = f"{best.stage} explains most, {round(100.0 * explained, 1):g} % of the power beyond noise"
        found += "" if best.evidence > CLEAR else ", which noise alone could also give"
    of_them = f"; of the stages that were tried {found} ({names})" if tried else ""
    return Finding(
        "model-incomplete",
        "warning",
        f"what is left of the {left.output} {how}{of_them}. The model lacks something (p < 0.1 %){_or_wrong(fixed)}",
        "look at the residuals in the report; check what is held fixed, and when the edges were applied; values that "
        "rest on this output may be wrong by more than their intervals say",
        channel=left.output,
        values={"tried": names, "explained": explained},
    )
