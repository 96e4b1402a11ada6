"""``ipmclab compare``: runs of strips, dates and laboratories side by side."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ipmclab.cli.compare_fits import compare_fits_of
from ipmclab.cli.files import actuator_files, check_output
from ipmclab.cli.options import Force, Json
from ipmclab.cli.output import counting, print_json, print_paragraph, print_remarks, print_table, progress
from ipmclab.cli.population import populations_document, print_populations
from ipmclab.errors import InputError

if TYPE_CHECKING:
    from ipmclab.comparison.compare import Comparison
    from ipmclab.comparison.metric_model import Effect, MetricModel
    from ipmclab.comparison.population import Population

NAMELESS = "{count} of the runs name no sample: in effects each counts as a strip of its own"
"""What a terminal says of runs whose strip may be any."""

_COLUMNS = 5
"""Runs side by side in a terminal."""

_LISTED = 40
"""Effects that a terminal shows; the page and --json have all."""

_DOUBTFUL = 5
"""Runs with errors that a terminal names."""


def compare(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...",
            help="Runs (.nc), or folders of them; or fits (.toml) of one strip each.",
            show_default=False,
        ),
    ],
    by: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FACTORS",
            help="thickness, loading, voltage, frequency, humidity, temperature, clamp_pressure; may be repeated and "
            "joined by commas. All that differ unless given.",
        ),
    ] = None,
    metric: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="For example displacement.largest; may be repeated.")
    ] = None,
    strip: Annotated[
        list[str] | None,
        typer.Option(metavar="ACTUATOR", help="Dimensions of a sample, for strain and work density; may be repeated."),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.html", help="The page to write.")] = None,
    data: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where every table and figure is written as CSV and SVG.")
    ] = None,
    posterior: Annotated[
        bool,
        typer.Option(
            "--posterior",
            help="Sample what strips of this make do: scatter, the next strip, strips that differ (extra bayes).",
        ),
    ] = False,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Compare runs: effects, laws, frequency responses, the next strip.

    \b
    ipmclab compare runs --by thickness,voltage --out compare.html
    ipmclab compare runs --metric displacement.largest --posterior
    ipmclab compare strip-1.toml strip-2.toml strip-3.toml --posterior
    """
    if any(path.suffix == ".toml" for path in runs):
        compare_fits_of(runs, (by, metric, strip, out, data), posterior=posterior, as_json=as_json)
        return
    from ipmclab.comparison.compare import compare as compare_runs
    from ipmclab.comparison.factors import chosen_factors
    from ipmclab.model import load_actuator

    chosen_factors(by or [])
    runs = list(_files(runs))
    read: list[Path | str] = [*runs, *actuator_files(*(strip or []))]
    if out is not None:
        check_output(out, force=force, suffixes=(".html",), reads=read)
    if data is not None and not data.is_dir():
        raise InputError(
            "there is no such folder", code="no-such-folder", where=f"--data {data}", repair="make it, then try again"
        )
    strips = [_strip_with_sample(name, load_actuator(name)) for name in strip or []]
    with counting("reading runs") as tell:
        found = compare_runs(runs, by=by or [], metrics=metric or [], strips=strips, on_progress=tell)
    if not found.rows:
        raise InputError(
            f"none of {len(found.unread)} files is a run; the first: {found.unread[0].message}",
            code="no-runs",
            where=found.unread[0].run,
            repair="give runs (.nc); import foreign records first",
        )
    sampled = _sampled(found) if posterior else None
    asked = {"--by": [",".join(by)] if by else [], "--metric": metric or [], "--strip": strip or []}
    written = _write(found, sampled, out, data, _command(runs, asked, posterior=posterior), force=force)
    if as_json:
        sampled_document = None if sampled is None else populations_document(*sampled)
        print_json({**_document(found), "populations": sampled_document, "out": out, "data": data, "files": written})
        return
    _print(found)
    if sampled is not None:
        print_populations(*sampled)
    for path in [out, data]:
        if path is not None:
            print(f"wrote {path}")


def _sampled(found: Comparison) -> tuple[dict[str, Population], dict[str, str]]:
    from ipmclab.comparison.population import populations_of

    with counting("sampling metrics") as tell:
        return populations_of(found, on_progress=tell)


