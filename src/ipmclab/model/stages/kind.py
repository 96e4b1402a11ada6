"""Kinds of stages: what each is called, and what a fit, its diagnosis and its report have to know of it.

A stage file declares its kinds once, as data and a few functions of parameter values; whoever needs to know something
of a stage asks the declaration (``model.kinds``), and never spells a parameter's name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

from ipmclab.model.blocks import Block
from ipmclab.model.parameters import Declaration, Values

LITTLE: Final = 0.01
"""Size of a trial that is a part or a ratio: small, and far from the rounding of a simulation."""

CURRENT: Final = 1e-3
"""Part of the largest current that a trial draws."""

Numbers = Mapping[str, float]
"""Parameters of an actuator by dotted name, in SI units."""


class Stage(Protocol):
    """What a kind builds: parameters and, for a parameter vector, a linear block."""

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""

    def block(self, values: Values) -> Block:
        """The block for a parameter vector. A port that it both reads and writes is one in which it is inserted."""


@dataclass(frozen=True)
class Excitation:
    """What some runs asked of a strip.

    Parameters
    ----------
    outputs : tuple of str
        That were read.
    lags : tuple of float [s]
        Time constants that these runs could show.
    voltage : float [V]
        The largest.
    current_density : float [A/m^2]
        Of the largest current, over the strip's area.
    """

    outputs: tuple[str, ...]
    lags: tuple[float, ...]
    voltage: float
    current_density: float


@dataclass(frozen=True)
class Trial:
    """A little of a stage that an actuator lacks, by which readings are asked for it.

    Parameters
    ----------
    stage : str
        As it is named after a plus: ``relaxation.displacement=2``.
    values : mapping of name to float [SI]
    outputs : tuple of str
        Those whose readings would show it; where it is empty, those of its kind.
    both_ways : bool
        Whether less than none of it can be too.
    lag : float [s], optional
        Its time constant, where it is tried at several.
    changes : function of the parameters to changes of them, optional
        What else changes where a little of the stage takes the place of something else.
    """

    stage: str
    values: Numbers = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    both_ways: bool = False
    lag: float | None = None
    changes: Callable[[Numbers], dict[str, float]] | None = None

    def sized(self, kind: StageKind, size: float) -> dict[str, float]:
        """The values of so many times this little."""
        powers = dict.fromkeys(kind.off, 1.0) | dict(kind.grows)
        return {
            name: value * size ** powers[ending] if (ending := kind.ending(name)) in powers else value
            for name, value in self.values.items()
        }


def no_trials(values: Numbers, excitation: Excitation) -> Iterator[Trial]:  # noqa: ARG001  # the signature of trials
    """None: nothing of this kind is asked for by itself."""
    return iter(())


@dataclass(frozen=True)
class StageKind:
    """What is to be known of a stage.

    Parameters
    ----------
    name : str
        As it is named after a plus: ``leak.cubic``.
    prefix : str
        How the names of its parameters begin.
    group : str
        The word that frees its parameters; empty where they are freed by their own names only.
    example : bool
        Whether a message proposes this stage where a group is named that an actuator lacks.
    counted : bool
        Whether a strip may have several, each with a number behind the prefix.
    one_of : str
        The family of which a strip has one form; empty where there are no others.
    follows : str
        The family without which this stage means nothing.
    compared_as : str
        As what a comparison of models knows it, the prefix itself where each of a counted kind is one for itself; empty
        where models do not differ by it, or its parameters are not fitted.
    outputs : tuple of str
        Readings of which any shows it.
    electrical : bool
        Whether it changes the current, and with it all that is read.
    several_minima : bool
        Whether a fit of it has several, of which noise can make the wrong one the first.
    curved : bool
        Whether the likelihood is not that of a linear problem even where a parameter is moved on a linear scale.
    off : tuple of str
        Its parameters that are zero where there is none of it: the actuator then equals one without the stage.
    proportional : mapping of str to float
        Its parameters that outputs of a run from rest are linear in, all of them together and whatever the rest is, so
        that a search leaves them out; and how large each is at most where it is one of a strip (infinite: any size).
    grows : mapping of str to float
        Powers with which parameters go with how much there is of it; 1 for those of ``off``.
    held : tuple of str
        Its parameters that a first look leaves at their usual values.
    shows : str
        What residuals show where it lacks.
    to_determine : str
        What to record where the readings leave its parameters open.
    to_show : str
        What to record where the readings are met as well without it.
    cure : pair of str
        Where no measurement and no other output would determine it: a short name of what would, and how.
    trials : function of the parameters and an Excitation
        Little amounts of it, by which readings are asked whether it is missing; none where it does not go with the
        actuator.
    speed : function of the parameters and a name, optional
        Time constant [s] of one of a counted kind, up to a factor that all share: they are ordered fastest first.
    build : function of a number to Stage, optional
        Makes the stage (with so many, where it is counted); left out by the stages that ``Structure`` itself knows.
    """

    name: str
    prefix: str
    group: str = ""
    example: bool = False
    counted: bool = False
    one_of: str = ""
    follows: str = ""
    compared_as: str = ""
    outputs: tuple[str, ...] = ()
    electrical: bool = False
    several_minima: bool = False
    curved: bool = False
    off: tuple[str, ...] = ()
    proportional: Mapping[str, float] = field(default_factory=dict, hash=False)
    grows: Mapping[str, float] = field(default_factory=dict, hash=False)
    held: tuple[str, ...] = ()
    shows: str = ""
    to_determine: str = ""
    to_show: str = ""
    cure: tuple[str, str] = ("", "")
    trials: Callable[[Numbers, Excitation], Iterator[Trial]] = no_trials
    speed: Callable[[Numbers, str], float] | None = None
    build: Callable[[int], Stage] | None = None

    def one(self, name: str) -> str:
        """The beginning that the parameters of one of this kind share: with its number where it is counted."""
        if not self.counted:
            return self.prefix
        return f"{self.prefix}{name.removeprefix(self.prefix).partition('.')[0]}."

    def compared(self, name: str) -> str:
        """As what a comparison of models knows the stage of a parameter: where each counts alone, with its number."""
        return self.one(name).removesuffix(".") if self.compared_as == self.prefix else self.compared_as

    def ending(self, name: str) -> str:
        """What a parameter of this kind is called within it."""
        return name.removeprefix(self.one(name))


def is_there(names: Iterable[str], prefix: str) -> bool:
    """Whether any of these names begins so.

    Examples
    --------
    >>> is_there(["leak.cubic.linear"], "leak.")
    True
    """
    return any(name.startswith(prefix) for name in names)


def number_of(names: Iterable[str], prefix: str) -> int:
    """How many of a counted stage these names speak of.

    Examples
    --------
    >>> number_of(["circuit.branches.0.resistivity", "circuit.branches.1.resistivity"], "circuit.branches.")
    2
    """
    return len({name.removeprefix(prefix).split(".")[0] for name in names if name.startswith(prefix)})
