"""What came of choosing between models: how each predicted, and which the runs call for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from ipmclab.choosing.compare import Difference
from ipmclab.choosing.noise import FadingNoise
from ipmclab.fit.fit import Fit
from ipmclab.fit.in_brief import LACKING, in_brief
from ipmclab.fit.rows import listed
from ipmclab.model.left_open import first_of
from ipmclab.shown import Shown

HoldOut = Literal["runs", "blocks"]

UNFINISHED: Final = "interrupted before its fits were done"
"""Why a model is not compared of which Ctrl-C ended the fits."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One model, and how it did.

    Parameters
    ----------
    name : str
        As it was named in the call.
    fit : Fit or None
        To all runs; None where that failed.
    free : tuple of str
        What was freed.
    reason : str
        Why it could not be compared; empty otherwise.
    parameters : int
        Number of free parameters, those of single runs included.
    log_predictive : float or None [nat]
        Log predictive likelihood of all held-out readings (SI units).
    rmse : mapping of output to float [SI]
        Of the held-out readings.
    rmse_left : mapping of output to float [SI]
        The same; of whole runs less what these errors have along what the parameters may be off in a fit without the
        run. A parameter that the other runs do not show does not count against a model.
    aic, bic : float or None
        Of the fit to all runs, with correlated noise; smaller is better.
    log_likelihood : float or None [nat]
        On which they rest.
    noise : mapping of output to FadingNoise
        Under which the held-out errors are most likely.
    shown_in_one : mapping of stage to tuple of str
        Stages that the fit to all runs determines and the fit without one run does not, with the labels of such runs.
    held : tuple of str
        Stages that not every model has, and of which nothing was free.
    """

    name: str
    fit: Fit | None = None
    free: tuple[str, ...] = ()
    reason: str = ""
    parameters: int = 0
    log_predictive: float | None = None
    rmse: Mapping[str, float] = field(default_factory=dict)
    rmse_left: Mapping[str, float] = field(default_factory=dict)
    aic: float | None = None
    bic: float | None = None
    log_likelihood: float | None = None
    noise: Mapping[str, FadingNoise] = field(default_factory=dict)
    shown_in_one: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    held: tuple[str, ...] = ()


SUPPORTED: Final = 2.0
"""Difference of a criterion up to which both models have support (Burnham and Anderson, 2002, section 2.6)."""


AS_CLOSE: Final = 1.1
"""Times the least held-out error (RMSE) up to which a model predicts as well: a tenth is visible in no figure."""


def as_close(candidates: Sequence[Candidate]) -> list[str]:
    """The models whose held-out error of every output is near the least of them.

    A record in which most of what a branch explains happens once cannot prove it by the scatter of its blocks; a
    model that misses readings by half as much again is not as good for that. But where a fit without a run does not
    know a parameter, how far it misses that run is luck, the larger model's too: what the parameters may be off does
    not count against a smaller one.

    Parameters
    ----------
    candidates : sequence of Candidate
        That the records cannot distinguish, the best prediction first: it is the answer where each misses one output.
    """
    near = [one.name for one in candidates if is_close(one, candidates) or is_close(one, candidates, left=True)]
    return near or [candidates[0].name]


def is_close(one: Candidate, candidates: Sequence[Candidate], *, left: bool = False) -> bool:
    """Whether its held-out error of every output is near the least, or what the parameters' errors ``left`` of it."""

    def errors(of: Candidate) -> Mapping[str, float]:
        return {**of.rmse, **of.rmse_left} if left else of.rmse

    return all(
        size <= AS_CLOSE * min(errors(other)[output] for other in candidates) for output, size in errors(one).items()
    )


def contained_in_excluded(
    candidates: Sequence[Candidate], differences: Mapping[tuple[str, str], Difference]
) -> dict[str, str]:
    """Models that scatter alone does not exclude, each with the excluded one of which it is a part.

    Where a branch more is not enough, none is not either: it predicted worse still, by so much that nothing is certain.

    Parameters
    ----------
    candidates : sequence of Candidate
        That could be compared, the best prediction first.
    differences : mapping of (name, name) to Difference
    """
    best, *others = candidates
    found: dict[str, str] = {}
    excluded: list[Candidate] = []
    for one in others:
        if differences[one.name, best.name].is_distinguished:
            excluded.append(one)
            continue
        larger = [other.name for other in excluded if _is_part(one, other) and _is_part(other, best)]
        if larger:
            found[one.name] = larger[0]
    return found


def _is_part(one: Candidate, other: Candidate) -> bool:
    """Whether what is free of the strip in a model is free in another too, which has more."""
    if one.fit is None or other.fit is None or one.held:
        return False
    own, others = ({n for n in of.parameters if not n.startswith("observation.")} for of in (one.fit, other.fit))
    return own < others


