"""Models that could be true instead of the one that was fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.diagnostics.score_directions import one_step_along, score_directions
from ipmclab.model import Actuator, simulate
from ipmclab.model.kinds import kind_named
from ipmclab.model.stages.kind import Trial
from ipmclab.model.variants import with_stages
from ipmclab.planning.answer import FittedStrip

_SHOWN: Final = 2.0  # standard errors
_LENGTH: Final = 40.0  # seconds of a run by which amounts of a stage are chosen


@dataclass(frozen=True, eq=False)
class Rival:
    """Another model of the strip.

    Parameters
    ----------
    name : str
    actuator : Actuator
    direction : Trial, optional
        Where it is the fitted strip with a little of a stage: how much of it there is, nobody knows.
    """

    name: str
    actuator: Actuator
    direction: Trial | None = field(default=None)

    def least_shown(self, errors: float) -> Mapping[str, tuple[float, str]]:
        """The least of its stage that would show, where as much as it has differs by so many standard errors.

        Values in SI units, with the unit.
        """
        if self.direction is None or not errors > 0.0:
            return {}
        kind = kind_named(self.direction.stage)
        sized = self.direction.sized(kind, _SHOWN / errors)
        known = self.actuator.parameters()
        return {name: (value, known[name].unit) for name, value in sized.items() if kind.ending(name) in kind.off}


def rivals_of(strip: FittedStrip, rival: str | Actuator | Fit | None, voltage: float) -> tuple[Rival, ...]:
    """What a plan has to distinguish from the fitted model.

    A stage whose time constant nobody knows is a rival for each that runs could show.

    Parameters
    ----------
    strip : FittedStrip
    rival : str, Actuator, Fit or None
        The stage that the fit itself misses where it is left out.
    voltage : float [V]
        The largest that is applied.
    """
    if isinstance(rival, Fit):
        return (Rival(rival.actuator.name, rival.actuator),)
    if isinstance(rival, Actuator):
        return (Rival(rival.name, rival),)
    stage = rival or next((str(one.values["stage"]) for one in strip.fit.findings if one.code == "stage-missing"), "")
    if not stage:
        raise InputError(
            "the fit misses no stage, so there is no other model to distinguish it from",
            code="no-rival",
            where="rival",
            repair="name a stage such as 'leak.exponential', or give another model of this strip",
        )
    with_stages(strip.actuator, stage)  # says what is wrong with its name
    run = simulate(strip.actuator, f"step {voltage:g} V", duration=_LENGTH, rate=50.0)
    found = [one for one in score_directions(strip.actuator, [run], strip.outputs) if one.stage == stage]
    if not found:
        raise InputError(
            f"runs at {voltage:g} V that read the {' and the '.join(strip.outputs)} would not show a stage {stage}",
            code="rival-unseen",
            where="rival",
            repair=kind_named(stage).to_show or "name another stage, or fit runs with an output that shows it",
        )
    return tuple(
        Rival(stage if one.lag is None else f"{stage} ({one.lag:.2g} s)", one_step_along(one, strip.actuator), one)
        for one in found
    )
