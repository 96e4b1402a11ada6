"""Whether effects over few strips are told rightly: Monte-Carlo at metric level, with known truth.

Run ``python -m benchmarks.comparison [--trials 2000] [--sampled 100] [--peer 0] [--record]``; with statsmodels beside
it, by ``uv run --with statsmodels python -m benchmarks.comparison --peer 200``. Campaigns are drawn as rows of a table:
strips of two thicknesses (a factor e^0.5 between them) in three humidities (e^0.3), a sham (the loading, which does
nothing) that also differs between strips. Strips, mountings and repeats scatter normally on the logarithm, and in one
kind what the humidity does to a strip. Counted: how
often the 95 % interval of each effect holds the truth, how often the sham is found at 5 %, how often a strip that was
not measured reads within the interval of the next strip, how often a strip is named unlike the others though none is.
The first of each kind are sampled too (``population``), beside the mixed model's answer to the same campaigns. Seed
20261121.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.harness import finish
from ipmclab.comparison.factors import FACTORS
from ipmclab.comparison.metric_model import MetricModel, model_metric
from ipmclab.comparison.population import population_of
from ipmclab.comparison.table import RunRow
from ipmclab.errors import IpmclabError
from tests.comparison.campaigns import campaign

SOURCES = (
    "src/ipmclab/comparison/mixed.py",
    "src/ipmclab/comparison/metric_model.py",
    "src/ipmclab/comparison/over_strips.py",
    "src/ipmclab/comparison/population.py",
    "src/ipmclab/comparison/factors.py",
    "tests/comparison/campaigns.py",
)

SEED = 20261121
_TITLE = "Effects over few strips"
EFFECTS = {"thickness": 0.5, "loading": 0.0, "humidity": 0.3}
SPANS = {"thickness": 0.07e-3, "loading": 0.05, "humidity": 20.0}


@dataclass(frozen=True)
class Design:
    """A kind of campaign: how many strips, how they scatter, which share of the runs is lost, and how differently
    strips answer to the humidity.
    """

    name: str
    strips: int
    scatter: tuple[float, float, float]
    mountings: int = 2
    repeats: int = 2
    lost: float = 0.0
    answers: float = 0.0


DESIGNS = (
    Design("8 strips, 2 mountings, 2 repeats, nothing lost", 8, (0.3, 0.1, 0.1)),
    Design("7 strips, a quarter of the runs lost", 7, (0.3, 0.1, 0.1), lost=0.25),
    Design("7 strips, 1 mounting, a quarter lost", 7, (0.3, 0.0, 0.1), mountings=1, lost=0.25),
    Design("12 strips that hardly differ, a quarter lost", 12, (0.03, 0.1, 0.1), lost=0.25),
    Design("6 strips, all scatter between strips", 6, (0.5, 0.02, 0.05), repeats=1),
    Design("8 strips that answer differently, a quarter lost", 8, (0.3, 0.1, 0.1), lost=0.25, answers=0.2),
)


def drawn(draw: np.random.Generator, design: Design) -> tuple[list[RunRow], RunRow]:
    """The rows of a campaign, and one of a further strip."""
    of_strip = design.mountings * 3 * design.repeats
    rows = campaign(
        draw,
        effects=(EFFECTS["thickness"], EFFECTS["humidity"]),
        scatter=design.scatter,
        strips=design.strips + 1,
        mountings=design.mountings,
        repeats=design.repeats,
        answers=design.answers,
    )
    rows, further = rows[:-of_strip], rows[-of_strip:]
    kept = draw.random(len(rows)) >= design.lost
    return [row for row, is_kept in zip(rows, kept, strict=True) if is_kept], further[int(draw.integers(of_strip))]


def counted(design: Design, trials: int) -> Iterator[str]:
    draw = np.random.default_rng(SEED)
    held = dict.fromkeys(EFFECTS, 0)
    judged, found, forecast, named, told = 0, 0, 0, 0, 0
    for _ in range(trials):
        rows, further = drawn(draw, design)
        model = model_metric("displacement.largest", "step", rows, tuple(FACTORS.values()))
        assert model is not None
        effects = {effect.factor.name: effect for effect in model.effects()}
        if any(effect.interval is None for effect in effects.values()) or len(effects) < len(EFFECTS):
            continue
        judged += 1
        for name, effect in effects.items():
            truth = math.exp(EFFECTS[name] * (effect.high - effect.low) / SPANS[name])
            assert effect.interval is not None
            held[name] += effect.interval[0] <= truth <= effect.interval[1]
        found += (effects["loading"].p_value or 0.0) < 0.05
        following = model.next_strip(further.values)
        assert following is not None
        forecast += following[1][0] <= further.metrics["displacement.largest"].value <= following[1][1]
        if told < trials // 4:
            told += 1
            named += any(one.is_unlike for one in model.strip_deviations())
    cells = [held["thickness"], held["loading"], held["humidity"], found, forecast]
    shown = " | ".join(f"{100.0 * cell / judged:.1f} %" for cell in cells)
    yield f"| {design.name} | {judged} | {shown} | {100.0 * named / told:.1f} % |"


def sampled(design: Design, trials: int) -> str:
    """The next strip by the posterior, and by the mixed model, of the same campaigns."""
    draw = np.random.default_rng(SEED)
    held, wide, named, told, refused = [0, 0], [], [0, 0], 0, 0
    for _ in range(trials):
        rows, further = drawn(draw, design)
        model = model_metric("displacement.largest", "step", rows, tuple(FACTORS.values()))
        assert model is not None
        following = model.next_strip(further.values) if len(model.factors) == len(EFFECTS) else None
        if following is None:
            continue
        try:
            found = population_of(model)
        except IpmclabError:
            refused += 1
            continue
        told += 1
        truth = further.metrics["displacement.largest"].value
        ends = found.next_strip(further.values)[1], following[1]
        for place, (low, high) in enumerate(ends):
            held[place] += low <= truth <= high
        wide.append(math.log(ends[0][1] / ends[0][0]) / math.log(ends[1][1] / ends[1][0]))
        for place, each in enumerate((found.strip_deviations, model.strip_deviations())):
            named[place] += any(one.is_unlike for one in each)
    shares = [100.0 * one / max(told, 1) for one in (*held, *named)]
    return (
        f"| {design.name} | {told} | {shares[0]:.1f} % | {shares[1]:.1f} % | {np.median(wide):.2f} | "
        f"{shares[2]:.1f} % | {shares[3]:.1f} % | {refused} |"
    )


def of_peer(design: Design, trials: int) -> str:
    """The same campaigns by statsmodels' MixedLM: strips as groups, mountings as a variance component within them."""
    import statsmodels.api  # type: ignore[import-not-found]  # not among what is installed

    draw = np.random.default_rng(SEED)
    held, found, failed, judged = dict.fromkeys(EFFECTS, 0), 0, 0, 0
    for _ in range(trials):
        rows, _ = drawn(draw, design)
        model = model_metric("displacement.largest", "step", rows, tuple(FACTORS.values()))
        assert model is not None
        if len(model.factors) < len(EFFECTS):
            continue
        result = _fit_by_peer(statsmodels.api, model, design)
        if result is None:
            failed += 1
            continue
        judged += 1
        for place, factor in enumerate(model.factors, start=1):
            low, high = model.ends[factor.name]
            truth = EFFECTS[factor.name] * (high - low) / SPANS[factor.name]
            reach = 1.959963984540054 * float(result.bse_fe[place])
            held[factor.name] += abs(float(result.fe_params[place]) - truth) <= reach
            found += factor.name == "loading" and abs(float(result.fe_params[place])) > reach
    cells = [held["thickness"], held["loading"], held["humidity"], found]
    shown = " | ".join(f"{100.0 * cell / max(judged, 1):.1f} %" for cell in cells)
    return f"| {design.name} | {judged} | {shown} | {failed} |"