def _files(places: list[Path]) -> Iterator[Path]:
    """The files that are meant: of a folder every run file below it, in the order of their names."""
    from ipmclab.store.catalogue.sweep import run_files

    seen: set[Path] = set()  # a file that is named twice is one run

    def new(path: Path) -> Iterator[Path]:
        if path.resolve() not in seen:
            seen.add(path.resolve())
            yield path

    for place in places:
        if not place.is_dir():
            yield from new(place)
            continue
        below = sorted(name for name, _ in run_files(place, []))
        if not below:
            raise InputError(
                "there is no run file in this folder",
                code="no-runs",
                where=str(place),
                repair="name the folder that holds the runs (.nc)",
            )
        for name in below:
            yield from new(place / name)


def _strip_with_sample(name: str, strip: Any) -> Any:
    if strip.sample is None:
        raise InputError(
            "the actuator names no sample, so that no run can be its own",
            code="no-sample",
            where=f"--strip {name}",
            repair="give its file a table [sample] with the id that the runs have",
        )
    return strip


def _command(runs: list[Path], options: Mapping[str, list[str]], *, posterior: bool) -> str:
    """The command as a page keeps it: of many runs the first."""
    shown = [*map(str, runs[:3]), *(["..."] if len(runs) > 3 else [])]
    said = [word for name, values in options.items() for value in values for word in (name, value)]
    return shlex.join(["ipmclab", "compare", *shown, *said, *(["--posterior"] if posterior else [])])


def _write(
    found: Comparison,
    sampled: tuple[dict[str, Population], dict[str, str]] | None,
    out: Path | None,
    data: Path | None,
    command: str,
    *,
    force: bool,
) -> list[Path]:
    if out is None and data is None:
        return []
    with progress("drawing"):
        from ipmclab.reporting.comparison import write_comparison, write_comparison_data

        written = []
        if out is not None:
            written.append(write_comparison(found, out, posterior=sampled, command=command, overwrite=force))
        if data is not None:
            written += write_comparison_data(found, data, posterior=sampled, overwrite=force)
    return written


def _print(found: Comparison) -> None:
    strips = len({row.strip for row in found.rows})
    print(f"{len(found.rows)} runs of {strips} strip{'' if strips == 1 else 's'}")
    rows = [
        _effect_cells(model, effect)
        for model in found.models
        for effect in model.effects()
        if effect.factor in found.by
    ]
    if rows:
        print_table(["metric", "factor", "from", "to", "effect", "95 % interval", "p"], rows[:_LISTED])
        if len(rows) > _LISTED:
            print(f"{len(rows) - _LISTED} more effects: see --out and --json")
    elif found.rows:
        _print_runs(found)
    for trend in found.trends:
        if trend.key.endswith((".largest", ".amplitude")):
            print_paragraph(f"{trend.waveform}, {trend.key} over {trend.factor.label}: {trend}.")
    for name, strip_deviations in found.strip_deviations.items():
        unlike = [one.sample for one in strip_deviations if one.is_unlike]
        if unlike:
            print_paragraph(f"{name}: {', '.join(unlike)} unlike the other strips.")
    remarks = [f"{one.run} is left out: {one.message}" for one in found.unread]
    remarks += found.only_noise
    if found.nameless:
        remarks.append(NAMELESS.format(count=found.nameless))
    if found.doubtful:
        doubtful = list(found.doubtful)
        have, count = ("has", "counts") if len(doubtful) == 1 else ("have", "count")
        more = f" and {len(doubtful) - _DOUBTFUL} more" if len(doubtful) > _DOUBTFUL else ""
        remarks.append(
            f"{len(doubtful)} of the runs {have} findings of severity error, and {count} nevertheless: "
            f"{', '.join(doubtful[:_DOUBTFUL])}{more}; see ipmclab check"
        )
    reasons = dict.fromkeys(
        f"{effect.factor.label}: {effect.reason}"
        for model in found.models
        for effect in model.effects()
        if effect.reason
    )
    together = dict.fromkeys(
        f"{name} changes together with {' and '.join(others)}: their effects cannot be separated"
        for model in found.models
        for name, others in model.together.items()
    )
    print_remarks([*remarks, *reasons, *together])