@dataclass(frozen=True, eq=False)
class Choice(Shown):
    """What ``choose`` returns.

    Parameters
    ----------
    candidates : tuple of Candidate
        The best prediction first; those that could not be compared last.
    preferred : str
        Of the models that the runs cannot distinguish from the best one, and whose held-out error is near the least of
        theirs, that with the fewest parameters.
    differences : mapping of (name, name) to Difference
        Between every two models that could be compared.
    held_out : "runs" or "blocks"
    blocks : int
        How many blocks were compared.
    outputs : tuple of str
        What was compared.
    labels : tuple of str
        The runs.
    readings : int
    effective_readings : float
        How many independent readings they are worth, by what the best model leaves.
    unscored : tuple of str
        Outputs that only some of the models read.
    """

    candidates: tuple[Candidate, ...]
    preferred: str
    differences: Mapping[tuple[str, str], Difference]
    held_out: HoldOut
    blocks: int
    outputs: tuple[str, ...]
    labels: tuple[str, ...]
    readings: int
    effective_readings: float
    unscored: tuple[str, ...] = ()

    @property
    def ranked(self) -> tuple[Candidate, ...]:
        """The models that could be compared, the best prediction first."""
        return tuple(one for one in self.candidates if one.log_predictive is not None)

    @property
    def best(self) -> str:
        """The model whose prediction was nearest, whether or not the runs can distinguish it from others."""
        return self.ranked[0].name

    @property
    def unfinished(self) -> tuple[str, ...]:
        """The models of which Ctrl-C ended the fits; empty where all of them were let run to their end."""
        return tuple(one.name for one in self.candidates if one.reason == UNFINISHED)

    @property
    def fit(self) -> Fit:
        """The fit of the preferred model to all runs."""
        fit = self[self.preferred].fit
        assert fit is not None
        return fit

    def __getitem__(self, name: str) -> Candidate:
        """The candidate of a name."""
        for one in self.candidates:
            if one.name == name:
                return one
        raise KeyError(name)

    def to_best(self, name: str) -> Difference | None:
        """A model against the best one; None for the best itself."""
        return self.differences.get((name, self.best))

    @property
    def sentences(self) -> tuple[str, ...]:
        """What came of it, in words."""
        lines = []
        ranked = self.ranked
        if self.unfinished:
            were = "was" if len(self.unfinished) == 1 else "were"
            lines.append(f"Interrupted: {listed(self.unfinished)} {were} not finished, and {were} not compared.")
        against = [(one, self.differences[one.name, self.best]) for one in ranked[1:]]
        parts = contained_in_excluded(ranked, self.differences)
        alike = [one for one, difference in against if not difference.is_distinguished and one.name not in parts]
        if alike:
            lines += self._why_preferred(alike)
        elif len(ranked) > 1 and parts:
            lines.append(f"{self.best} predicts best.")
        elif len(ranked) > 1:
            lines.append(f"{self.best} predicts best, and the records distinguish it from every other model.")
        else:
            lines.append(f"{self.best} is the only model that could be compared.")
        for one, difference in against:
            if difference.is_distinguished:
                size = f"{abs(difference.value):.3g} nats, standard error {difference.standard_error:.2g}"
                lines.append(f"{one.name} predicts worse than {self.best} (by {size}).")
            elif one.name in parts:
                lines.append(
                    f"{one.name} predicts worse than {self.best} by {abs(difference.value):.3g} nats, with a standard "
                    f"error of {difference.standard_error:.3g}; it is a part of {parts[one.name]}, which predicts "
                    "better than it and is excluded."
                )
        lines += [*self._by_criteria(), *self._still_lacking(), *self._left_open()]
        lines += [
            f"{one.name}: {_left_open_without(stage, labels)}. So whole runs cannot judge it: hold out blocks of time "
            "(--hold-out blocks)."
            for one in ranked
            if one.name != self.preferred or alike
            for stage, labels in one.shown_in_one.items()
        ]
        lines += [
            f"{one.name}: nothing of {listed(one.held)} is free, so that it stays at the values of the actuator, "
            "usual ones where the stage was added by name; free it too (--free), or leave --free out."
            for one in self.candidates
            if one.held
        ]
        lines += [
            f"The fit of {one.name} did not converge: see what it says of why."
            for one in ranked
            if one.fit is not None and not one.fit.converged
        ]
        failed = [one for one in self.candidates if one.reason not in ("", UNFINISHED)]
        lines += [f"{one.name} could not be compared: {one.reason}." for one in failed]
        if self.unscored:
            lines.append(f"Not every model reads the {listed(self.unscored)}: that was left out of the comparison.")
        return tuple(lines)

    def _why_preferred(self, alike: Sequence[Candidate]) -> list[str]:
        """Which models cannot be distinguished from the best, and why one of them is preferred."""
        these, own = [self[self.best], *alike], self[self.preferred]
        lines = [f"These records cannot distinguish {listed([one.name for one in these])}."]
        close = as_close(these)
        beside = "" if all(is_close(self[name], these) for name in close) else " beside what parameters may be off"
        near = f"those whose RMSE is at most {AS_CLOSE:g} times the least{beside}"
        of = "these" if len(close) == len(these) else near
        if any(self[name].parameters != own.parameters for name in close):
            reason = f"it has the fewest parameters of {of}"
        elif len(close) > 1:
            reason = f"of {of} it predicted best, and none has fewer parameters"
        elif self.preferred == self.best:
            reason = f"it predicted best, and no other one is within {AS_CLOSE:g} times the least RMSE of each output"
        else:
            reason = f"its RMSE is the least{beside}, and that of the others is more than {AS_CLOSE:g} times as large"
        lines.append(f"{self.preferred} is preferred: {reason} ({own.parameters} parameters).")
        for one in alike:
            if one.name not in close:
                difference = self.differences[one.name, self.best]
                lines.append(
                    f"{one.name} is not excluded: it predicts worse by {abs(difference.value):.3g} nats, with a "
                    f"standard error of {difference.standard_error:.3g}."
                )
        if not is_close(own, these) and is_close(own, these, left=True):
            lines.append(
                f"{own.name} misses the held-out readings by more than {AS_CLOSE:g} times the least RMSE, but no "
                "further than its parameters may be off in the fits without them."
            )
        return lines

    def _by_criteria(self) -> list[str]:
        """Where AIC or BIC is clearly less for another model than the preferred one."""
        own = self[self.preferred]
        chosen: dict[str, list[str]] = {}
        for criterion in ("aic", "bic"):
            value = {one.name: float(getattr(one, criterion)) for one in self.ranked}
            least = min(value, key=lambda name: value[name])
            if value[own.name] - value[least] > SUPPORTED:
                chosen.setdefault(least, []).append(criterion.upper())
        lines = []
        for name, criteria in chosen.items():
            one = len(criteria) == 1
            least = f"{listed(criteria)} {'is' if one else 'are'} least for {name}"
            why = "it has fewer parameters" if own.parameters < self[name].parameters else "its RMSE is less"
            lines.append(
                f"{least}, which also predicted best: {own.name} is preferred only because {why}."
                if name == self.best
                else f"{least}: {'it says' if one else 'they say'} how well a model describes the readings that it was "
                "fitted to; the order here is that of readings that were held out."
            )
        return lines

    def _still_lacking(self) -> list[str]:
        """What the preferred model leaves that is no noise: the best of some models need not be complete."""
        lacking = [one for one in self.fit.findings if one.code in LACKING]
        lines = in_brief(lacking, self.outputs, self.labels, most=len(lacking))[0]
        return [f"{self.preferred} still lacks something: {'; '.join(one.text for one in lines)}."] if lines else []

    def _left_open(self) -> list[str]:
        """Which values of the preferred model its fit to everything does not determine."""
        names = [name for name, one in self.fit.parameters.items() if not one.determined]
        if not names:
            return []
        these = "this value is" if len(names) == 1 else "these values are"
        return [
            f"The fit of {self.preferred} does not determine {first_of(names)}: a model may predict well of which "
            f"{these} open."
        ]

    def __str__(self) -> str:
        """A line for each model, and what came of it."""
        lines = [f"{len(self.ranked)} models compared on {self.blocks} held-out blocks of {len(self.labels)} run(s)"]
        for one in self.ranked:
            difference = self.to_best(one.name)
            size = (
                ""
                if difference is None
                else f", {difference.value:.3g} nats from the best (error {difference.standard_error:.2g})"
            )
            lines.append(f"  {one.name}: {one.parameters} parameters{size}")
        return "\n".join([*lines, *self.sentences])

    __repr__ = __str__

    def as_dict(self) -> dict[str, Any]:
        """The choice as ``--json`` prints it."""
        return {
            "preferred": self.preferred,
            "best": self.best,
            "held_out": self.held_out,
            "blocks": self.blocks,
            "outputs": list(self.outputs),
            "labels": list(self.labels),
            "readings": self.readings,
            "effective_readings": self.effective_readings,
            "sentences": list(self.sentences),
            "unfinished": list(self.unfinished),
            "models": [_as_dict(self, one) for one in self.candidates],
            "differences": [_difference(one) for one in self.differences.values()],
        }


