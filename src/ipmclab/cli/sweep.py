"""``ipmclab sweep``: many simulations of one strip, over a design or a table of parameter sets."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from ipmclab.cli.files import check_output, write_template
from ipmclab.cli.options import Json, Scheduler, Workers
from ipmclab.cli.output import print_json, print_table, progress, significant
from ipmclab.cli.plot import SUFFIXES
from ipmclab.errors import InputError
from ipmclab.platform import as_typed

if TYPE_CHECKING:
    from ipmclab.model.device import Device
    from ipmclab.sweep import Swept


def sweep(
    file: Annotated[Path | None, typer.Argument(metavar="SWEEP.toml", help="The sweep.", show_default=False)] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Where its Parquet files go; a sweep that was stopped continues in its folder.",
            show_default=False,
        ),
    ] = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
    device: Annotated[
        str,
        typer.Option(
            metavar="auto|cpu|gpu",
            help="Who carries the rows: a GPU (extra gpu) gives the same numbers to 1e-12. auto takes one where it is "
            "there and the sweep is long.",
        ),
    ] = "auto",
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.svg|.png|.pdf",
            help="Write a figure: indices or effects, and each metric against each parameter.",
            show_default=False,
        ),
    ] = None,
    template: Annotated[bool, typer.Option("--template", help="Write a sweep to fill in, to --out.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace the template, or the figure, if it exists.")] = False,
    as_json: Json = False,
) -> None:
    """Simulate a strip with thousands to billions of parameter sets, and keep a few numbers of each.

    \b
    ipmclab sweep --template --out stiffness.toml
    ipmclab sweep stiffness.toml --out stiffness
    ipmclab sweep stiffness.toml --out stiffness --workers 4 --plot stiffness.svg
    """
    if template:
        from ipmclab.sweep.template import TEMPLATE

        then = f"ipmclab sweep {as_typed(out)} --out {as_typed(out.parent / out.stem)}" if out is not None else ""
        write_template(TEMPLATE, file, out, verb="sweep", then=then, force=force, as_json=as_json)
        return
    if file is None or out is None:
        what, where = ("sweep", "SWEEP.toml") if file is None else ("folder for the results", "--out")
        raise InputError(
            f"there is no {what}",
            code="missing-argument",
            where=where,
            repair="write for example: ipmclab sweep stiffness.toml --out stiffness",
        )
    from ipmclab.destination import keep_what_is_read
    from ipmclab.engine import opened
    from ipmclab.sweep import read_sweep, run_sweep

    keep_what_is_read(out, [file], where=f"--out {out}")
    if plot is not None:
        check_output(plot, force=force, suffixes=SUFFIXES, reads=[file], option="--plot")
    asked = read_sweep(file)
    with progress(f"sweeping {asked.actuator.name}") as tell, opened(scheduler=scheduler, workers=workers) as engine:
        swept = run_sweep(asked, out, engine=engine, progress=tell, device=cast("Device", device))
        document = _document(swept) | {"plot": plot}
        if plot is not None:
            from ipmclab.reporting.sweep import plot_sweep

            plot_sweep(swept, plot, overwrite=force)
    if as_json:
        print_json(document)
        return
    _print(swept, document)
    if plot is not None:
        print(f"wrote {plot}")


def _document(swept: Swept) -> dict[str, Any]:
    parts = swept.parts
    indices = swept.indices()
    return {
        "out": parts.folder,
        "sets": parts.count,
        "files": parts.files,
        "files_found": swept.found,
        "metrics": {
            name: {
                "smallest": one.smallest,
                "mean": one.mean,
                "largest": one.largest,
                "standard_deviation": one.standard_deviation,
                "missing": one.missing,
            }
            for name, one in swept.distributions().items()
        },
        "sobol_indices": {
            metric: {
                parameter: {
                    "first": one.first,
                    "first_interval": one.first_interval,
                    "total": one.total,
                    "total_interval": one.total_interval,
                }
                for parameter, one in of_metric.items()
            }
            for metric, of_metric in indices.items()
        },
        "morris_effects": {
            metric: {
                parameter: {
                    "mean": one.mean,
                    "magnitude": one.magnitude,
                    "magnitude_interval": one.magnitude_interval,
                    "standard_deviation": one.standard_deviation,
                }
                for parameter, one in of_metric.items()
            }
            for metric, of_metric in swept.effects().items()
        },
    }


def _print(swept: Swept, document: dict[str, Any]) -> None:
    from ipmclab.model.reductions import quantity_of

    def shown(metric: str, value: float, digits: int = 5) -> str:
        return significant(quantity_of(metric).to_display(value), digits)

    rows = [
        [
            *(name, *(shown(name, one[key]) for key in ("smallest", "mean", "largest", "standard_deviation"))),
            quantity_of(name).display_unit,
        ]
        for name, one in document["metrics"].items()
    ]
    title = f"{swept.sweep.actuator.name} under {swept.sweep.signal}, {swept.parts.count} sets"
    print_table(["metric", "smallest", "mean", "largest", "standard deviation", "unit"], rows, title=title)
    for name, one in document["metrics"].items():
        if one["missing"]:
            print(
                f"{name}: {one['missing']} of {swept.parts.count} sets have no reading, as where a laser loses the "
                "strip; they are left out"
            )
    for metric, of_metric in document["sobol_indices"].items():
        rows = [
            [parameter, _of(one["first"], one["first_interval"]), _of(one["total"], one["total_interval"])]
            for parameter, one in of_metric.items()
        ]
        print_table(["parameter", "first index (95 %)", "total index (95 %)"], rows, title=f"Sobol indices of {metric}")
    for metric, of_metric in document["morris_effects"].items():
        rows = [
            [
                parameter,
                _of(one["magnitude"], one["magnitude_interval"], partial(shown, metric, digits=3)),
                shown(metric, one["mean"], 3),
                shown(metric, one["standard_deviation"], 3),
            ]
            for parameter, one in of_metric.items()
        ]
        head = ["parameter", "magnitude (95 %)", "mean", "standard deviation"]
        print_table(
            head, rows, title=f"Morris's effects on {metric} along each range, in {quantity_of(metric).display_unit}"
        )
    if swept.found:
        print(f"{swept.found} of {swept.parts.files} files were there already")
    print(f"wrote {swept.parts.folder}")


def _of(value: float, ends: tuple[float, float], say: Callable[[float], str] = "{:.3f}".format) -> str:
    return f"{say(value)} ({say(ends[0])} to {say(ends[1])})"