def _print_runs(found: Comparison) -> None:
    """Where no effect is reported: why, and the numbers of each run."""
    from ipmclab.cli.output import read
    from ipmclab.comparison.display import metric_label, quantity_of

    if found.why_no_effects:
        print_paragraph(f"{found.why_no_effects}.")
    if len(found.rows) > _COLUMNS:
        print("the metrics of each run: see --out and --json")
        return
    rows = []
    for waveform in found.waveforms:
        for key in found.keys_of(waveform):
            metrics = [row.metrics.get(key) if row.waveform == waveform else None for row in found.rows]
            cells = ["-" if one is None else read(one.value, quantity_of(one.unit), digits=3) for one in metrics]
            rows.append([f"{waveform}: {metric_label(key)}", *cells])
    if rows:
        print_table(["metric", *(row.run for row in found.rows)], rows)


def _effect_cells(model: MetricModel, effect: Effect) -> list[str]:
    from ipmclab.cli.output import read
    from ipmclab.comparison.display import quantity_of

    def show(value: float) -> str:
        return f"x {value:.3g}" if model.is_ratio else read(value, quantity_of(model.metric.unit), digits=3)

    return [
        f"{model.waveform}: {model.label}",
        effect.factor.label,
        effect.factor.show(effect.low),
        effect.factor.show(effect.high),
        show(effect.value),
        "not known" if effect.interval is None else f"{show(effect.interval[0])} to {show(effect.interval[1])}",
        "-" if effect.p_value is None else f"{effect.p_value:.2g}",
    ]


def _document(found: Comparison) -> dict[str, Any]:
    return {
        "runs": [
            {
                "run": row.run,
                "sample": row.sample or None,
                "mounting": row.mounting or None,
                "date": row.date or None,
                "signal": row.signal or None,
                "waveform": row.waveform or None,
                "baseline": row.baseline or None,
                "factors": row.values,
                "metrics": {
                    key: {"value": one.value, "unit": one.unit, "interval": one.interval, "definition": one.definition}
                    for key, one in row.metrics.items()
                },
            }
            for row in found.rows
        ],
        "effects": [
            {
                "waveform": model.waveform,
                "metric": model.key,
                "unit": model.metric.unit,
                "is_ratio": model.is_ratio,
                "runs": len(model.rows),
                "strips": len({row.strip for row in model.rows}),
                "variances": model.fit.variances,
                "factor": effect.factor.name,
                "low": effect.low,
                "high": effect.high,
                "value": effect.value,
                "interval": effect.interval,
                "p_value": effect.p_value,
                "reason": effect.reason or None,
            }
            for model in found.models
            for effect in model.effects()
        ],
        "trends": [
            {
                "waveform": trend.waveform,
                "metric": trend.key,
                "factor": trend.factor.name,
                "levels": trend.levels,
                "runs": trend.runs,
                "laws": [vars(one) for one in trend.laws],
                "not_excluded": trend.not_excluded,
            }
            for trend in found.trends
        ],
        "next_strip": [
            {
                "waveform": model.waveform,
                "metric": model.key,
                "condition": condition,
                "value": next_one[0],
                "interval": next_one[1],
            }
            for model in found.models
            for condition in model.conditions()
            for next_one in [model.next_strip(condition)]
            if next_one is not None
        ],
        "strips_apart": {name: [vars(one) for one in each] for name, each in found.strip_deviations.items()},
        "frequency_responses": [
            {
                "run": run,
                "channel": one.channel,
                "frequency": one.frequency,
                "real": one.response.real,
                "imaginary": one.response.imag,
                "noise_error": one.noise_error,
                "standard_error": one.standard_error,
                "noise_rms": one.noise_rms,
                "even_rms": one.even_rms,
                "odd_rms": one.odd_rms,
                "output_rms": one.output_rms,
                "periods": one.periods,
            }
            for run, responses in found.responses.items()
            for one in responses
        ],
        "sine_responses": [vars(one) for one in found.sine_responses],
        "performances": [vars(one) for one in found.performances],
        "doubtful": found.doubtful,
        "noise": found.noise,
        "unread": [vars(one) for one in found.unread],
    }
