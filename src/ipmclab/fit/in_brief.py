"""Findings in one line each: causes before their consequences, and what follows from an impossible record silent."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.run import Finding, Severity

MOST: Final = 5
"""Findings of a short answer."""

WIDTH: Final = 100
"""Columns of a line."""

_SEVERITIES: Final[tuple[Severity, ...]] = ("error", "warning", "info")

_READ: Final = ("current", "displacement", "force")

_FAILED: Final = ("not-converged", "model-explains-nothing")
_LACKING: Final = ("model-incomplete", "stage-missing", "model-error")
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
    "thickness-against-membrane": "the thickness of the model contradicts the data sheet of the membrane",
    "water-uptake": "the mass of the water contradicts the data sheet of the membrane",
}
"""Facts that contradict each other, in fewer words than their messages."""

_UNSURE: Final = (
    "at-bound",
    "undetermined",
    "drift-not-excluded",
    "noise-not-described",
    "noise-grows",
    "exact-fixed-value",
    "fixed-uncertainty",
)
_FOLLOWS: Final = {
    **dict.fromkeys(_FAILED, 1),
    **dict.fromkeys((*_LACKING, *_CONTRADICTS), 2),
    **dict.fromkeys(_UNSURE, 3),
}
"""How far down the chain of causes what a fit finds stands; what a record shows stands before all of it."""

_UNKNOWN: Final = 3
"""The level of what is not known: nobody asks how to know more from a record that cannot be right."""

IMPOSSIBLE: Final = {"current-rises": "current", "peak-above-series-resistance": "current", "two-states": "current"}
"""Warnings of readings that no strip with constant parameters gives, and their channel."""

_OF_CURRENT: Final = ("capacitance-out-of-range", "sine-against-step")
"""What follows from the current, though a finding names no channel."""

_SHORTEST: Final = 0.6
"""Part of a line that a clause fills before a shorter one is looked for."""

_LEAST: Final = 0.3
"""Part of a line that a clause fills at least: less says nothing."""

_BRACKETS: Final = re.compile(r" \([^()]*\)")


@dataclass(frozen=True)
class Brief:
    """A finding, or several of one kind, in one line.

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
        return f"{self.severity:<7}  {self.text}"


