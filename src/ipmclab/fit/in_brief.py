"""Findings in a sentence each: causes before their consequences, and what follows from an impossible record silent."""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.fit.rows import listed
from ipmclab.run import Finding, Severity

MOST: Final = 5
"""Findings of a short answer."""

WIDTH: Final = 100
"""Columns of a line."""

_SEVERITIES: Final[tuple[Severity, ...]] = ("error", "warning", "info")

_READ: Final = ("current", "displacement", "force")

NOT_ALLOWED: Final = "impossible-current"
"""The model's own series resistance is too high for the current that was read."""

_FAILED: Final = ("not-converged", "model-explains-nothing")
LACKING: Final = ("inrush-missed", "model-incomplete", "stage-missing", "model-error")
"""What says that the model leaves something that is no noise."""

_CONTRADICTS: Final = {
    "capacitance-out-of-range": "",
    "density-against-mass": "mass and density contradict the thickness of the model",
    "dry-mass-against-layers": "the dry mass contradicts that of membrane and plating",
    "motion-against-stiffness": "force over displacement contradicts the stiffness of the model",
    "push-against-motion": "the push contradicts force over displacement",
    "push-against-stiffness": "the push contradicts the stiffness of the model",
    "resonance-against-motion": "the ring of the flick contradicts force over displacement",
    "resonance-against-stiffness": "the ring of the flick contradicts the stiffness of the model",
    "sine-against-step": "the current under the sine contradicts that under the step",
    "thickness-against-membrane": "the model's thickness contradicts the membrane's data sheet",
    "water-uptake": "the mass of the water contradicts the data sheet of the membrane",
}
"""Facts that contradict each other, in fewer words than their messages."""

_BEYOND: Final = ("above-electrolysis", "leak-extrapolated", "near-resonance", "large-bending", "resonance-aliased")
"""Where the voltage takes the model beyond what it holds for."""

NOT_DESCRIBED: Final = "noise-not-described"
"""Intervals may be too small."""

_UNSURE: Final = (
    "at-bound",
    "undetermined",
    "law-undetermined",
    "age-inseparable",
    "drift-not-excluded",
    NOT_DESCRIBED,
    "noise-grows",
    "exact-fixed-value",
    "fixed-uncertainty",
)
_UNKNOWN: Final = 4
"""The level of what is not known: nobody needs to know more from a record that cannot be right."""

_ASIDE: Final = 8
"""The level of what did not enter the fit."""

_FOLLOWS: Final = {
    **dict.fromkeys((NOT_ALLOWED, *_FAILED), 1),
    **dict.fromkeys((*LACKING, "sensor-drift"), 2),
    **dict.fromkeys(_BEYOND, 3),
    **dict.fromkeys(_UNSURE, _UNKNOWN),
    "sampling-period-unknown": 5,
    **dict.fromkeys(_CONTRADICTS, 6),
    "edge-reading-partial": 7,
}
"""How far down the chain of causes a finding is, and how much it changes what to think of the numbers.

What a record shows comes before all of it, where it is no matter of a few rows that were left out.
"""

_PEAK: Final = "peak-above-series-resistance"
IMPOSSIBLE: Final = {"current-rises": "current", _PEAK: "current", "two-states": "current"}
"""Warnings of readings that no strip with constant parameters gives, and their channel."""

_OF_CURRENT: Final = ("capacitance-out-of-range", "sine-against-step")
"""What follows from the current, though a finding names no channel."""

_SHORTEST: Final = 0.6
"""Part of a line that a clause fills before a shorter one is looked for."""

_LEAST: Final = 0.25
"""Part of a line that a clause fills at least: less says nothing."""

_INDENT: Final = 9 * " "
"""Below the severity, in front of a line that continues."""

_NO_BREAK: Final = "\u00a0"

_ROOM: Final = WIDTH - len(_INDENT)
"""Columns of a line behind its severity."""

_LONGEST_LABEL: Final = 40
"""Columns of the name of a run, before it is shortened in its middle."""

_STRONG: Final = re.compile(r"[.;:] ")
_WEAK: Final = re.compile(r", ")
"""Marks that end a clause, and where a line may end."""

_CLAUSE: Final = 4
"""Words of a clause that a comma ends behind a stronger mark."""

