"""What strips of one make do, as ``ipmclab compare --posterior`` prints it, beside the interval of the mixed model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ipmclab.cli.output import print_paragraph, print_remarks, print_table, read

if TYPE_CHECKING:
    from ipmclab.comparison.metric_model import MetricModel
    from ipmclab.comparison.population import Population

_CONDITIONS = 12
"""That a terminal shows of one metric; --json has all."""


def print_populations(found: Mapping[str, Population], unknown: Mapping[str, str]) -> None:
    """Print scatter, next strip and strips apart of each metric, with how the chains did."""
    for name, one in found.items():
        print()
        rows = [_next_cells(one, condition) for condition in one.model.conditions()]
        print_table(["the next strip", "middle", "95 % by the posterior", "by the mixed model"], rows[:_CONDITIONS])
        if len(rows) > _CONDITIONS:
            print(f"{len(rows) - _CONDITIONS} more conditions: see --json")
        words = ", ".join(f"{each.name} {_spread(one.model, each.median, each.interval)}" for each in one.scatter)
        print_paragraph(f"{name}: one standard deviation between {words}.")
        unlike = [each for each in one.strips_apart if each.is_unlike]
        for each in unlike:
            size = f"x {each.value:.3g}" if one.model.is_ratio else _read(one.model, each.value)
            print_paragraph(
                f"{each.sample} is unlike the others: {size} of what they let expect (p = {each.p_value:.2g})."
            )
        if one.strips_apart and not unlike:
            print_paragraph(f"None of {len(one.strips_apart)} strips is unlike the others.")
        worst = max(each.convergence.r_hat for each in one.scatter)
        least = min(min(each.convergence.bulk, each.convergence.tail) for each in one.scatter)
        print_paragraph(
            f"The chains agree after {one.steps} steps: R-hat is at most {worst:.4f}, with {least:.0f} effective "
            "samples or more."
        )
    print_remarks([f"{name}: nothing is told of the next strip: {why}" for name, why in unknown.items()])


def populations_document(found: Mapping[str, Population], unknown: Mapping[str, str]) -> dict[str, Any]:
    """The same as it stands in a JSON document."""
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
                "next_strip": [_next_document(one, condition) for condition in one.model.conditions()],
                "strips_apart": [vars(each) for each in one.strips_apart],
                "steps": one.steps,
                "seed": one.seed,
            }
            for name, one in found.items()
        },
        "unknown": dict(unknown),
    }


def _next_document(one: Population, condition: Mapping[str, float]) -> dict[str, Any]:
    (mean, of_mean), (value, interval) = one.mean(condition), one.next_strip(condition)
    mixed = one.model.next_strip(condition)
    return {
        "condition": condition,
        "mean": {"value": mean, "interval": of_mean},
        "value": value,
        "interval": interval,
        "by_mixed_model": None if mixed is None else {"value": mixed[0], "interval": mixed[1]},
    }


def _next_cells(one: Population, condition: Mapping[str, float]) -> list[str]:
    named = {factor.name: factor for factor in one.model.factors}
    where = ", ".join(f"{named[name].label} {named[name].show(value)}" for name, value in condition.items())
    value, interval = one.next_strip(condition)
    mixed = one.model.next_strip(condition)
    by_mixed = "not known" if mixed is None else _interval(one.model, mixed[1])
    return [where or "as measured", _read(one.model, value), _interval(one.model, interval), by_mixed]


def _read(model: MetricModel, value: float) -> str:
    from ipmclab.comparison.display import quantity_of

    return read(value, quantity_of(model.metric.unit), digits=3)


def _interval(model: MetricModel, interval: tuple[float, float]) -> str:
    return f"{_read(model, interval[0])} to {_read(model, interval[1])}"


def _spread(model: MetricModel, median: float, interval: tuple[float, float]) -> str:
    """A scatter as people read it: of magnitudes the factor that one standard deviation is."""
    if model.is_ratio:
        low, middle, high = (math.exp(min(each, 700.0)) for each in (interval[0], median, interval[1]))
        return f"a factor {middle:.3g} ({low:.3g} to {high:.3g})"
    return f"{_read(model, median)} ({_interval(model, interval)})"
