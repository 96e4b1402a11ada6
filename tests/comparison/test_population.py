"""What strips of one make do: the closed form against dense matrices, and the answer against what was drawn."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import InputError, identify, load_actuator, simulate, write_fit
from ipmclab.cli.app import run
from ipmclab.cli.output import print_json
from ipmclab.cli.population import populations_document, print_populations
from ipmclab.comparison.compare import Comparison
from ipmclab.comparison.factors import FACTORS
from ipmclab.comparison.metric_model import MetricModel, model_metric
from ipmclab.comparison.population import Population, _Sums, population_of
from ipmclab.comparison.table import RunRow
from ipmclab.reporting.comparison import comparison_figures, write_comparison
from ipmclab.reporting.figures.population import population_figures
from ipmclab.sample import Sample
from tests.comparison.campaigns import campaign, row

pytest.importorskip("emcee")


def model_of(rows: list[RunRow]) -> MetricModel:
    found = model_metric("displacement.largest", "step", rows, tuple(FACTORS.values()))
    assert found is not None
    return found


@pytest.mark.parametrize("components", [(0.02, 0.03, 0.05), (0.01, 0.0, 0.5), (1e-8, 0.2, 0.1)])
def test_the_likelihood_is_that_of_the_whole_covariance(components: tuple[float, float, float]) -> None:
    rows = campaign(np.random.default_rng(1), strips=5)
    rows = [one for place, one in enumerate(rows) if place % 4]
    model = model_of(rows)
    strips = np.array([one.sample for one in rows])
    mountings = np.array([f"{one.sample}/{one.mounting}" for one in rows])
    repeats, mounting, strip = components
    v = repeats * np.eye(len(rows)) + mounting * np.equal.outer(mountings, mountings)
    v = v + strip * np.equal.outer(strips, strips)
    x, y = model.design, model.values
    a = x.T @ np.linalg.solve(v, x)
    beta = np.linalg.solve(a, x.T @ np.linalg.solve(v, y))
    left = y - x @ beta
    expected = -0.5 * (np.linalg.slogdet(v)[1] + np.linalg.slogdet(a)[1] + left @ np.linalg.solve(v, left))
    sums = _Sums.of(x, y, rows)
    assert sums.log_likelihood(np.array([components]))[0] == pytest.approx(expected, rel=1e-6)
    centre, variance = sums.expected(np.array([components]), x[0])
    assert (centre[0], variance[0]) == pytest.approx((x[0] @ beta, x[0] @ np.linalg.solve(a, x[0])))


def test_the_next_strip_is_where_the_mixed_model_has_it_and_one_strip_is_unlike(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    rows = campaign(np.random.default_rng(20261124), strips=12, scatter=(0.15, 0.1, 0.05))
    odd = [one.metrics["displacement.largest"] for one in rows]
    rows = [
        row(4.0 * metric.value, sample=one.sample, mounting=one.mounting, **_factors(one.values))
        if one.sample == "strip-7"
        else one
        for one, metric in zip(rows, odd, strict=True)
    ]
    model = model_of(rows)
    found = population_of(model)
    assert [one.sample for one in found.strip_deviations if one.is_unlike] == ["strip-7"]
    assert found.strip_deviations[0].value > 3.0
    condition = model.conditions()[0]
    mixed, sampled = model.next_strip(condition), found.next_strip(condition)
    assert mixed is not None
    assert np.log(sampled[0]) == pytest.approx(np.log(mixed[0]), abs=0.05)
    width = [np.log(high / low) for low, high in (sampled[1], mixed[1])]
    assert width[0] == pytest.approx(width[1], rel=0.15)
    mean, inside = found.mean(condition)
    assert sampled[1][0] < inside[0] < mean < inside[1] < sampled[1][1]
    scatter = {one.name: one for one in found.scatter}
    assert list(scatter) == ["strip", "mounting", "repeats"]
    assert scatter["repeats"].median == pytest.approx(0.05, rel=0.2)
    assert all(one.convergence.r_hat <= 1.01 for one in found.scatter)
    print_populations({"step": found}, {"sine": "too few strips"})
    told = capsys.readouterr().out
    assert "strip-7 is unlike the others: x" in told
    assert "The chains agree after" in told
    print_json(populations_document({"step": found}, {}))
    document = json.loads(capsys.readouterr().out)["metrics"]["step"]
    assert document["next_strip"][0]["by_mixed_model"]["value"] == pytest.approx(mixed[0])
    _is_on_the_page(found, rows, tmp_path)


def _is_on_the_page(found: Population, rows: list[RunRow], folder: Path) -> None:
    """What a terminal says of the posterior stands on the page too, with its figure and the data of it."""
    comparison = Comparison(tuple(rows), (FACTORS["humidity"],), (), {}, {}, {}, ())
    posterior = ({"step: displacement": found}, {"sine: force": "2 strips are too few"})
    page = write_comparison(comparison, folder / "c.html", posterior=posterior).read_text("utf-8")
    assert "By its posterior" in page
    assert "strip-7 is unlike the others: x" in page
    assert "sine: force: nothing is known of the next strip: 2 strips are too few." in page
    assert page.count('<svg class="figure"') == len(comparison_figures(comparison)) + 1
    (figure,) = population_figures(posterior[0])
    condition, told = found.model.conditions()[0], dict(zip(figure.columns, figure.data[0], strict=True))
    value, interval = found.next_strip(condition)
    assert (told["next [m]"], told["next_low [m]"], told["next_high [m]"]) == (value, *interval)
    assert len(figure.data) == len(found.model.conditions())


def test_a_run_without_a_sample_is_a_strip_of_its_own() -> None:
    rows = [replace(one, run=f"{place}.nc", sample="") for place, one in enumerate(campaign(np.random.default_rng(2)))]
    model = model_of(rows)
    assert _Sums.of(model.design, model.values, model.rows).strips.shape == (len(rows), len(rows))


def _factors(values: Mapping[str, float]) -> dict[str, float]:
    return dict(values)


def test_two_strips_tell_nothing_of_a_third() -> None:
    rows = [row(size, sample=strip) for strip, size in (("a", 1.0), ("a", 1.1), ("b", 1.2), ("b", 1.3))]
    with pytest.raises(InputError, match="2 strips do not show how much strips differ"):
        population_of(model_of(rows))


def test_parameters_of_strips_tell_the_next_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    leak, strip = "circuit.dc_resistivity", load_actuator("friend-2")
    paths = []
    for name, value in (("a", 30.0), ("b", 40.0), ("c", 36.0)):
        other = replace(strip.replace(**{leak: value}), sample=Sample(id=name))
        write_fit(
            identify(other, simulate(other, "step 1 V", duration=10, rate=10), free=leak), tmp_path / f"{name}.toml"
        )
        paths.append(str(tmp_path / f"{name}.toml"))
    assert run(["compare", *paths, "--posterior", "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)["parameters"]
    assert told["strips"] == ["a", "b", "c"]
    assert told["values"] == pytest.approx([30.0, 40.0, 36.0], rel=1e-3)
    sampled = told["sampled"]
    assert sampled["convergence"]["r_hat"] <= 1.01
    for low, high in (told["next_strip"], sampled["next_strip"]):
        assert low < 30.0 < 40.0 < high
    assert np.log(sampled["next_strip"]) == pytest.approx(np.log(told["next_strip"]), abs=1.0)
    assert run(["compare", *paths]) == 0
    assert "95 % of strips" in capsys.readouterr().out
    assert run(["compare", paths[0], paths[0]]) == 2
    assert "two fits are of the strip 'a'" in capsys.readouterr().err
    assert run(["compare", *paths, "--by", "voltage"]) == 2


def test_a_strip_that_scatters_more_is_not_named_for_that() -> None:
    """By what the others scatter the chance that a strip is as far out was 0.05 %."""
    draw = np.random.default_rng(20261129)
    rows = [
        row(1e-3 * float(np.exp(0.05 * draw.normal())), sample=f"{strip}", mounting=f"{mounting}")
        for strip in range(7)
        for mounting in range(3)
    ]
    noisy = [row(1e-3 * size, sample="noisy", mounting=f"{place}") for place, size in enumerate((0.9, 1.3, 2.0))]
    steady = [row(1e-3 * size, sample="steady", mounting=f"{place}") for place, size in enumerate((1.31, 1.34, 1.37))]
    for own, is_unlike in ((noisy, False), (steady, True)):
        model = model_metric("displacement.largest", "step", rows + own, ())
        assert model is not None
        first = population_of(model).strip_deviations[0]
        assert (first.sample, first.is_unlike) == (own[0].sample, is_unlike)
