"""Which stages of a model the comparison could judge: shown by one run alone, or held at the values they came with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ipmclab.choosing.held_out import Division, Fold
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.free import parse_free
from ipmclab.model import Actuator
from ipmclab.model.kinds import kind_of


def stage_of(name: str) -> str:
    """The stage of a parameter, where models may differ by it; otherwise empty.

    Examples
    --------
    >>> [stage_of(name) for name in ("leak.cubic.linear", "relaxation.force_pair.0.lead", "coupling.gain")]
    ['leak.cubic', 'relaxation.force', '']
    """
    kind = kind_of(name)
    return "" if kind is None else kind.compared(name)


def shown_in_one(
    fit: Fit, stages: Sequence[str], folds: Sequence[Fold], division: Division
) -> dict[str, tuple[str, ...]]:
    """The stages that a fit to all runs determines, and the fit without one run does not, with the labels of such runs.

    Parameters
    ----------
    fit : Fit
        To all runs.
    stages : sequence of str
        Those to look at.
    folds : sequence of Fold
    division : Division
        Only whole runs that are held out hide a stage altogether; for blocks, nothing is found.
    """
    if not division.whole_runs:
        return {}
    found: dict[str, tuple[str, ...]] = {}
    for number, fold in enumerate(folds):
        labels = tuple(record.label for record in division.records if division.held_rows(record, number).any())
        for stage in stages:
            known = {name for name, one in fit.parameters.items() if stage_of(name) == stage and one.determined}
            if known and known <= set(fold.left_open):
                found[stage] = (*found.get(stage, ()), *labels)
    return found


def stages_held(models: Mapping[str, Actuator], free: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """The stages of each model that not every model has, and of which nothing is free.

    Parameters
    ----------
    models : mapping of name to Actuator
    free : mapping of name to sequence of str
        What of each is fitted.
    """
    found: dict[str, tuple[str, ...]] = {}
    for name, own in differing_stages(models).items():
        try:
            moved = {stage_of(one) for one in parse_free(models[name].parameter_values, free[name]).actuator}
        except InputError:
            continue  # its fit says so
        found[name] = tuple(one for one in own if one not in moved)
    return {name: held for name, held in found.items() if held}


def differing_stages(models: Mapping[str, Actuator]) -> dict[str, tuple[str, ...]]:
    """The stages of each model that not every model has.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> differing_stages({name: load_actuator(name) for name in ("friend-2", "friend-2+leak.cubic")})
    {'friend-2': (), 'friend-2+leak.cubic': ('leak.cubic',)}
    """
    stages = {
        name: list(dict.fromkeys(filter(None, map(stage_of, one.parameter_values)))) for name, one in models.items()
    }
    return {
        name: tuple(one for one in own if not all(one in others for others in stages.values()))
        for name, own in stages.items()
    }