_BRACKETS: Final = re.compile(r" \([^()]*\)")


@dataclass(frozen=True)
class Brief:
    """A finding, or several of one kind, in a sentence: a line, or more where it does not fit on one.

    Parameters
    ----------
    severity : "info", "warning" or "error"
    code : str
    text : str
    """

    severity: Severity
    code: str
    text: str

    def __str__(self) -> str:
        return in_lines(f"{self.severity:<7}  {self.text}", _INDENT)


def in_lines(text: str, indent: str = "") -> str:
    """A text in lines of at most 100 columns; a number stays with its percent sign, and the name of a file whole."""
    bound = text.replace(" %", f"{_NO_BREAK}%")
    lines = textwrap.fill(bound, WIDTH, subsequent_indent=indent, break_on_hyphens=False)
    return lines.replace(_NO_BREAK, " ")


def in_brief(
    findings: Sequence[Finding],
    outputs: Collection[str] = (),
    labels: Sequence[str] = (),
    *,
    most: int = MOST,
    said: Collection[str] = (),
) -> tuple[tuple[Brief, ...], int]:
    """The most important warnings and errors in a sentence each, and how many findings are not said.

    Parameters
    ----------
    findings : sequence of Finding
    outputs : collection of str
        What was fitted: an error of another channel counts as a warning. Empty where all count alike.
    labels : sequence of str
        Of the runs: of a single one the label is not repeated in each line.
    most : int
    said : collection of str
        Lines that were printed before: they are not repeated.

    Returns
    -------
    lines : tuple of Brief
    more : int

    Examples
    --------
    >>> lost = Finding("contact-lost", "error", "step.nc: no current flows for 192 rows: the contact was open")
    >>> follows = Finding("model-error", "warning", "step.nc: the model leaves 0.3 mA", channel="current")
    >>> lines, more = in_brief([follows, lost], labels=["step.nc"])
    >>> str(lines[0]), len(lines), more
    ('error    no current flows for 192 rows: the contact was open', 1, 1)
    """
    grave = [one for one in consequences_silent(findings, outputs) if one.severity != "info"]
    ordered = most_important_first(grave, outputs)
    lines = [(_line(members, outputs, labels), len(members)) for members in _alike(ordered, labels)]
    fresh = [(line, count) for line, count in lines if str(line) not in said]
    known = sum(count for line, count in lines if str(line) in said)
    chosen = fresh[:most]
    return tuple(line for line, _ in chosen), len(findings) - known - sum(count for _, count in chosen)


def most_important_first(findings: Sequence[Finding], outputs: Collection[str] = ()) -> list[Finding]:
    """Findings by their severity, then by what they change: causes first, what scales the numbers later, asides last.

    Parameters
    ----------
    findings : sequence of Finding
    outputs : collection of str
        What was fitted; empty where all count alike.
    """

    def rank(one: Finding) -> tuple[int, int]:
        if one.severity != "info" and is_aside(one, outputs):
            return _SEVERITIES.index("warning"), _ASIDE
        return _SEVERITIES.index(one.severity), _FOLLOWS.get(one.code, 0)

    return sorted(findings, key=rank)


def more_in_words(more: int, where: str) -> str:
    """How many findings are not among those in brief, and where they stand.

    Examples
    --------
    >>> more_in_words(2, "see fit.findings")
    '2 more findings: see fit.findings'
    """
    return f"{more} more finding{'s' if more > 1 else ''}: {where}"


def is_aside(finding: Finding, outputs: Collection[str]) -> bool:
    """Whether a finding is about readings that did not enter the fit."""
    return bool(outputs) and finding.channel in _READ and finding.channel not in outputs


