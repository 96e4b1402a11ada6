"""Values that a fitted strip may have: drawn from what the fit says, or taken from samples of its posterior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.named_matrix import matrix_of
from ipmclab.planning.answer import FittedStrip
from ipmclab.store.heap import refuse_endless_heap

FloatArray = npt.NDArray[np.float64]

SEED: Final = 20261123
DRAWS: Final = 16
"""Of a posterior: a plan is asked at so many of its samples."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of the parameters of a fit.

    Parameters
    ----------
    values : mapping of name to float array, shape (n,) [SI]
    runs : tuple of str
        Content hashes of the runs that they are of.
    where : str
        The file, for messages.
    """

    values: Mapping[str, FloatArray]
    runs: tuple[str, ...]
    where: str = "posterior"


def read_samples(path: str | Path) -> Samples:
    """The samples that ``ipmclab posterior`` wrote.

    Parameters
    ----------
    path : str or Path
        A netCDF file with a group ``posterior``.

    Raises
    ------
    InputError
        No such file, or another one.
    """
    import h5py

    wrong = InputError(
        "it has no samples of a fit",
        code="no-posterior",
        where=str(path),
        repair="give the file that ipmclab posterior wrote",
    )
    if not Path(path).is_file():
        raise InputError(
            "there is no such file", code="no-such-file", where=str(path), repair="ipmclab posterior writes one"
        )
    try:
        refuse_endless_heap(Path(path))
        with h5py.File(path, "r") as file:
            group = file["posterior"]
            found = {name: np.asarray(each[...], dtype=np.float64) for name, each in group.items() if each.ndim == 2}
            runs = tuple(_text(one) for one in np.atleast_1d(group.attrs.get("runs", ())))
    except (OSError, KeyError, AttributeError, ValueError) as error:
        raise wrong from error
    if not found or len({each.size for each in found.values()}) > 1:
        raise wrong
    return Samples({name: each.ravel() for name, each in found.items()}, runs, str(path))


def _text(value: object) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def drawn_strips(strip: FittedStrip, draws: int | Samples, *, seed: int = SEED) -> tuple[FittedStrip, ...]:
    """The strip at values that it may have.

    Parameters
    ----------
    strip : FittedStrip
    draws : int or Samples
        How many are drawn from the covariance of the fit, in pairs about its values, each within the interval of its
        parameter: a direction of which the readings say nothing stays where it is. Or samples, of which as many as
        ``DRAWS`` are taken, evenly spaced. The strip itself with 0.
    seed : int

    Raises
    ------
    InputError
        A number below 0, or samples of another fit.

    Examples
    --------
    >>> import numpy as np
    >>> from dataclasses import replace
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> run = simulate(strip, "step 1 V", duration=10, rate=20)
    >>> noise = 1e-3 * np.random.default_rng(20261123).standard_normal(len(run))
    >>> fit = identify(strip, replace(run, current=run.current + noise), free="circuit.dc_resistivity")
    >>> low, high = fit.parameters["circuit.dc_resistivity"].interval
    >>> drawn = drawn_strips(FittedStrip(fit), 4)
    >>> all(low <= one.actuator["circuit.dc_resistivity"] <= high for one in drawn)
    True
    """
    if isinstance(draws, Samples):
        return tuple(_at(strip, values) for values in _of_samples(strip.fit, draws))
    if draws < 0:
        raise InputError(
            f"the number of draws is {draws}", code="out-of-range", where="draws", repair="give 0 or more, such as 16"
        )
    if draws == 0:
        return (strip,)
    generator = np.random.default_rng(seed)
    names = (*strip.names, *strip.held)
    scale = np.append(strip.chains, np.ones(len(strip.held)))
    covariance = matrix_of(strip.fit.covariance, names) / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    half = generator.standard_normal(((draws + 1) // 2, len(names)))
    away = np.vstack([half, -half])[:draws] @ root.T
    return tuple(_at(strip, _moved(strip, each)) for each in away)


def _moved(strip: FittedStrip, away: FloatArray) -> dict[str, float]:
    """Values that lie so far from those of the fit: entries of what was fitted, then held values [SI]."""
    found = {}
    for name, unknown, step in zip(strip.names, strip.unknowns, away, strict=False):
        one = strip.fit.parameters[name]
        low, high = one.interval
        found[name] = min(max(unknown.value(unknown.entry(one.value) + float(step)), low), high)
    held = strip.actuator.parameter_values
    for name, step in zip(strip.held, away[len(strip.names) :], strict=True):
        base = name.partition("[")[0]
        if base in held:
            found[name] = _inside(strip, base, held[base] + float(step))
    return found


def _inside(strip: FittedStrip, base: str, value: float) -> float:
    """A value within the allowed range of its parameter [SI]."""
    known = strip.actuator.parameters()[base]
    return min(max(value, known.lower), known.upper)


def _of_samples(fit: Fit, samples: Samples) -> Sequence[Mapping[str, float]]:
    of_fit = {content for _, content in fit.runs}
    if not set(fit.parameters) & set(samples.values) or (samples.runs and set(samples.runs) != of_fit):
        raise InputError(
            "the samples are of other runs or of other parameters than the fit",
            code="another-posterior",
            where=samples.where,
            repair="sample the posterior of the same runs with the same free parameters",
        )
    count = len(next(iter(samples.values.values())))
    places = np.unique(np.linspace(0, count - 1, min(DRAWS, count)).round().astype(int))
    return [{name: float(each[place]) for name, each in samples.values.items()} for place in places]


def _at(strip: FittedStrip, values: Mapping[str, float]) -> FittedStrip:
    """The strip of a fit that found other values."""
    fit = strip.fit
    own = fit.actuator.parameter_values
    shared = {name.partition("[")[0]: value for name, value in values.items() if "[" not in name or name in strip.held}
    parameters = {
        name: replace(one, value=values[name]) if name in values else one for name, one in fit.parameters.items()
    }
    actuator = fit.actuator.replace(**{name: value for name, value in shared.items() if name in own})
    return FittedStrip(replace(fit, actuator=actuator, parameters=parameters))