def in_brief(
    findings: Sequence[Finding], outputs: Collection[str] = (), labels: Sequence[str] = (), *, most: int = MOST
) -> tuple[tuple[Brief, ...], int]:
    """The most important warnings and errors in one line each, and how many findings are not said.

    Parameters
    ----------
    findings : sequence of Finding
    outputs : collection of str
        What was fitted: an error of another channel counts as a warning. Empty where all count alike.
    labels : sequence of str
        Of the runs: of a single one the label is not repeated in each line.
    most : int

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

    def rank(one: Finding) -> tuple[int, int]:
        lowered = one.severity == "error" and is_aside(one, outputs)
        return _SEVERITIES.index(one.severity) + lowered, _FOLLOWS.get(one.code, 0)

    told = sorted((one for one in consequences_silent(findings, outputs) if one.severity != "info"), key=rank)
    groups: dict[tuple[str, str | None, str], list[Finding]] = {}
    for one in told:
        groups.setdefault((one.code, one.channel, _cure(one) if one.code == "undetermined" else ""), []).append(one)
    chosen = list(groups.values())[:most]
    lines = tuple(_line(members, outputs, labels) for members in chosen)
    return lines, len(findings) - sum(map(len, chosen))


def more_in_words(more: int) -> str:
    """How many findings are not among those in brief, and where they stand."""
    return f"{more} more finding{'s' if more > 1 else ''}: --details, or the report"


def is_aside(finding: Finding, outputs: Collection[str]) -> bool:
    """Whether a finding is about readings that did not enter the fit."""
    return bool(outputs) and finding.channel in _READ and finding.channel not in outputs


def consequences_silent(findings: Sequence[Finding], outputs: Collection[str] = ()) -> list[Finding]:
    """The findings without those that follow from others among them.

    Where the record of a channel cannot be right (an error that the record itself shows, a current that no strip
    draws), what a model leaves of that channel, and what its values contradict, is no news; nor is what an error leaves
    open. Nor are single shortcomings where the model explains nothing, or where the search did not end.
    """
    of_record = [one for one in findings if one.code not in _FOLLOWS and not is_aside(one, outputs)]
    broken = {one.channel for one in of_record if one.severity == "error"}
    wrong = broken | {IMPOSSIBLE[one.code] for one in of_record if one.code in IMPOSSIBLE}
    first = min((_FOLLOWS[one.code] for one in findings if one.code in _FAILED), default=_UNKNOWN)
    named = {one.channel for one in findings if one.code in ("model-incomplete", "stage-missing")}

    def follows(one: Finding) -> bool:
        level = _FOLLOWS.get(one.code, 0)
        if level > first or (one.code == "model-error" and one.channel in named):
            return True
        if level == _UNKNOWN:
            return bool(broken)
        channel = "current" if one.code in _OF_CURRENT else one.channel
        return level > 0 and one.code != "not-converged" and not wrong.isdisjoint({channel, None})

    return [one for one in findings if not follows(one)]


def _line(members: Sequence[Finding], outputs: Collection[str], labels: Sequence[str]) -> Brief:
    one = members[0]
    room = WIDTH - 9
    if one.code == "undetermined":
        names = list(dict.fromkeys(name for member in members for name in _named(member)))
        cure = _cure(one) or "record longer, with other signals, or with less noise"
        asked = f"to determine {_listed(names)}: "
        return Brief(one.severity, one.code, asked + shortened(cure, room - len(asked)))
    runs = {label for member in members for label in labels if member.message.startswith(f"{label}: ")}
    label = next((f"{label}: " for label in labels if one.message.startswith(f"{label}: ")), "")
    text = one.message.removeprefix(label)
    text = _plain(one) or text
    before = label if len(labels) > 1 else ""
    after = f" ({len(runs)} runs alike)" if len(runs) > 1 else ""
    after += " (not in this fit)" if is_aside(one, outputs) else ""
    return Brief(one.severity, one.code, before + shortened(text, room - len(before + after)) + after)


def _plain(finding: Finding) -> str:
    """What some findings say in fewer words, where the first clause of the message is not the point; else nothing."""
    if finding.code == "contact-lost" and finding.samples:
        return f"the contact was open: at constant voltage no current flows from row {finding.samples[0][0]} on"
    if finding.code == "zero-not-shown":
        return f"the zero of the {finding.channel} does not show: the voltage is on from the first row"
    words, sigmas = _CONTRADICTS.get(finding.code), finding.values.get("sigmas")
    if not words or not isinstance(sigmas, int | float):
        return ""
    return f"{words}, by {sigmas:.2g} standard uncertainties"


def _named(finding: Finding) -> list[str]:
    """The parameters of a direction, the most moved first."""
    sizes = {name: abs(float(value)) for name, value in finding.values.items() if isinstance(value, int | float)}
    largest = max(sizes.values(), default=0.0)
    return sorted((name for name, size in sizes.items() if size > 0.3 * largest), key=lambda name: -sizes[name])


def _listed(names: Sequence[str]) -> str:
    if len(names) > 2:
        return f"{', '.join(names[:1])} and {len(names) - 1} more"
    return " and ".join(names)


def _cure(finding: Finding) -> str:
    """What would determine what is not: behind the last semicolon of the sentence."""
    return finding.message.rpartition("; ")[2] if "; " in finding.message else ""


def shortened(text: str, width: int) -> str:
    """A text in one line: whole, else without its brackets, up to the last clause that fits, else to the last word.

    Examples
    --------
    >>> shortened("the voltage reaches 1.98 V, water decomposes above 1.23 V: the model has no leak, so it differs", 60)
    'the voltage reaches 1.98 V, water decomposes above 1.23 V'
    >>> shortened("it draws 3 mA (2 mA is what the sheet says), so it leaks", 30)
    'it draws 3 mA, so it leaks'
    >>> shortened("one long clause without any end that goes on and on", 24)
    'one long clause ...'
    """
    text = " ".join(text.split())
    if len(text) <= width:
        return text
    text = _BRACKETS.sub("", text)
    if len(text) <= width:
        return text
    strong, weak = (". ", "; ", ": "), (", ",)
    for marks, least in ((strong, _SHORTEST), (weak, _SHORTEST), (strong, _LEAST), (weak, _LEAST)):
        ends = [place for mark in marks for place in _places(text, mark) if least * width <= place <= width]
        if ends:
            return text[: max(ends)]
    return textwrap.shorten(text, width, placeholder=" ...")


def _places(text: str, mark: str) -> list[int]:
    """Where a mark ends a clause."""
    return [found.start() for found in re.finditer(re.escape(mark), text)]