def _left_open_without(stage: str, labels: Sequence[str]) -> str:
    if len(labels) == 1:
        return f"only {labels[0]} shows {stage}, and without it the fit leaves that stage open"
    return f"fits without some of {listed(labels)} leave {stage} open"


def _as_dict(choice: Choice, one: Candidate) -> dict[str, Any]:
    difference = choice.to_best(one.name) if one.log_predictive is not None else None
    return {
        "name": one.name,
        "reason": one.reason or None,
        "free": list(one.free),
        "held": list(one.held),
        "rmse_left": dict(one.rmse_left),
        "shown_in_one": {stage: list(labels) for stage, labels in one.shown_in_one.items()},
        "parameters": one.parameters,
        "converged": None if one.fit is None else one.fit.converged,
        "log_predictive": one.log_predictive,
        "to_best": None if difference is None else _difference(difference),
        "rmse": dict(one.rmse),
        "log_likelihood": one.log_likelihood,
        "aic": one.aic,
        "bic": one.bic,
        "noise": {
            output: {"white": noise.white, "parts": [part._asdict() for part in noise.parts]}
            for output, noise in one.noise.items()
        },
    }


def _difference(one: Difference) -> dict[str, Any]:
    return {
        "model": one.model,
        "other": one.other,
        "value": one.value,
        "standard_error": one.standard_error,
        "limit": one.limit,
        "told": one.is_distinguished,
    }
