"""Which models are compared, and what of each is free."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from ipmclab.errors import InputError
from ipmclab.identification.problem.free import OBSERVATION_NAMES, parse_free
from ipmclab.model import Actuator, load_actuator
from ipmclab.model.actuator_file import library_names
from ipmclab.model.declared import ELECTRICAL, MOTION, in_group
from ipmclab.model.environment.age import AGE
from ipmclab.model.kinds import stage_groups
from ipmclab.model.variants import stage_names, with_stages

FEWEST: Final = 2
"""Models that are a comparison."""

_FURTHER: Final = re.compile(r"\d{1,3}")

_NOT_TOGETHER: Final = frozenset({"leak-in-modes", "no-form", "no-modes", "two-forms"})
"""Of a model whose stages are each known, but make no strip together."""


def parse_models(
    texts: str | Iterable[str], base: str | Actuator | None = None
) -> list[tuple[str, Actuator | InputError]]:
    """Read the names of models.

    Parameters
    ----------
    texts : str or iterable of str
        Comma lists of actuators (``friend-2+leak.cubic``, ``fitted.toml``) or of stages that the base is given
        (``leak.cubic``, ``leak.cubic+leak.slow``). ``branches=1,2,3`` is short for three of them.
    base : str or Actuator, optional
        The actuator to which stages are added.

    Returns
    -------
    models : list of (name, Actuator or InputError)
        The error where the stages of a model do not go together (``line.modes+leak.cubic``).

    Raises
    ------
    InputError
        No name, an unknown one, a count that is none, a file that cannot be read, stages without a base.

    Examples
    --------
    >>> [name for name, _ in parse_models("branches=1,2,3", "friend-2")]
    ['branches=1', 'branches=2', 'branches=3']
    """
    given = [texts] if isinstance(texts, str) else list(texts)
    words: list[str] = []
    for word in (word.strip() for text in given for word in text.split(",")):
        if _FURTHER.fullmatch(word) and words and "=" in words[-1]:
            words.append(f"{words[-1].rpartition('=')[0]}={word}")
        elif word:
            words.append(word)
    if not words:
        raise InputError("no models were given", code="no-models", where="models", repair="name at least two")
    return [(word, _model_or_fault(word, base)) for word in dict.fromkeys(words)]


def named_models(
    models: str | Iterable[str | Actuator], actuator: str | Actuator | None
) -> list[tuple[str, Actuator | InputError]]:
    """The models of a call with their names, at least two and no two alike; the error as in ``parse_models``."""
    named: list[tuple[str, Actuator | InputError]] = []
    for one in [models] if isinstance(models, str) else list(models):
        named += [(one.name, one)] if isinstance(one, Actuator) else parse_models(one, actuator)
    names = [name for name, _ in named]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(
            f"two models are called {twice!r}", code="same-model-twice", where="models", repair="give each model once"
        )
    if len(named) < FEWEST:
        raise InputError(
            f"{len(named)} model was given" if named else "no models were given",
            code="no-models",
            where="models",
            repair="name at least two, such as branches=1,2",
        )
    return named


def _model_or_fault(word: str, base: str | Actuator | None) -> Actuator | InputError:
    try:
        return _model(word, base)
    except InputError as fault:
        if fault.code in _NOT_TOGETHER:
            return fault
        raise fault.at(f"models: {word}") from fault


def _model(word: str, base: str | Actuator | None) -> Actuator:
    first = word.removeprefix("+").partition("+")[0].partition("=")[0].strip()
    is_stage = word.startswith("+") or (
        first in stage_names() and word not in library_names() and not Path(word).exists()
    )
    if not is_stage:
        return load_actuator(word)
    if base is None:
        raise InputError(
            f"{word!r} is a stage: it does not say of which actuator",
            code="no-actuator",
            where="models",
            repair=f"name the actuator too (--actuator), or write for example friend-2+{word.removeprefix('+')}",
        )
    stages = word.removeprefix("+")
    if isinstance(base, Actuator):
        return with_stages(base, *stages.split("+"))
    return load_actuator(f"{base}+{stages}")


def free_of(actuator: Actuator, channels: Iterable[str], given: Sequence[str]) -> tuple[str, ...]:
    """What of a model is fitted: what was asked and it has; by default the groups of all its stages.

    Parameters
    ----------
    actuator : Actuator
    channels : iterable of str
        What the runs measured.
    given : sequence of str
        Groups and dotted names; empty for the default: ``electrical`` where there is a current, ``coupling`` where
        there is a displacement or a force, and each of ``leak``, ``relaxation``, ``viscoelastic`` and ``clamp``
        that it has.

    Examples
    --------
    >>> free_of(load_actuator("friend-2+relaxation.displacement"), ["current", "displacement"], ())
    ('electrical', 'coupling', 'relaxation')
    >>> free_of(load_actuator("friend-2"), ["current"], ["electrical", "leak"])
    ('electrical',)
    """
    names = list(actuator.parameter_values)
    if given:
        return tuple(word for word in given if _has(names, word))
    observed = set(channels)
    found = [ELECTRICAL] if "current" in observed else []
    found += [MOTION] if observed & {"displacement", "force"} else []
    return (*found, *(group for group in stage_groups() if in_group(group, names)))


def words_of(given: str | Iterable[str]) -> tuple[str, ...]:
    """Names out of comma lists."""
    texts = [given] if isinstance(given, str) else list(given)
    return tuple(word.strip() for text in texts for word in text.split(",") if word.strip())


def refuse_unknown(given: Sequence[str], actuators: Iterable[Actuator]) -> None:
    """Refuse a name that no model has.

    Raises
    ------
    InputError
        As ``identify`` would for the richest of them; how fast a parameter ages.
    """
    every = list(dict.fromkeys(name for actuator in actuators for name in actuator.parameter_values))
    for word in given:
        if word.startswith(AGE):
            raise InputError(
                f"{word!r} is how fast a parameter ages, which no comparison of models fits",
                code="not-of-a-choice",
                where="free",
                repair="leave it out, and give runs between which the strip hardly aged",
            )
        if not _has(every, word):
            parse_free(every, word)


def _has(names: Sequence[str], word: str) -> bool:
    if word in (ELECTRICAL, *OBSERVATION_NAMES):
        return True
    return word in names or bool(in_group(word, names))
