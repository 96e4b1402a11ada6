"""From what each model said of the readings that were held out to the choice."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ipmclab.choosing.choice import Candidate, Choice, as_close, contained_in_excluded
from ipmclab.choosing.compare import HeldOut, difference
from ipmclab.choosing.held_out import Division, Key, residuals
from ipmclab.choosing.noise import FadingNoise, ResidualSeries, fit_noise
from ipmclab.errors import IpmclabError
from ipmclab.run import Run
from ipmclab.ties import largest_first

Left = Mapping[Key, tuple[ResidualSeries, FadingNoise]]
"""What a fit leaves of each output of each run, and the noise that it looks like."""


def ranked_choice(
    runs: Sequence[Run],
    candidates: Mapping[str, Candidate],
    said: Mapping[str, HeldOut],
    division: Division,
    unscored: tuple[str, ...],
    labels: Sequence[str],
) -> Choice:
    """The models in the order of what they said of the readings that were held out, and the one that is preferred."""
    if not said:
        raise none_compared(candidates)
    names = list(said)
    scores = np.array([float(said[name].score.sum()) for name in names])
    # Log densities have no zero of their own: what counts is how far each lies below the best, to a thousandth.
    order = [names[k] for k in largest_first(np.round(scores - scores.max(), 3))]
    block_of, run_of = division.indices()
    differences = {
        (first, second): difference((first, said[first]), (second, said[second]), block_of, run_of)
        for first in order
        for second in order
        if first != second
    }
    best = order[0]
    parts = contained_in_excluded([candidates[name] for name in order], differences)
    alike = [best, *(name for name in order[1:] if not differences[name, best].is_distinguished and name not in parts)]
    close = as_close([candidates[name] for name in alike])
    preferred = min(close, key=lambda name: (candidates[name].parameters, order.index(name)))
    left = {name: _left(runs, candidates[name], division) for name in order}
    readings = sum(int(np.count_nonzero(series.observed)) for series, _ in left[best].values())
    effective = sum(noise.effective_readings(series) for series, noise in left[best].values())
    finished = [_informed(candidates[name], left[name], effective) for name in order]
    failed = [one for name, one in candidates.items() if name not in said]
    return Choice(
        candidates=(*finished, *failed),
        preferred=preferred,
        differences=differences,
        held_out="runs" if division.whole_runs else "blocks",
        blocks=len(division.blocks),
        outputs=division.outputs,
        labels=tuple(labels),
        readings=readings,
        effective_readings=effective,
        unscored=unscored,
    )


def _left(runs: Sequence[Run], one: Candidate, division: Division) -> Left:
    """What the fit to all runs leaves of each output, and the noise that it looks like."""
    assert one.fit is not None
    found: dict[Key, ResidualSeries] = {}
    for place, run in enumerate(runs):
        found.update(residuals(division, one.fit, run, place, place))
    noise = {
        output: fit_noise([series for key, series in found.items() if key[1] == output]) for output in division.outputs
    }
    return {key: (series, noise[key[1]]) for key, series in found.items()}


def _informed(one: Candidate, left: Left, effective: float) -> Candidate:
    """The candidate with its information criteria."""
    likely = sum(noise.filter(series).total for series, noise in left.values())
    noises = {key[1]: noise for key, (_, noise) in left.items()}
    count = one.parameters + sum(noise.parameters for noise in noises.values())
    return replace(
        one,
        aic=2.0 * count - 2.0 * likely,
        # A drift may leave two or three independent readings: BIC would then ask for less than AIC.
        bic=count * max(math.log(effective), 2.0) - 2.0 * likely,
        log_likelihood=likely,
    )


def none_compared(candidates: Mapping[str, Candidate]) -> IpmclabError:
    """The error where no model could be compared, with every reason."""
    reasons = "; ".join(f"{name}: {one.reason}" for name, one in candidates.items())
    return IpmclabError(
        f"none of the models could be compared ({reasons})",
        code="nothing-to-compare",
        where="models",
        repair="see that the runs have what the models need",
    )