def _fit_by_peer(api: object, model: MetricModel, design: Design):  # type: ignore[no-untyped-def]  # statsmodels has no types
    strips = [row.sample for row in model.rows]
    within = None
    if design.mountings > 1:
        within = {"mounting": {}}
        for sample in sorted(model.samples):  # the order in which statsmodels has them
            mine = [row.mounting for row in model.rows if row.sample == sample]
            order = sorted(set(mine))
            within["mounting"][sample] = np.array([[float(one == other) for other in order] for one in mine])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            from statsmodels.regression.mixed_linear_model import VCSpec

            names = [
                [sorted({row.mounting for row in model.rows if row.sample == one}) for one in sorted(model.samples)]
            ]
            spec = None if within is None else VCSpec(["mounting"], names, [list(within["mounting"].values())])
            mixed = api.MixedLM(model.values, model.design, strips, exog_vc=spec)  # type: ignore[attr-defined]
            result = mixed.fit(reml=True)
        except (np.linalg.LinAlgError, ValueError):
            return None
    return result if np.all(np.isfinite(result.bse_fe)) else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--sampled", type=int, default=100, help="campaigns of each kind that are sampled too")
    parser.add_argument("--peer", type=int, default=0, help="campaigns for statsmodels, which must be there")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/comparison.md")
    options = parser.parse_args()
    lines = [
        "| campaign | judged | thickness held | sham held | humidity held | sham found | next strip held "
        "| a strip is named unlike, none is |",
        "|---|---|---|---|---|---|---|---|",
    ]
    print("\n".join(lines))
    for design in DESIGNS:
        for line in counted(design, options.trials):
            lines.append(line)
            print(line, flush=True)
    if options.sampled:
        lines += [
            "",
            "The next strip by the posterior (`population`), the same campaigns:",
            "",
            "| campaign | judged | next strip held | by the mixed model | width over its, median "
            "| a strip is named unlike, none is | by the mixed model | chains did not agree |",
            "|---|---|---|---|---|---|---|---|",
        ]
        for design in DESIGNS:
            lines.append(sampled(design, options.sampled))
            print(lines[-1], flush=True)
    if options.peer:
        lines += [
            "",
            f"The same campaigns by statsmodels (MixedLM, REML, normal intervals), the first {options.peer} of each:",
            "",
            "| campaign | judged | thickness held | sham held | humidity held | sham found | no standard error |",
            "|---|---|---|---|---|---|---|",
        ]
        for design in DESIGNS:
            lines.append(of_peer(design, options.peer))
            print(lines[-1], flush=True)
    finish("comparison", _TITLE, "\n".join(lines), [], record=options.record, gate=False)


if __name__ == "__main__":
    main()
