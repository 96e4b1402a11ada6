"""What a campaign is: strips, what is recorded of each, and in which order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

from ipmclab.model import Actuator, load_actuator
from ipmclab.model.environment.hydration import HYDRATION, STANDARD
from ipmclab.rig.channels import Rig
from ipmclab.rig.experiments.experiment import Experiment
from ipmclab.run import Severity
from ipmclab.sample import Sample

ROOM: Final = "room"
"""The condition of a run for which no chamber is set; an experiment with ``environment = "room"`` sets none."""

Order = Literal["listed", "randomised"]
"""Of samples and signals: as the file lists them, or drawn again in each repeat of everything."""

Clamped = Literal["for each block", "for each run"]
"""How often a strip is taken out of its solvent and clamped."""

Fact = Literal["mass", "sheet resistance", "stiffness"]
"""What is measured of a strip without a run."""


@dataclass(frozen=True)
class VirtualState:
    """What a virtual strip is in some of its runs: a strip on a bench differs from one clamping to the next too.

    Parameters
    ----------
    measured, signal, condition : str, optional
        The runs that it holds for, such as ``"force"``, ``"step 1 V"``, ``"20 degC, 80 %RH"``; each holds for all
        where it is left out.
    actuator : str, optional
        Another model of the strip.
    parameters : mapping of dotted name to float [SI]
        What is set in it; one of ``hydration`` gives water to a strip that has none (``with_water``).
    """

    measured: str | None = None
    signal: str | None = None
    condition: str | None = None
    actuator: str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)

    def holds_for(self, measured: str, signal: str, condition: str) -> bool:
        """Whether it holds for a run."""
        asked = ((self.measured, measured), (self.signal, signal), (self.condition, condition))
        return all(mine is None or mine == its for mine, its in asked)


@dataclass(frozen=True)
class Strip:
    """One strip of a campaign.

    Parameters
    ----------
    sample : Sample
    actuator : str, optional
        Name or file of its model: foretells currents, and is the strip at a virtual bench.
    states : tuple of VirtualState
        The first that holds for a run says what else the virtual strip is in it; each later one adds to it.
    """

    sample: Sample
    actuator: str | None = None
    states: tuple[VirtualState, ...] = ()

    def virtual(self, measured: str, signal: str, condition: str) -> Actuator | None:
        """The strip of a run at a virtual bench; None where the campaign names no model of it."""
        holding = [state for state in self.states if state.holds_for(measured, signal, condition)]
        named = next((state.actuator for state in holding if state.actuator is not None), self.actuator)
        if named is None:
            return None
        strip = load_actuator(named)
        for state in holding:
            strip = with_water(strip, state.parameters).replace(**dict(state.parameters))
        return strip


def with_water(strip: Actuator, names: Iterable[str]) -> Actuator:
    """A strip with the water of Nafion in it, where one of these parameters is of water and it has none.

    Examples
    --------
    >>> strip = load_actuator("friend-5-measured")
    >>> with_water(strip, ["hydration.linear_swelling"])["hydration.liquid_water_content"]
    22.0
    """
    if strip.structure.hydration or not any(name.startswith(HYDRATION) for name in names):
        return strip
    return replace(strip, parameter_values={**strip.parameter_values, **STANDARD}, fit_table=None)


@dataclass(frozen=True)
class Part:
    """What is recorded of some strips: the content of an experiment file.

    Parameters
    ----------
    name : str
    experiments : mapping of sample id to Experiment
        The same for each strip but for its sample.
    """

    name: str
    experiments: Mapping[str, Experiment]


@dataclass(frozen=True)
class Campaign:
    """Samples x signals x environments x repeats. Use ``load_campaign`` to make one.

    Parameters
    ----------
    title : str
    rig : Rig
    rig_file : Path or "virtual"
        Where it was read.
    strips : tuple of Strip
    parts : tuple of Part
    order : "listed" or "randomised"
    seed : int
        Of a random order, and of the noise of a virtual bench.
    clamped : "for each block" or "for each run"
    attempts : int
        How often a run is recorded, at most, that fails its checks.
    fails_at : "error", "warning" or "never"
        The least severity of a finding with which a run fails.
    facts : tuple of str
        What is measured of each strip without a run.
    identify : bool
        Whether the model of each sample is identified from its runs.
    checksum : str
        Of what the file says.
    where : str
        The file, for messages.
    text : str
        The file as it is.
    """

    title: str
    rig: Rig
    rig_file: Path | str
    strips: tuple[Strip, ...]
    parts: tuple[Part, ...]
    order: Order = "listed"
    seed: int = 1
    clamped: Clamped = "for each block"
    attempts: int = 2
    fails_at: Severity | Literal["never"] = "error"
    facts: tuple[Fact, ...] = ()
    identify: bool = True
    checksum: str = ""
    where: str = "campaign"
    text: str = ""

    @property
    def is_virtual(self) -> bool:
        """Whether it runs in lock-step, at a bench that is computed."""
        return self.rig.bench == "virtual"

    @property
    def models(self) -> tuple[Actuator, ...]:
        """The models that the campaign names, each of its sample: their dimensions make a displacement a strain."""
        named = [(strip.sample, load_actuator(strip.actuator)) for strip in self.strips if strip.actuator is not None]
        return tuple(replace(model, sample=sample) for sample, model in named)

    def strip(self, sample: str) -> Strip:
        """The strip of a sample's id."""
        return next(strip for strip in self.strips if strip.sample.id == sample)
