"""Which outputs a figure draws a model of, and what it says of the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ipmclab.model import Actuator
from ipmclab.prediction.open_coupling import unidentified
from ipmclab.prediction.scores import Comparison


def drawn_outputs(
    models: Sequence[Actuator], comparisons: Mapping[str, Comparison]
) -> tuple[dict[str, Comparison], str]:
    """What is drawn of a run with models, and a sentence on those that are not; empty where all are.

    A channel of which no reading counts says nothing of a model, and an output that no fit identified is drawn by
    values that nobody found; where there is nothing else, all are drawn.

    Parameters
    ----------
    models : sequence of Actuator
    comparisons : mapping of output to Comparison

    Returns
    -------
    drawn : dict of output to Comparison
    sentence : str
    """
    silent = [output for output, one in comparisons.items() if not one.used.any()]
    rest = [output for output in comparisons if output not in silent]
    guessed = [output for output in rest if all(unidentified(model, output) for model in models)]
    drawn = {output: comparisons[output] for output in rest if output not in guessed}
    if not drawn:
        return dict(comparisons), ""
    said = []
    if guessed:
        said.append(f"{' and '.join(guessed)}, which the fit did not identify")
    if silent:
        said.append(f"{' and '.join(silent)}, of which no reading counts")
    return drawn, f"Not drawn: {'; '.join(said)}." if said else ""
