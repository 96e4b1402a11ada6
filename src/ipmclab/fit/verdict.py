"""The verdict on a fit: whether it can be used, for what, and how well it follows its readings."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING, Final

from ipmclab.fit.in_brief import IMPOSSIBLE, NOT_ALLOWED, NOT_DESCRIBED, consequences_silent, is_aside
from ipmclab.fit.rows import KNOWN, listed, size_in_words
from ipmclab.units import CHANNELS, significant

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit, FittedParameter

REFUSED: Final = "Do not use this fit"
"""How the verdict on a fit that is of no use begins."""

_EXPLAINS_NOTHING: Final = "model-explains-nothing"

_DOUBTS: Final = (
    "inrush-missed",
    "model-error",
    "model-incomplete",
    "stage-missing",
    *IMPOSSIBLE,
)
_ROUGH: Final = 15.0  # percent of the range, from which nobody calls a curve followed
_ALL: Final = {2: "both"}  # the word for so many
_SHOWN: Final = 3  # residuals that a sentence lists


def verdict(fit: Fit, missed: Collection[str] = ()) -> str:
    """Whether a fit can be used, for what, and how well it follows the readings: a sentence or two.

    Parameters
    ----------
    fit : Fit
    missed : collection of str
        Outputs that it did not predict of other runs.
    """
    outputs = list(dict.fromkeys(name for one in fit.observations for name in one.noise))
    refused = _why_not(fit, outputs)
    if refused:
        return f"{REFUSED}: {refused}."
    worst, followed = _followed(fit, outputs)
    what = listed(CHANNELS[name].name for name in outputs)
    use = f"This fit can be used to predict the {what}"
    lost = [CHANNELS[name].name for name in outputs if name in missed]
    if lost:
        use = f"This fit follows the {what} of its own runs, but does not predict the {listed(lost)} of every other run"
    elif (worst is not None and worst > _ROUGH) or any(one.code in IMPOSSIBLE for one in fit.findings):
        use = f"This fit predicts the {what} only roughly"
    if not lost and _only_like_its_own_runs(fit):
        use += f"{' and' if use.endswith('roughly') else ''} only for voltages and durations like those of its own runs"
    return f"{use} ({followed}); {_of_parameters(fit)}."


def _only_like_its_own_runs(fit: Fit) -> bool:
    """Whether nobody knows what the strip does under other voltages than those of the runs.

    Where water decomposes the current is in no proportion to the voltage: what a model without a leak takes for a
    resistance is one of the voltages that were applied.
    """
    return _hardly_determined(fit) or any(one.code == "above-electrolysis" for one in fit.findings)


def _hardly_determined(fit: Fit) -> bool:
    """Whether so little that a fit found is known of the strip itself that it follows its own records, and no more.

    Parameters of an observation (a zero, a delay) belong to a record. Of a model that lacks something most of the
    others must be determined: what it lacks goes into those that are free to move.
    Of any other one is enough, and where all exchange with each other, the quantities that they leave fixed predict
    other voltages as well.
    """
    own = _of_strip(fit)
    found = sum(one.determined for one in own)
    if lacks_something(fit):
        return 2 * found < len(own)
    return bool(own) and not found and not fit.known


def _of_strip(fit: Fit) -> list[FittedParameter]:
    """The parameters of the strip itself, without the zeros and delays of its records."""
    return [one for name, one in fit.parameters.items() if not name.startswith("observation.")]


def _why_not(fit: Fit, outputs: Sequence[str]) -> str:
    """Why a fit is of no use; empty where it is of some."""
    if not outputs:
        return "it holds no readings"
    if not fit.converged:
        return "the search did not end at a best fit"
    errors = [
        one
        for one in consequences_silent(fit.findings, outputs)
        if one.severity == "error" and not is_aside(one, outputs)
    ]
    # The first names what is lost; that a model allows no such current is no fault of a record either.
    nothing = next((one for one in fit.findings if one.code == _EXPLAINS_NOTHING), None)
    lost = f"the model does not follow the {CHANNELS[nothing.channel or outputs[0]].name}" if nothing else ""
    wrong = [one for one in errors if one.code not in (_EXPLAINS_NOTHING, NOT_ALLOWED)]
    if not wrong and any(one.code == NOT_ALLOWED for one in errors):
        return "the model's series resistance does not allow the measured current"
    if wrong:
        which = sorted({CHANNELS[one.channel].name for one in wrong if one.channel in CHANNELS})
        of = f" of the {listed(which)}" if which else ""
        return f"the record{of} is wrong, as the first finding says{f', and {lost}' if lost else ''}"
    return lost


def _of_parameters(fit: Fit) -> str:
    """What may be said of the values."""
    if any(finding.code == "mountings-differ" for finding in fit.findings):
        return "its values are averages of mountings that differ: fit each mounting by itself"
    unknown = sum(not one.determined for one in fit.parameters.values())
    lacks = lacks_something(fit)
    count, own = len(fit.parameters), _of_strip(fit)
    if not count:
        text = "no parameter was free"
    elif unknown == count:
        text = "none of its parameters is determined" if count > 1 else "its parameter is not determined"
    elif len(own) > 1 and not any(one.determined for one in own):
        text = f"none of the strip's {len(own)} parameters is determined"
    elif unknown:
        text = f"{unknown} of its {count} parameters {'is' if unknown == 1 else 'are'} not determined"
    else:
        text = (
            "its parameter is determined"
            if count == 1
            else f"{_ALL.get(count, f'all {count}')} parameters are determined"
        )
    if lacks:
        text += (
            ", and the model lacks something: the values describe this model, not yet the strip"
            if unknown or not count
            else ", but the model lacks something: they describe this model, not yet the strip"
        )
    elif unknown and fit.known:
        text += f", but the quantities under '{KNOWN}' are known"
    if (count > unknown or fit.known) and any(finding.code == NOT_DESCRIBED for finding in fit.findings):
        text += "; intervals may be too small, for no noise model describes what is left"
    return text


def _followed(fit: Fit, outputs: Sequence[str]) -> tuple[float | None, str]:
    """The largest residual [percent of the range], and how far each output of each run is followed, in words."""
    each = list(_residuals(fit))
    worst = max((percent for _, _, percent in each if percent is not None), default=None)
    if len(each) == 1:
        ((label, output, percent),) = each
        return (
            worst,
            f"residual {_size(fit, label, output, percent)}{' of the range' if worst is not None else ''} in {label}",
        )
    largest = [max((one for one in each if one[1] == output), key=lambda one: one[2] or -1.0) for output in outputs]
    shown = each if len(each) <= _SHOWN else largest
    most = "at most " if len(each) > len(shown) else ""
    lines = []
    for output in outputs:
        own = [f"{_size(fit, label, output, percent)} in {label}" for label, of, percent in shown if of == output]
        lines.append(f"{CHANNELS[output].name + ' ' if len(outputs) > 1 else ''}{most}{', '.join(own)}")
    return worst, f"residual{', relative to the range' if worst is not None else ''}: {'; '.join(lines)}"


def _residuals(fit: Fit) -> Iterator[tuple[str, str, float | None]]:
    """Run, output, and residual in percent of the range of what was read; None where a file does not say."""
    for observation in fit.observations:
        for output, size in observation.noise.items():
            span = observation.span.get(output, 0.0)
            yield observation.label, output, 100.0 * size / span if span > 0.0 else None


def _size(fit: Fit, label: str, output: str, percent: float | None) -> str:
    """A residual in words."""
    if percent is not None:
        return f"{significant(percent, 2)} %"
    size = next(one.noise[output] for one in fit.observations if one.label == label and output in one.noise)
    return size_in_words(size, output)


def lacks_something(fit: Fit) -> bool:
    """Whether a warning says that the model lacks something."""
    return any(finding.code in _DOUBTS and finding.severity != "info" for finding in fit.findings)
