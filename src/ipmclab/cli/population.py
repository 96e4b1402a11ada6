"""What strips of one make do, as ``ipmclab compare --posterior`` prints it, with the interval of the mixed model."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from ipmclab.cli.output import print_paragraph, print_remarks, print_table, read

if TYPE_CHECKING:
    from ipmclab.comparison.metric_model import MetricModel
    from ipmclab.comparison.population import OfCondition, Population

_CONDITIONS = 12
"""That a terminal shows of one metric; --json has all."""


def print_populations(found: Mapping[str, Population], unknown: Mapping[str, str]) -> None:
    """Print scatter, next strip and deviating strips of each metric, with how the chains did."""
    from ipmclab.comparison.population_words import sentences

    for name, one in found.items():
        print(f"\n{name}")
        rows = [_next_cells(one.model, estimate) for estimate in one.conditions()]
        print_table(["the next strip", "middle", "95 % by the posterior", "by the mixed model"], rows[:_CONDITIONS])
        if len(rows) > _CONDITIONS:
            print(f"{len(rows) - _CONDITIONS} more conditions: see --json")
        for words in sentences(one, partial(_read, one.model)):
            print_paragraph(words)
    print_remarks([f"{name}: nothing is known of the next strip: {why}" for name, why in unknown.items()])


def populations_document(found: Mapping[str, Population], unknown: Mapping[str, str]) -> dict[str, Any]:
    """The same as it is written to a JSON document."""
    return {
        "metrics": {
            name: {
                "waveform": one.model.waveform,
                "metric": one.model.key,
                "is_ratio": one.model.is_ratio,
                "scatter": [
                    {
                        "of": each.name,
                        "standard_deviation": each.median,
                        "interval": each.interval,
                        "r_hat": each.convergence.r_hat,
                        "effective_samples": each.convergence.bulk,
                        "effective_samples_in_tails": each.convergence.tail,
                    }
                    for each in one.scatter
                ],
                "next_strip": [_next_document(estimate) for estimate in one.conditions()],
                "strips_apart": [vars(each) for each in one.strip_deviations],
                "steps": one.steps,
                "seed": one.seed,
            }
            for name, one in found.items()
        },
        "unknown": dict(unknown),
    }


def _next_document(estimate: OfCondition) -> dict[str, Any]:
    (mean, of_mean), (value, interval), mixed = estimate.mean, estimate.next_strip, estimate.by_mixed_model
    return {
        "condition": estimate.condition,
        "mean": {"value": mean, "interval": of_mean},
        "value": value,
        "interval": interval,
        "by_mixed_model": None if mixed is None else {"value": mixed[0], "interval": mixed[1]},
    }


def _next_cells(model: MetricModel, estimate: OfCondition) -> list[str]:
    named = {factor.name: factor for factor in model.factors}
    where = ", ".join(f"{named[name].label} {named[name].show(value)}" for name, value in estimate.condition.items())
    value, interval = estimate.next_strip
    by_mixed = "not known" if estimate.by_mixed_model is None else _interval(model, estimate.by_mixed_model[1])
    return [where or "as measured", _read(model, value), _interval(model, interval), by_mixed]


def _read(model: MetricModel, value: float) -> str:
    from ipmclab.comparison.display import quantity_of

    return read(value, quantity_of(model.metric.unit), digits=3)


def _interval(model: MetricModel, interval: tuple[float, float]) -> str:
    return f"{_read(model, interval[0])} to {_read(model, interval[1])}"
