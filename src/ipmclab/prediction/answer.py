"""How sure a fitted actuator is of an answer to a voltage that it was never asked for, and why it may not be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from ipmclab.errors import InputError
from ipmclab.fit.as_fitted import why_changed
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_file import fit_of
from ipmclab.fit.rows import listed
from ipmclab.identification.mountings.mountings import why_unknown
from ipmclab.identification.problem.record import READ_OUTPUTS
from ipmclab.model import Actuator
from ipmclab.model.actuator_file import load_actuator, stages_after
from ipmclab.prediction.bands import Bands, prediction_bands
from ipmclab.prediction.in_state import environment_of_run
from ipmclab.prediction.own_of_mounting import mountings_of_fit, own_names_of_mountings
from ipmclab.run import Run

MOST_ROWS: Final = 200_000
"""Of an answer with a band: the derivative of every row by every parameter is held at once (a limit)."""

_AVERAGE: Final = "mountings-differ"
_TOLD: Final = "undetermined"
"""Findings of a fit that stand in the sentences."""

_NONSENSE: Final = "model-explains-nothing"


@dataclass(frozen=True, eq=False)
class SureAnswer:
    """What the fit of an actuator says of a simulated answer.

    Parameters
    ----------
    here : Bands or None
        For the mountings of the fit.
    following : Bands or None
        For the next mounting.
    why_none : str
        Why nothing is said of the mountings of the fit; empty where ``here`` is something.
    next_mounting_unknown : str
        Why nothing is said of the next mounting.
    mountings : tuple of str
        Of the fit.
    not_read : tuple of str
        Outputs that the fit never read, so that there is no band of them.
    warnings : tuple of str
        Codes of what the fit itself warns of.
    own : tuple of str
        Parameters of which each mounting of the fit has its own.
    environment : tuple of str
        What is to be said of the environment in which the strip was asked.
    """

    here: Bands | None
    following: Bands | None = None
    why_none: str = ""
    next_mounting_unknown: str = ""
    mountings: tuple[str, ...] = ()
    not_read: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    own: tuple[str, ...] = ()
    environment: tuple[str, ...] = ()

    def sentences(self) -> list[str]:
        """What must be known with the numbers."""
        some = self.here or self.following
        if some is None:
            return [f"No interval: {self.why_none}."]
        held = _mountings(self.mountings) if self.here else "the next mounting alone"
        lines = [f"The 95 % intervals hold for {held}{f': {self.why_none}' if self.why_none else ''}."]
        if self.here and self.own and len(self.mountings) > 1:
            lines.append(
                f"Each of them has its own {listed(self.own)}: the answer is that of the average over the runs, "
                "and the intervals hold what each mounting answers."
            )
        lines += [f"{said[0].upper()}{said[1:]}." for said in self.environment]
        if some.left_out:
            names = listed(some.left_out)
            lines.append(f"What {names} may change beyond what the runs of the fit show is not in them.")
        if self.not_read:
            them = "it" if len(self.not_read) == 1 else "them"
            lines.append(f"There is none of {listed(self.not_read)}: the fit did not read {them}.")
        if self.next_mounting_unknown:
            lines.append(f"{self.next_mounting_unknown[0].upper()}{self.next_mounting_unknown[1:]}.")
        if self.warnings:
            lines.append(f"The fit itself warns ({', '.join(self.warnings)}): the intervals are as good as its model.")
        return lines


def sure_answer(actuator: Actuator, run: Run, *, named: str = "") -> SureAnswer | None:
    """What a fitted actuator knows of its answer to the voltage of a run that starts at rest.

    Parameters
    ----------
    actuator : Actuator
    run : Run
        What ``simulate`` gave.
    named : str
        What the actuator was loaded by; stages after a plus are stages that its fit did not have.

    Returns
    -------
    answer : SureAnswer or None
        None for an actuator that was never fitted.

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> fit = identify(strip, simulate(strip, "step 1 V", duration=20, rate=50))
    >>> run = simulate(fit.actuator, "sine 1 V 0.2 Hz", duration=10, rate=50)
    >>> sure_answer(strip, run) is None, sure_answer(fit.actuator, run).mountings
    (True, ())
    >>> sure_answer(fit.actuator, run).next_mounting_unknown
    'the value at another mounting cannot be estimated: these runs do not say of which mounting they are'
    """
    if actuator.fit_table is None:
        return SureAnswer(None, why_none=why) if (why := _stages_named(named)) else None
    try:
        fit = fit_of(actuator, where=actuator.name)
    except InputError:
        return SureAnswer(None, why_none="the [fit] table is not one that identify writes")
    if why := _why_not(fit, len(run)):
        return SureAnswer(None, why_none=why)
    here = prediction_bands(fit, _of_mounting(run, None))
    if here.left_out and not any(one.any() for one in here.of_parameters.values()):
        return SureAnswer(None, why_none=f"nothing is known of {listed(here.left_out)}")
    mountings = mountings_of_fit(fit)
    codes = tuple(dict.fromkeys(one.code for one in fit.findings if one.severity != "info"))
    unknown, following = why_unknown(fit), None
    if not unknown:
        following = prediction_bands(fit, _of_mounting(run, f"not {' '.join(mountings)}"))
    average = ""
    if _AVERAGE in codes:
        average = (
            f"mountings {listed(mountings)} differ by more than their errors, and the fit answers for none of them"
        )
    return SureAnswer(
        None if average else here,
        following,
        average,
        next_mounting_unknown=unknown,
        mountings=mountings,
        not_read=tuple(name for name in READ_OUTPUTS if name not in here.predicted and name in run.channels),
        warnings=tuple(code for code in codes if code not in (_AVERAGE, _TOLD)),
        own=own_names_of_mountings(fit),
        environment=tuple(one.message for one in environment_of_run(fit, fit.actuator, run, "this answer")),
    )


def _why_not(fit: Fit, rows: int) -> str:
    """Why the errors of a fit say nothing of its actuator; empty where they do."""
    if rows > MOST_ROWS:
        return f"{rows} rows, and it is computed for {MOST_ROWS} at most; give a lower rate or a shorter duration"
    if not fit.converged:
        return "the fit did not converge, and its errors mean nothing"
    if any(finding.code == _NONSENSE for finding in fit.findings):
        return "the model of the fit does not follow its runs"
    return why_changed(fit)


def _stages_named(named: str) -> str:
    """Why a fit that was loaded with further stages says nothing; empty where no fit was."""

    base, stages = stages_after(named)
    try:
        fitted = bool(stages) and load_actuator(base).fit_table is not None
    except InputError:
        return ""
    return f"the fit in {Path(base).name} is of the actuator without {listed(stages)}" if fitted else ""


def _of_mounting(run: Run, name: str | None) -> Run:
    return replace(run, metadata=replace(run.metadata, mounting_id=name))


def _mountings(names: Sequence[str]) -> str:
    if not names:
        return "the mounting of the fit, which its runs do not name"
    return f"mounting {names[0]}" if len(names) == 1 else f"the mountings of the fit, {listed(names)}"
