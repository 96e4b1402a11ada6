"""The report of a campaign: one HTML file."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

from ipmclab.campaign.blocks import BASELINE, Block
from ipmclab.campaign.campaign import Campaign, Strip
from ipmclab.campaign.identified import SampleModel
from ipmclab.campaign.methods import comparing, identification, methods
from ipmclab.campaign.published import CURLED_FOR, Curled, Reproduced, curled, reproduced, unprinted
from ipmclab.campaign.results import Repeated, RunResult, by_repeat
from ipmclab.comparison.compare import Comparison
from ipmclab.errors import InputError
from ipmclab.measurement.curl import curl
from ipmclab.quality.metrics import is_later
from ipmclab.reporting.comparison import comparison_figures
from ipmclab.reporting.figures.campaign import MOST_COLUMNS, records_figure
from ipmclab.reporting.page_file import render, write_page
from ipmclab.reporting.sample_models import ModelPart, model_part
from ipmclab.reporting.svg import inline_svg
from ipmclab.reporting.wording import NO_BREAK, in_parts, plain, spelled_unit, with_error, with_unit
from ipmclab.units import AREAL_MASS, CHANNELS, LENGTH, MASS, Quantity

COLUMNS: Final[Mapping[str, Mapping[str, tuple[str, str]]]] = {
    "current": {
        "step": ("current", "peak_at_first_edge"),
        "square": ("current", "largest"),
        "": ("current", "amplitude"),
    },
    "current later": {"step": ("current", "mean_of_last_tenth"), "square": ("current", "half_period_end")},
    "response": {
        "step": ("response", "largest"),
        BASELINE: ("response", "largest"),
        "": ("response", "amplitude"),
    },
    "time to peak": {"step": ("response", "time_to_peak")},
    "back relaxation": {"step": ("response", "back_relaxation")},
}
"""By column and waveform: the channel and the metric that the report shows; all of them are in the table beside it."""


NO_EXCITATION: Final = "no-excitation"

_FINEST: Final = 1e-4
"""A scatter that is a smaller part of a value is not reported: nobody reads so many digits."""


@dataclass(frozen=True)
class Row:
    """One kind of run."""

    part: str
    condition: str
    label: str
    repeats: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class SamplePart:
    """What a report says of one sample."""

    name: str
    about: tuple[tuple[str, str], ...]
    head: tuple[str, ...]
    rows: tuple[Row, ...]
    findings: tuple[str, ...]
    pictures: tuple[tuple[Markup, str], ...]
    models: tuple[ModelPart, ...]


def report_campaign(
    campaign: Campaign,
    blocks: Sequence[Block],
    results: Sequence[RunResult],
    events: Sequence[Mapping[str, Any]],
    path: str | Path,
    *,
    comparison: Comparison | None = None,
    models: Sequence[SampleModel] = (),
    overwrite: bool = False,
) -> Path:
    """Write one self-contained HTML file about a campaign.

    Parameters
    ----------
    campaign : Campaign
    blocks : sequence of Block
    results : sequence of RunResult
    events : sequence of mapping
        What was done.
    path : str or Path
        Ending in .html.
    comparison : Comparison, optional
        Of the runs that were kept: its figures stand in the report.
    models : sequence of SampleModel
        What was identified of the samples.
    overwrite : bool
        Whether an existing file may be replaced.
    """
    repeated = by_repeat(results)
    printed = reproduced(repeated)
    last = {one["run"]: one for one in events if one["event"] == "recorded"}
    flagged = [one for one in last.values() if one["verdict"] == "flagged"]

    def page() -> str:
        return render(
            "campaign.html.j2",
            filters={"in_parts": in_parts},
            title=campaign.title,
            subtitle=f"{len(results)} runs of {len(campaign.strips)} samples on {campaign.rig.name}",
            sentences=[*_sentences(results, len(flagged), printed, blocks), *_of_models(models)],
            doubt=bool(flagged) or not all(one.agrees for one in printed),
            printed=[_printed_row(one) for one in printed],
            curled=[_curled(one) for one in curled(repeated)],
            unprinted=unprinted(repeated, printed),
            samples=list(_samples(campaign, repeated, events, models)),
            comparisons=[] if comparison is None else list(_comparisons(comparison)),
            flagged=flagged,
            methods=(*methods(campaign, blocks, events), *identification(models), *comparing(comparison)),
            file=campaign.text,
        )

    return write_page(page, path, overwrite=overwrite)


def _sentences(
    results: Sequence[RunResult], flagged: int, printed: Sequence[Reproduced], blocks: Sequence[Block]
) -> list[str]:
    asked = sum(len(block.runs) for block in blocks)
    kept = sum(one.verdict == "kept" for one in results)
    lines = [f"{kept} of {asked} runs were recorded and passed their checks."]
    if flagged:
        lines.append(f"{flagged} {'is flagged and counts' if flagged == 1 else 'are flagged and count'} in no table.")
    if printed:
        agree = sum(one.agrees for one in printed)
        lines.append(
            f"Of {len(printed)} numbers that chapter 5 prints of these runs, {agree} are met within their tolerance."
        )
    return lines


def _of_models(models: Sequence[SampleModel]) -> Iterator[str]:
    samples = dict.fromkeys(one.sample for one in models)
    without = {one.sample for one in models if one.fit is None}
    if samples:
        yield f"A model of {len(samples) - len(without)} of {len(samples)} samples was identified from its own runs."
    if without:
        yield f"Not so of {', '.join(name for name in samples if name in without)}: its section says why."


def _printed_row(one: Reproduced) -> dict[str, Any]:
    quantity, bound = one.quantity, "> " if one.published.qualifier == "lower_bound" else ""
    return {
        "sample": one.published.sample,
        "figure": one.published.figure,
        "signal": one.signal,
        "condition": one.published.conditions,
        "metric": one.published.metric.replace("_", " "),
        "printed": bound + one.published.number.replace(" ", NO_BREAK),
        "found": with_unit(one.mean, quantity),
        "difference": f"{100.0 * one.difference:+.1f}{NO_BREAK}%".replace("-", "−"),
        "tolerance": f"±{100.0 * one.tolerance:.0f}{NO_BREAK}%",
        "agrees": one.agrees,
    }


def _curled(one: Curled) -> str:
    printed = (one.published.number or "").replace(" ", NO_BREAK)
    return (
        f"Sample {one.published.samples[0]} curled about {printed} in {CURLED_FOR / 60.0:g}{NO_BREAK}min in the room "
        f"without a voltage (figure {one.published.figure}); here it is {with_unit(one.distance, LENGTH)}."
    )


def _comparisons(comparison: Comparison) -> Iterator[tuple[str, str, Markup]]:
    """Title, caption and picture of each figure of a comparison."""
    for one in comparison_figures(comparison):
        name = re.sub(r"[^A-Za-z0-9]+", "-", f"compared-{one.name}")
        yield one.title, one.caption, inline_svg(one.draw(), name, one.title)


def _samples(
    campaign: Campaign,
    repeated: Sequence[Repeated],
    events: Sequence[Mapping[str, Any]],
    models: Sequence[SampleModel],
) -> Iterator[SamplePart]:
    for strip in campaign.strips:
        ours = [one for one in repeated if one.sample == strip.sample.id and one.results]
        facts = [one for one in events if one["event"] == "fact" and one["sample"] == strip.sample.id]
        shown = [column for column in COLUMNS if any(_found(one, column) is not None for one in ours)]
        rows = tuple(
            Row(one.part, one.condition, one.label, len(one.results), tuple(_cell(one, column) for column in shown))
            for one in ours
        )
        about = (*_about(strip), *_facts(facts), *_curls(ours))
        identified = tuple(model_part(one) for one in models if one.sample == strip.sample.id)
        pictures = tuple(_pictures(strip.sample.id, ours))
        findings = tuple(_findings(ours))
        yield SamplePart(strip.sample.id, about, tuple(shown), rows, findings, pictures, identified)


def _about(strip: Strip) -> Iterator[tuple[str, str]]:
    sample = strip.sample
    for name, value in (
        ("membrane", sample.membrane),
        ("electrode", sample.electrode),
        ("plated by", sample.plated_by),
    ):
        if value:
            yield name, value
    quantities: tuple[tuple[str, float | None, Quantity], ...] = (
        ("nominal thickness of the membrane", sample.nominal_membrane_thickness, LENGTH),
        ("plating loading", sample.plating_loading, AREAL_MASS),
    )
    for name, number, quantity in quantities:
        if number is not None:
            yield name, with_unit(number, quantity)


def _facts(facts: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    for one in facts:
        factor, unit = (1e6, MASS.display_unit) if one["unit"] == "kg" else (1.0, one["unit"])
        factor, unit = (100.0, "%") if not one["unit"] else (factor, unit)
        value = with_error(factor * one["value"], factor * one["uncertainty"])
        yield str(one["name"]), f"{value}{NO_BREAK}{spelled_unit(unit)} ({one['how']})"


def _findings(ours: Sequence[Repeated]) -> Iterator[str]:
    """What was found in the runs that count: each code once, with the runs that have it."""
    codes: dict[str, list[str]] = {}
    said: dict[str, dict[str, None]] = {}
    for kind in ours:
        for result in kind.results:
            for code in result.findings:
                if (kind.label, code) == (BASELINE, NO_EXCITATION):  # it is what a baseline is
                    continue
                codes.setdefault(code, []).append(f"{kind.part}, {kind.condition}, {kind.label}")
                said.setdefault(code, {})[result.said.get(code, "")] = None
    for code, runs in codes.items():
        counts = Counter(runs)
        listed = [name if count == 1 else f"{name} ({count} runs)" for name, count in counts.items()]
        first, *others = [text for text in said[code] if text] or [""]
        words = f"{first}{', or alike' if others else ''} ({code})" if first else code
        yield f"{words}: {'; '.join(listed)}"


def _curls(ours: Sequence[Repeated]) -> Iterator[tuple[str, str]]:
    """How fast the tip moves without a voltage, compared with what a test at 1 V shows."""
    steps = [one for one in ours if (one.measured, one.label) == ("displacement", "step 1 V")]
    expected = [size[0] for one in steps if (size := one.mean("displacement", "largest")) is not None]
    for one in ours:
        if one.measured != "displacement" or one.label != BASELINE or not expected:
            continue
        with suppress(InputError):  # shorter than a test
            found = curl(one.results[0].record, abs(expected[0]))
            low, high = (plain(1e6 * end, 2) for end in found.interval)
            can = {
                "yes": "tests are possible",
                "no": "no test is possible",
                "open": "the record is too short to decide",
            }
            yield f"curl, {one.condition}", f"{low} to {high}{NO_BREAK}µm/s (95 %): {can[found.verdict]}"


def _found(one: Repeated, column: str) -> tuple[str, str, tuple[float, float, int]] | None:
    """A column of one kind of run: channel, metric, and mean, standard deviation and count over the repeats."""
    of = COLUMNS[column]
    key = of.get(one.label.partition(" ")[0], of.get(""))
    if key is None:
        return None
    channel = one.measured if key[0] == "response" else key[0]
    mean = one.mean(channel, key[1])
    return None if mean is None else (channel, key[1], mean)


def _cell(one: Repeated, column: str) -> str:
    """Mean and standard deviation of a metric over its repeats."""
    found = _found(one, column)
    if found is None:
        return "–"
    channel, name, (mean, deviation, _) = found
    mean = abs(mean) if (channel, name) == ("current", "largest") else mean  # of a square: either polarity
    if name == "time_to_peak":
        above = "above " if any(is_later(metric) for metric in one.metrics(channel, name)) else ""
        return f"{above}{plain(mean)}{NO_BREAK}s"
    if name == "back_relaxation":
        return f"{plain(100.0 * mean, 2)}{NO_BREAK}%"
    quantity = CHANNELS[channel]
    if math.isnan(deviation) or deviation < _FINEST * abs(mean):
        return with_unit(mean, quantity, 4)
    value = with_error(quantity.to_display(mean), quantity.to_display(deviation))
    return f"{value}{NO_BREAK}{spelled_unit(quantity.display_unit)}"


def _pictures(sample: str, ours: Sequence[Repeated]) -> Iterator[tuple[Markup, str]]:
    for part, groups in groupby(ours, key=lambda one: one.part):
        kinds = list(groups)
        for start in range(0, len(kinds), MOST_COLUMNS):
            shown = kinds[start : start + MOST_COLUMNS]
            name = re.sub(r"[^A-Za-z0-9]+", "-", f"{sample}-{part}-{start}")
            kind = ", ".join(dict.fromkeys(f"{one.label} at {one.condition}" for one in shown))
            caption = f"{part}: {kind.replace('at room', 'in the room')}; each repeat in its own colour."
            yield inline_svg(records_figure(shown), name, f"{sample}, {caption}"), caption
