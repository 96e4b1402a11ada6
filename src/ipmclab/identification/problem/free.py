"""Which parameters a fit may move: groups, dotted names, and the ones that each run has for itself."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from ipmclab.errors import InputError, suggest
from ipmclab.identification.problem.record import READ_OUTPUTS
from ipmclab.model.declared import in_group
from ipmclab.model.environment.age import AGE, Age, check_age
from ipmclab.model.environment.hydration import HYDRATION, PERCOLATION, REFERENCE_CONTENT, REFERENCE_TEMPERATURE, SITES
from ipmclab.model.kinds import groups, kinds, stage_groups

OBSERVATION_NAMES: Final = tuple(f"observation.{what}.{one}" for what in ("offset", "drift") for one in READ_OUTPUTS)
"""What a run's observation can have freed by name; its delay and its start are decided from the data."""

_PLACE = re.compile(r"\[\d+\]$")
_OF_LAWS: Final = (REFERENCE_CONTENT, REFERENCE_TEMPERATURE, PERCOLATION, SITES)  # they move more than the water


def is_named(base: str) -> bool:
    """Whether a parameter of a fit is freed by its name; else it is found without being named, as a delay is.

    Parameters
    ----------
    base : str
        Of any run or mounting, without its place.
    """
    return not base.startswith("observation.") or base in OBSERVATION_NAMES


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter beforehand.

    Parameters
    ----------
    value : float [SI]
    uncertainty : float [SI]
        Standard uncertainty, without that of what it follows.
    follows : mapping of name to float
        By how much the value moves with other free parameters of which something is known beforehand, one SI unit of
        theirs at a time: a width that stands in two measured numbers is one width.
    merely_uncertain : bool
        Free only so that its uncertainty counts: where the readings are asked alone, it is held.
    of_literature : bool
        Whether it is what strips have, and nobody stated it of this one.
    """

    value: float
    uncertainty: float
    follows: Mapping[str, float] = field(default_factory=dict)
    merely_uncertain: bool = False
    of_literature: bool = False


@dataclass(frozen=True)
class FreeParameters:
    """The parameters that a fit may move, in the order of the actuator's file.

    Parameters
    ----------
    shared : tuple of str
        One value for all runs.
    per_run : tuple of str
        One value for each run, without the place.
    per_mounting : tuple of str
        One value for each mounting, without its name.
    observation : tuple of str
        Offsets and drifts of the readings, one for each run.
    priors : mapping of name to Prior
    together : mapping of name to mapping of name to float [SI]
        Covariance of the priors of shared parameters that an earlier fit found together.
    age : tuple of str
        How fast parameters age, such as ``age.runs.coupling.gain``.
    """

    shared: tuple[str, ...]
    per_run: tuple[str, ...] = ()
    per_mounting: tuple[str, ...] = ()
    observation: tuple[str, ...] = ()
    priors: Mapping[str, Prior] = field(default_factory=dict)
    together: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    age: tuple[str, ...] = ()

    @property
    def actuator(self) -> tuple[str, ...]:
        """Every free parameter of the actuator, shared or not."""
        return (*self.shared, *self.per_run, *self.per_mounting)

    @property
    def moved(self) -> dict[str, str]:
        """Which parameter of the actuator each name moves: its own, or that which ages."""
        return {name: name for name in self.actuator} | {name: Age.of(name).parameter for name in self.age}

    def of(self, names: Collection[str]) -> FreeParameters:
        """Those of the actuator that are among some names; the others are held."""
        each = self.shared, self.per_run, self.per_mounting
        shared, per_run, per_mounting = (tuple(name for name in own if name in names) for own in each)
        return replace(self, shared=shared, per_run=per_run, per_mounting=per_mounting)

    @property
    def without_priors(self) -> FreeParameters:
        """What is free where the readings are asked alone."""
        held = {name for name, prior in self.priors.items() if prior.merely_uncertain}
        return replace(self.of(set(self.actuator) - held), priors={}, together={})


def parse_free(
    known: Iterable[str],
    free: str | Iterable[str],
    per_run: str | Iterable[str] = (),
    per_mounting: str | Iterable[str] = (),
) -> FreeParameters:
    """Read the names of free parameters.

    Parameters
    ----------
    known : iterable of str
        The actuator's parameters.
    free : str or iterable of str
        Groups (``electrical``, ``coupling``, and of stages that the actuator has ``leak``, ``relaxation``,
        ``viscoelastic``, ``clamp``, ``environment``), dotted names, or comma lists of them.
        ``age.runs.coupling.gain`` is how fast a parameter ages with the runs before; ``hours`` and ``charge`` are the
        other scales.
    per_run : str or iterable of str
        The same, for parameters of which each run has its own. Naming one here frees it.
    per_mounting : str or iterable of str
        The same, for parameters of which each mounting has its own.

    Returns
    -------
    free : FreeParameters

    Raises
    ------
    InputError
        An unknown name (with the nearest right one), a group of a stage that the actuator lacks, nothing free, a
        per-run name with a place, a name that is both per run and per mounting, a parameter of ``hydration`` that only
        moves the water.

    Examples
    --------
    >>> known = ["circuit.contact_resistance", "circuit.dc_resistivity", "coupling.gain"]
    >>> parse_free(known, "electrical", per_run="circuit.contact_resistance").per_run
    ('circuit.contact_resistance',)
    """
    names = list(known)
    shared = names_of(names, free, "free")
    own = names_of(names, per_run, "per_run")
    of_mountings = names_of(names, per_mounting, "per_mounting")
    for name in sorted(one for one in own | of_mountings if one.startswith(AGE)):
        raise InputError(
            f"{name!r} is what runs at different doses determine together",
            code="age-of-one-run",
            where="per_run" if name in own else "per_mounting",
            repair="name it in free",
        )
    each = (shared, "free"), (own, "per_run"), (of_mountings, "per_mounting")
    for name, where in ((name, where) for given, where in each for name in sorted(given)):
        # The water of each run is known before the fit, from stated values.
        parameter = Age.of(name).parameter if name.startswith(AGE) else name
        if parameter.startswith(HYDRATION) and parameter not in _OF_LAWS:
            raise InputError(
                f"{parameter!r} says how a strip takes up water; a fit computes the water of each run once, before it "
                "reads the runs, and so cannot find it",
                code="not-of-a-fit",
                where=where,
                repair="measure it, and state it in the actuator's file; a weighed strip (mass) needs none of it",
            )
    for name in sorted(of_mountings & (own | set(OBSERVATION_NAMES))):
        raise InputError(
            f"{name!r} belongs to each run already",
            code="per-run-and-mounting",
            where="per_mounting",
            repair="name it in one of per_run and per_mounting; what a sensor adds belongs to each run",
        )
    if not shared and not own and not of_mountings:
        raise InputError(
            "nothing is free",
            code="nothing-free",
            where="free",
            repair="give 'electrical', 'coupling' or dotted names such as 'circuit.sheet_resistance'",
        )
    return FreeParameters(
        shared=tuple(n for n in names if n in shared and n not in own | of_mountings),
        per_run=tuple(n for n in names if n in own),
        per_mounting=tuple(n for n in names if n in of_mountings),
        observation=tuple(n for n in OBSERVATION_NAMES if n in shared or n in own),
        age=tuple(sorted(n for n in shared if n.startswith(AGE))),
    )


def names_of(known: Iterable[str], given: str | Iterable[str], where: str) -> set[str]:
    """The dotted names that groups, names and comma lists of them stand for; ``where`` is what messages name."""
    names = list(known)
    texts = [given] if isinstance(given, str) else list(given)
    found: set[str] = set()
    for text in texts:
        if not isinstance(text, str):
            raise InputError(
                f"{text!r} is not a name",
                code="bad-name",
                where=where,
                repair="give names as text, such as 'electrical'",
            )
        for word in text.split(","):
            name = word.strip()
            if not name:
                continue
            own = in_group(name, names)
            if own or (name in groups() and name not in stage_groups()):
                found.update(own)
                continue
            if name not in names and name not in OBSERVATION_NAMES:
                if not name.startswith(AGE):
                    message, repair = _why_unknown(name, names)
                    raise InputError(message, code="unknown-parameter", where=where, repair=repair)
                check_age(name, names, where=where)
            found.add(name)
    return found


def _why_unknown(name: str, names: Sequence[str]) -> tuple[str, str]:
    """Why a name stands for nothing that can be free, and what to give in its place."""
    without_sensor = name.removeprefix("observation.").removesuffix("s")
    without_place = _PLACE.sub("", name)
    if name in stage_groups():
        stages = [kind for kind in kinds() if kind.group == name]
        example = next((kind.name for kind in stages if kind.example), stages[0].name)
        return f"this actuator has no {name}", f"add the stage to its name, such as friend-2+{example}"
    if without_sensor in ("offset", "drift"):
        *others, last = [repr(known) for known in OBSERVATION_NAMES if f".{without_sensor}." in known]
        return f"{name!r} does not say of which sensor", f"give {', '.join(others)} or {last}"
    if name.startswith("observation."):
        found = "the delay of a run with unknown hold and the state at its start are found without being named"
        return f"{name!r} cannot be freed by name", f"{suggest(name, OBSERVATION_NAMES)}; {found}"
    if without_place != name and without_place in names:
        return f"{name!r} names one run", f"give {without_place!r} as per_run: each run then has its own"
    every = [*(group for group in groups() if in_group(group, names)), *names]
    return f"no parameter or group is called {name!r}", suggest(name, every)