def consequences_silent(findings: Sequence[Finding], outputs: Collection[str] = ()) -> list[Finding]:
    """The findings without those that follow from others among them.

    Where the record of a channel cannot be right (an error that the record itself shows, a current that no strip
    draws), what a model leaves of that channel, and what its values contradict, is no news; nor is what an error leaves
    open. Where the model itself does not allow the current, no news is that its peak says so too, nor how badly the
    model follows it. Nor are single shortcomings where the model explains nothing, or where the search did not end.
    """
    of_record = [one for one in findings if one.code not in _FOLLOWS and not is_aside(one, outputs)]
    broken = {one.channel for one in of_record if one.severity == "error"}
    wrong = broken | {IMPOSSIBLE[one.code] for one in of_record if one.code in IMPOSSIBLE}
    first = min((_FOLLOWS[one.code] for one in findings if one.code in _FAILED), default=_ASIDE)
    named = {one.channel for one in findings if one.code in ("model-incomplete", "stage-missing")}
    not_allowed = {one.channel for one in findings if one.code == NOT_ALLOWED}

    def follows(one: Finding) -> bool:
        level = _FOLLOWS.get(one.code, 0)
        if one.code == NOT_ALLOWED:
            return not broken.isdisjoint({one.channel, None})
        if one.code in ("model-explains-nothing", _PEAK, *LACKING) and one.channel in not_allowed:
            return True
        if level > first or (one.code == "model-error" and one.channel in named):
            return True
        if level == _UNKNOWN:
            return bool(wrong)
        channel = "current" if one.code in _OF_CURRENT else one.channel
        return level > 0 and one.code != "not-converged" and not wrong.isdisjoint({channel, None})

    return [one for one in findings if not follows(one)]


def _alike(findings: Sequence[Finding], labels: Sequence[str]) -> list[list[Finding]]:
    """The findings that one line reports: what has one cure, and what several runs have alike.

    Of one run, and of a fit as a whole, each finding is reported by itself: only the first of a line is read.
    """
    groups: dict[tuple[object, ...], list[Finding]] = {}
    seen: Counter[tuple[str, str | None, str]] = Counter()
    for one in findings:
        label = _label(one, labels)
        of_run = one.code, one.channel, label
        which = (_cure(one),) if one.code == "undetermined" else (bool(label), seen[of_run])
        seen[of_run] += 1
        groups.setdefault((one.code, one.channel, *which), []).append(one)
    return list(groups.values())


def _label(finding: Finding, labels: Sequence[str]) -> str:
    """The run that a message begins with; empty where it is about all."""
    return next((label for label in labels if finding.message.startswith(f"{label}: ")), "")


def _line(members: Sequence[Finding], outputs: Collection[str], labels: Sequence[str]) -> Brief:
    one = members[0]
    if one.code == "undetermined":
        names = list(dict.fromkeys(name for member in members for name in _named(member)))
        cure = _cure(one) or "record longer, with other signals, or with less noise"
        return Brief(one.severity, one.code, f"{_asked(names, cure)}: {cure}")
    label = _label(one, labels)
    before = f"{_without_middle(label, _LONGEST_LABEL)}: " if label and len(labels) > 1 else ""
    after = f" ({len(members)} runs alike)" if len(members) > 1 else ""
    after += " (not in this fit)" if is_aside(one, outputs) else ""
    message = one.message.removeprefix(f"{label}: ") if label else one.message
    text = _plain(one) or shortened(message, _ROOM - len(before + after))
    return Brief(one.severity, one.code, before + text + after)


def _without_middle(text: str, width: int) -> str:
    """A name in so many columns: files of one series often differ in their beginning or in their end.

    Examples
    --------
    >>> _without_middle("monday-humid-strip-7-step-1V-a.nc", 20)
    'monday-hu...-1V-a.nc'
    """
    if len(text) <= width:
        return text
    last = (width - 3) // 2
    return f"{text[: width - 3 - last]}...{text[-last:]}"


