"""What a fit says in short: a table, one verdict, and the few findings that matter most."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from ipmclab.fit.in_brief import (
    IMPOSSIBLE,
    NOT_ALLOWED,
    Brief,
    consequences_silent,
    in_brief,
    in_lines,
    is_aside,
    more_in_words,
)
from ipmclab.units import CHANNELS, TIME, Quantity, significant

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit, FittedParameter

REFUSED: Final = "Do not use this fit"
"""How the verdict on a fit that is of no use begins."""

NOT_DETERMINED: Final = "not determined"

IN_PYTHON: Final = "see fit.findings"
"""Where the findings stand that a short answer does not say, for who has the fit itself."""

_EXPLAINS_NOTHING: Final = "model-explains-nothing"

_DOUBTS: Final = (
    "inrush-missed",
    "model-error",
    "model-incomplete",
    "stage-missing",
    "noise-not-described",
    "drift-not-excluded",
    *IMPOSSIBLE,
)
_ROUGH: Final = 15.0  # percent of the range, from which nobody calls a curve followed
_DRIFTS: Final = {
    "current": Quantity("drift of the current", "A/s", "uA/s"),
    "displacement": Quantity("drift of the displacement", "m/s", "um/s"),
    "force": Quantity("drift of the force", "N/s", "uN/s"),
}
_ALL: Final = {2: "both"}  # the word for so many
_SHOWN: Final = 3  # residuals that a sentence lists


KNOWN: Final = "known from these readings"
"""The title of the quantities that are known where parameters are not determined."""


@dataclass(frozen=True)
class Row:
    """One number of a table, as people read it.

    Parameters
    ----------
    name, value, interval, unit : str
    remark : str
        That it is at its bound, what was known beforehand, or on which fixed value it leans.
    determined : bool
    """

    name: str
    value: str
    interval: str
    unit: str
    remark: str = ""
    determined: bool = True


@dataclass(frozen=True)
class Answer:
    """The short answer of a fit.

    Parameters
    ----------
    parameters : tuple of Row
    known : tuple of Row
        What the readings determine; shown where some parameter is not determined.
    verdict : str
    findings : tuple of Brief
    more : int
        Findings that are not among them.
    known_title : str
        The title of what is known.
    """

    parameters: tuple[Row, ...]
    known: tuple[Row, ...]
    verdict: str
    findings: tuple[Brief, ...]
    more: int
    known_title: str = KNOWN

    @property
    def is_refused(self) -> bool:
        """Whether the fit is of no use: its numbers do not stand in the short answer."""
        return self.verdict.startswith(REFUSED)

    @property
    def rows(self) -> tuple[tuple[Row, ...], tuple[Row, ...]]:
        """The parameters, and what is known where one is not determined; nothing of a fit of no use."""
        if self.is_refused:
            return (), ()
        return self.parameters, () if all(row.determined for row in self.parameters) else self.known

    def __str__(self) -> str:
        return self.text()

    def text(self, where: str = IN_PYTHON) -> str:
        """The answer in lines; ``where`` the other findings stand.

        Sentences and findings have at most 100 columns, a row of the table as many as its names need.
        """
        lines = [] if self.is_refused else _lines(*self.rows, self.known_title)
        lines.append(in_lines(self.verdict))
        lines += [str(one) for one in self.findings]
        if self.is_refused and self.parameters:
            lines.append(f"its values{f' and {self.more} more findings' if self.more else ''}: {where}")
        elif self.more:
            lines.append(more_in_words(self.more, where))
        return "\n".join(lines)


def answer_of(fit: Fit, before: Fit | None = None) -> Answer:
    """The short answer of a fit, without the findings of one that was answered before."""
    outputs = list(dict.fromkeys(name for one in fit.observations for name in one.noise))
    labels = [one.label for one in fit.observations]
    said = [str(one) for one in answer_of(before).findings] if before is not None else []
    findings, more = in_brief(fit.findings, outputs, labels, said=said)
    return Answer(parameter_rows(fit), known_rows(fit), verdict(fit), findings, more, known_title(fit))


def summary_of(fit: Fit, where: str = IN_PYTHON, before: Fit | None = None) -> str:
    """The short answer as text; ``where`` the other findings stand, which fit was answered ``before``."""
    return answer_of(fit, before).text(where)


def parameter_rows(fit: Fit) -> tuple[Row, ...]:
    """The free parameters, in the units that people read."""
    rows = []
    for name, one in fit.parameters.items():
        row = _row(name, one.value, one.interval, quantity_of(fit, name), one.unit)
        remark = "at its bound" if one.at_bound else prior_in_words(one)
        value = row.value if one.determined else NOT_DETERMINED
        rows.append(Row(row.name, value, row.interval, row.unit, remark, one.determined))
    return tuple(rows)


def prior_in_words(one: FittedParameter) -> str:
    """That something was known of a parameter beforehand, and who knew it; empty where nothing was."""
    if one.prior is None:
        return ""
    return "with the literature's prior" if one.prior_of_literature else "with its prior"


def quantity_of(fit: Fit, name: str) -> Quantity | None:
    """What a parameter of a fit is: of the actuator, shared or of one run, or of an observation."""
    base = name.partition("[")[0]
    known = fit.actuator.parameters()
    if base in known:
        return known[base].quantity
    if base == "observation.delay":
        return TIME
    output = base.rsplit(".", 1)[-1]
    return (CHANNELS if base.startswith("observation.offset") else _DRIFTS).get(output)


def known_rows(fit: Fit) -> tuple[Row, ...]:
    """The quantities that the readings determine, in the units that people read."""
    rows = []
    for one in fit.known:
        row = _row(one.words, one.value, one.interval, one.quantity, one.quantity.unit)
        fixed = one.leans[0].rpartition(".")[2].replace("_", " ") if one.leans else ""
        rows.append(replace(row, remark=f"if {fixed} is exact" if fixed else ""))
    return tuple(rows)


def known_title(fit: Fit) -> str:
    """Their title: of a model that lacks something their intervals say nothing of what it lacks."""
    return KNOWN + (", if the model holds" if lacks_something(fit) else "")


def lacks_something(fit: Fit) -> bool:
    """Whether a warning says that the model lacks something."""
    return any(finding.code in _DOUBTS and finding.severity != "info" for finding in fit.findings)


def _row(name: str, value: float, interval: tuple[float, float], quantity: Quantity | None, unit: str) -> Row:
    shown = quantity.to_display if quantity is not None else float
    low, high = shown(interval[0]), shown(interval[1])
    is_open = math.isinf(low) or math.isinf(high)
    digits = 3 if is_open else digits_of(shown(value), high - low)
    return Row(
        name,
        significant(shown(value), digits),
        interval_in_words(low, high, digits),
        quantity.display_unit if quantity is not None else unit,
    )


def digits_of(value: float, width: float) -> int:
    """Significant digits of a value that show two digits of the width of its interval."""
    if not (0.0 < width < math.inf) or value == 0.0 or not math.isfinite(value):
        return 4
    # Not of the ratio, which may be beyond all numbers.
    return min(max(2 + math.ceil(math.log10(abs(value)) - math.log10(width)), 3), 12)


def interval_in_words(low: float, high: float, digits: int) -> str:
    """An interval, an open one in words.

    Examples
    --------
    >>> interval_in_words(612.0, 880.4, 3), interval_in_words(0.0, 2.34, 3), interval_in_words(287.3, math.inf, 3)
    ('612 to 880', 'below 2.34', 'above 287')
    >>> interval_in_words(0.0, math.inf, 3), interval_in_words(-math.inf, math.inf, 3)
    ('any positive value', 'any value')
    """
    open_below = low == 0.0 or math.isinf(low)
    if open_below and math.isinf(high):
        return "any positive value" if low == 0.0 else "any value"
    if math.isinf(high):
        return f"above {significant(low, digits)}"
    if open_below:
        return f"below {significant(high, digits)}"
    return f"{significant(low, digits)} to {significant(high, digits)}"


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
    what = _listed(CHANNELS[name].name for name in outputs)
    use = f"This fit can be used to predict the {what}"
    lost = [CHANNELS[name].name for name in outputs if name in missed]
    if lost:
        use = f"This fit follows the {what} of its own runs, but does not predict the {_listed(lost)} of others"
    elif (worst is not None and worst > _ROUGH) or any(one.code in IMPOSSIBLE for one in fit.findings):
        use = f"This fit predicts the {what} only roughly"
    if not lost and hardly_determined(fit):
        use += f"{' and' if use.endswith('roughly') else ''} only for voltages and durations like those of its own runs"
    return f"{use} ({followed}); {_of_parameters(fit)}."


def hardly_determined(fit: Fit) -> bool:
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
        of = f" of the {_listed(which)}" if which else ""
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


def size_in_words(size: float, output: str) -> str:
    """A residual [SI] in the unit that people read.

    Examples
    --------
    >>> size_in_words(1.97e-3, "current")
    '1.97 mA'
    """
    quantity = CHANNELS[output]
    return f"{significant(quantity.to_display(size), 3)} {quantity.display_unit}"


def _lines(rows: Sequence[Row], known: Sequence[Row], title: str) -> list[str]:
    """The table as lines; what is known is below the parameters in the same columns."""
    remarks = any(row.remark for row in (*rows, *known))
    head = ["parameter", "value", "95 % interval", "unit", *([""] if remarks else [])]

    def cells(row: Row) -> list[str]:
        return [row.name, row.value, row.interval, row.unit, *([row.remark] if remarks else [])]

    table = [head, *map(cells, rows)]
    second = [[title, *[""] * (len(head) - 1)], *map(cells, known)] if known else []
    widths = [max(len(row[column]) for row in (*table, *second)) for column in range(len(head))]

    def line(row: Sequence[str]) -> str:
        name, value, interval, *rest = row
        first = f"{name:<{widths[0]}}  {value:>{widths[1]}}  {interval:>{widths[2]}}"
        return "  ".join([first, *(f"{cell:<{width}}" for cell, width in zip(rest, widths[3:], strict=True))]).rstrip()

    return [line(row) for row in (*table, *second)]


def _listed(items: Iterable[str]) -> str:
    *most, last = list(items) or [""]
    return f"{', '.join(most)} and {last}" if most else last