def _plain(finding: Finding) -> str:
    """What some findings say in fewer words, where the first clause of the message is not the point; else nothing."""
    values, channel = finding.values, finding.channel
    match finding.code:
        case "contact-lost" if finding.samples:
            start, stop = finding.samples[0]
            return f"the contact was open: at constant voltage no current flows from row {start} to row {stop - 1}"
        case "contact-missing" if finding.samples:
            start, stop = finding.samples[0]
            return f"no current flows from row {start} to row {stop - 1}, so the fit takes the voltage as 0 V there"
        case "current-rises" if "hidden" in values:
            return "the current rises at constant voltage; the growing leak of this model is not visible"
        case "current-rises":
            return "the current rises at constant voltage, which only a leak that grows (leak.slow) can follow"
        case "model-incomplete":
            return finding.message.partition(". ")[0]
        case "stage-missing" if "stage" in values:
            share = f"{100.0 * float(values.get('explained') or 0.0):.0f} %"
            return f"stage {values['stage']} explains {share} of the {channel}'s residual beyond noise"
        case "above-electrolysis" if "largest_voltage" in values:
            none = "the leak of the model gives no current there" if "leaks" in values else "the model has no leak"
            return f"water decomposes at {values['largest_voltage']:.3g} V, and {none}"
        case "large-bending" if "drift" in values:
            reached, limit = (f"{1e3 * float(values[key] or 0.0):.4g} mm" for key in ("largest_displacement", "limit"))
            return (
                f"without its sensor's drift the predicted displacement reaches {reached}, more than a small bending "
                f"of {limit}"
            )
        case "sampling-period-unknown" if "period" in values:
            return (
                f"the sampling period is assumed ({values['period']:.4g} s): all times and permittivities scale with it"
            )
        case "zero-not-shown":
            return f"the zero of the {channel} does not show: the voltage is on from the first row"
    words, sigmas = _CONTRADICTS.get(finding.code), values.get("sigmas")
    if not words or not isinstance(sigmas, int | float):
        return ""
    return f"{words}, by {sigmas:.2g} standard uncertainties"


def _named(finding: Finding) -> list[str]:
    """The parameters of a direction, the most moved first."""
    sizes = {name: abs(float(value)) for name, value in finding.values.items() if isinstance(value, int | float)}
    largest = max(sizes.values(), default=0.0)
    return sorted((name for name, size in sizes.items() if size > 0.3 * largest), key=lambda name: -sizes[name])


def _asked(names: Sequence[str], cure: str) -> str:
    """What is to be determined: two names, or as many as go with the cure on a line, else the most moved and how many.

    Examples
    --------
    >>> _asked(["coupling.gain", "coupling.zero", "coupling.p2"], "record faster")
    'to determine coupling.gain, coupling.zero and coupling.p2'
    """
    every = listed(names)
    first = f"{names[0]} and {len(names) - 1} more" if len(names) > 1 else every
    for clauses, room in ((every, len(cure) if len(names) > 2 else 0), (first, 0)):
        if clauses and len(f"to determine {clauses}: ") + room <= _ROOM:
            return f"to determine {clauses}"
    return f"to determine {len(names) or 'more'} parameter{'' if len(names) == 1 else 's'}"


def _cure(finding: Finding) -> str:
    """What would determine what is not: behind the last semicolon of the sentence."""
    return finding.message.rpartition("; ")[2] if "; " in finding.message else ""


def shortened(text: str, width: int) -> str:
    """A text: whole where it fits, else without its brackets, up to the last clause that fits.

    A first clause that is longer is printed in full.

    Examples
    --------
    >>> shortened("the voltage reaches 1.98 V, water decomposes above 1.23 V: the model has no leak, so it differs", 60)
    'the voltage reaches 1.98 V, water decomposes above 1.23 V'
    >>> shortened("it draws 3 mA (2 mA is what the sheet says), so it leaks", 30)
    'it draws 3 mA, so it leaks'
    >>> shortened("one long clause without any end that goes on and on; then another", 24)
    'one long clause without any end that goes on and on'
    """
    text = " ".join(text.split())
    if len(text) <= width:
        return text
    text = _BRACKETS.sub("", text)
    if len(text) <= width:
        return text
    for marks, least in ((_STRONG, _SHORTEST), (_WEAK, _SHORTEST), (_STRONG, _LEAST), (_WEAK, _LEAST)):
        ends = [found.start() for found in marks.finditer(text) if least * width <= found.start() <= width]
        whole = [end for end in ends if marks is _STRONG or _is_clause(text[:end])]
        if whole:
            return text[: max(whole)]
    longer = (found.start() for found in _STRONG.finditer(text) if found.start() > width)
    return text[: next(longer, len(text))]


def _is_clause(text: str) -> bool:
    """Whether a text may end here: not a word or two behind the last mark (": of step-1.nc"), which begin a clause."""
    *before, last = _STRONG.split(text)
    return not before or len(last.split()) >= _CLAUSE
