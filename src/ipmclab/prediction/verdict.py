"""What a validation says in sentences: what is predicted of runs that its fit was not given, and what is not."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.errors import InputError
from ipmclab.fit.fit_file import fit_of
from ipmclab.fit.rows import listed
from ipmclab.fit.verdict import REFUSED, verdict
from ipmclab.model import Actuator
from ipmclab.prediction.open_coupling import NOT_IDENTIFIED
from ipmclab.prediction.run_validation import RunValidation
from ipmclab.prediction.said_of_run import begins_under_voltage, current_rises, drifting_outputs, turned_outputs
from ipmclab.prediction.scores import fit_in_words, score
from ipmclab.prediction.validate import Validation
from ipmclab.quality.scale import CODE as UNIT_OFF
from ipmclab.strip_state.doubtful import EXTRAPOLATED
from ipmclab.units import CHANNELS

_HOW_WELL: Final = (
    (80.0, math.inf, "predicts"),
    (20.0, 80.0, "roughly predicts"),
    (0.0, 20.0, "hardly predicts"),
)
"""From which percent of fit to which, and the word: a fifth, and four fifths, of what readings vary by are left
(convention)."""

SO_SAID: Final = " (So said identify.)"
"""After what a fit says of itself, where a validation repeats it."""

_GROWS: Final = "which only a leak that grows (leak.slow) can follow"


@dataclass(frozen=True)
class Verdict:
    """The outcome of a validation.

    Parameters
    ----------
    predicted : mapping of output to float [percent]
        The fit over the new runs of which it is above zero.
    missed : tuple of (output, run, fit [percent])
        Each output of a new run that a constant would have met better.
    sentences : tuple of str
    """

    predicted: dict[str, float]
    missed: tuple[tuple[str, str, float], ...]
    sentences: tuple[str, ...]


def verdict_of(validation: Validation, percent: Callable[[float], str] = fit_in_words) -> Verdict:
    """What a validation says of the runs that its actuator was not identified from.

    Displacement and force that rest on a coupling which no fit gave are not judged.

    Parameters
    ----------
    validation : Validation
    percent : function of float
        How a fit is written.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate, validate
    >>> strip = load_actuator("friend-2")
    >>> run = simulate(strip, "square 1 V 0.1 Hz", duration=20.0, rate=50.0)
    >>> print(*verdict_of(validate(strip.replace(**{"circuit.dc_resistivity": 40.0}), run)).sentences)
    From its voltage alone the model predicts 1 run that was not given to its fit: current with a fit of 99.1 %, \
displacement with a fit of 99.0 % and force with a fit of 99.0 %.
    """
    fresh = [one for one in validation.runs if one.is_new]
    guessed = any(one.code == NOT_IDENTIFIED for one in validation.findings)
    outputs = [name for name in validation.scores if name == "current" or not guessed]
    predicted, missed, sentences = {}, [], _said_by_itself(validation.actuator)
    unlikely = [
        (one.label, finding)
        for one in fresh
        for finding in validation.findings
        if finding.code == UNIT_OFF and finding.message.startswith(f"{one.label}: ")
    ]
    sentences += [f"{off.message}. What this model predicts of it is not judged." for _, off in unlikely]
    silent = {
        (label, output) for label, off in unlikely for output in outputs if off.channel in (None, "voltage", output)
    }
    for output in outputs:
        fits = {
            one.label: one.scores[output].fit_percent
            for one in fresh
            if output in one.scores and (one.label, output) not in silent
        }
        missed += [(output, label, fit) for label, fit in fits.items() if fit is not None and fit <= 0.0]
        good = [one.comparisons[output] for one in fresh if (fits.get(one.label) or 0.0) > 0.0]
        pooled = score(output, good).fit_percent if good else None
        if pooled is not None:
            predicted[output] = pooled
    if predicted:
        met = [
            one
            for one in fresh
            if any(
                (one.scores[name].fit_percent or 0.0) > 0.0
                for name in outputs
                if name in one.scores and (one.label, name) not in silent
            )
        ]
        for least, below, how in _HOW_WELL:
            scored = [
                f"{CHANNELS[name].name} with a fit of {percent(fit)}"
                for name, fit in predicted.items()
                if least <= fit < below
            ]
            if scored:
                sentences.append(
                    f"From its voltage alone the model {how} {_new(met)}: {listed(scored)}"
                    f"{'' if how == 'predicts' else ', where a constant has 0 %'}."
                )
    if missed:
        outputs_text = listed(
            [
                f"the {CHANNELS[output].name} of "
                + listed([f"{label} ({percent(fit)})" for name, label, fit in missed if name == output])
                for output in dict.fromkeys(name for name, *_ in missed)
            ]
        )
        nearer = f"It does not predict {outputs_text}: a constant would have been nearer."
        grows = validation.actuator.structure.slow_leak
        sentences.append(" ".join([nearer, *_causes(fresh, missed, grows=grows)]))
    if fresh and not (predicted or missed or unlikely):
        sentences.append(f"Nothing could be scored in {_new(fresh)}.")
    if guessed:
        sentences.append(
            "Displacement and force are not judged: the fit did not identify the coupling, so the file's own values "
            "predict them."
        )
    beyond = [
        one.label
        for one in fresh
        if any(
            said.code == EXTRAPOLATED and said.message.startswith(f"{one.label} is at") for said in validation.findings
        )
    ]
    if beyond:
        sentences.append(
            f"{listed(beyond)} {_was(beyond)} recorded in an environment outside that of the fit: the scores are "
            "those of an extrapolation."
        )
    sentences += _given_to_fit(validation.runs)
    return Verdict(predicted, tuple(missed), tuple(sentences))


def _given_to_fit(runs: Sequence[RunValidation]) -> list[str]:
    """Which runs, and which rows of others, the fit was given."""
    parts = [one.rows_in_words for one in runs if one.rows_in_fit is not None]
    said = [
        f"{part[0].upper()}{part[1:]} were given to its fit: there the scores show the fit, not a prediction."
        for part in parts
    ]
    used = [one.label for one in runs if one.used_in_fit]
    if used:
        said.append(f"{listed(used)} {_was(used)} used to identify it: those scores show the fit, not a prediction.")
    return said


def _causes(fresh: Sequence[RunValidation], missed: Sequence[tuple[str, str, float]], *, grows: bool) -> list[str]:
    """Why outputs were missed: first what the records themselves show, then what may be."""
    turned = [(output, one.label) for one in fresh for output in turned_outputs(one)]
    names = {label for _, label, _ in missed}
    begin = [one.label for one in fresh if one.label in names and begins_under_voltage(one)]
    said = []
    if turned:
        which = listed([f"the {CHANNELS[output].name} of {label}" for output, label in turned])
        said.append(
            f"{which[0].upper()}{which[1:]} {'goes' if len(turned) == 1 else 'go'} the other way than predicted, and "
            "the negative of the prediction follows: the sign of the channel is reversed, in this record or in the "
            "runs of the fit."
        )
    if begin:
        said.append(
            f"{listed(begin)} {'begins' if len(begin) == 1 else 'begin'} under voltage, and the prediction from rest: "
            "the state at the start is not known, and the beginning cannot be predicted."
        )
    judged = {one[:2] for one in missed}
    drifting = {
        (output, one.label): (one, *found)
        for one in fresh
        for output, found in drifting_outputs(one).items()
        if (output, one.label) in judged
    }
    for (output, label), (one, slope, shown) in drifting.items():
        channel, length = CHANNELS[output], float(one.run.time[-1] - one.run.time[0])
        drift = (
            f"{channel.to_display(slope):.3g} {channel.display_unit}/s, which makes "
            f"{channel.to_display(abs(slope) * length):.3g} {channel.display_unit} over the record"
        )
        said.append(
            f"The sensor of the {channel.name} drifts in {label}: its rows at 0 V show {drift}. That is most of what "
            "was missed, and no prediction has a drift."
            if shown
            else f"Most of what was missed of the {channel.name} of {label} is a straight line of {drift}: its sensor "
            "drifts, the strip dries, or the model lacks a creep. A minute at 0 V first would show which."
        )
    others = {one[1] for one in missed if one[1] not in begin and one[:2] not in {*turned, *drifting}}
    return said + _of_the_strip([one for one in fresh if one.label in others], elsewhere=bool(said), grows=grows)


def _of_the_strip(missed: Sequence[RunValidation], *, elsewhere: bool, grows: bool) -> list[str]:
    """What may have been otherwise with the strip; one that shares rows with a run of the fit was no other strip."""
    rising, same = current_rises(missed), [one.label for one in missed if one.rows_in_fit is not None]
    said = []
    if rising:
        said.append(
            f"The current of {listed(rising)} rises at constant voltage: the strip or its contact changes over the "
            f"record, {'more than the growing leak of this model' if grows else _GROWS}."
        )
    if same:
        said.append(
            f"{listed(same)} {'shares' if len(same) == 1 else 'share'} rows with the runs of the fit, so the strip is "
            "the same: it or a sensor changed as the record went on, or the model holds only for the voltages and the "
            "duration of its own runs."
        )
    if len(same) < len(missed):
        said.append(
            f"{'Elsewhere the' if said or elsewhere else 'The'} strip or its state was another one (water, contact, "
            "temperature), or the model holds only for the voltages and the duration of its own runs."
        )
    return said


def _said_by_itself(actuator: Actuator) -> list[str]:
    """What a fit that is not to be used says of itself."""
    if actuator.fit_table is None:
        return []
    try:
        said = verdict(fit_of(actuator, where=actuator.name))
    except InputError:
        return []
    return [f"{said}{SO_SAID}"] if said.startswith(REFUSED) else []


def _new(runs: Sequence[RunValidation]) -> str:
    given = "given to its fit" + (" as a whole" if any(one.rows_in_fit is not None for one in runs) else "")
    return f"{len(runs)} runs that were not {given}" if len(runs) > 1 else f"1 run that was not {given}"


def _was(names: Sequence[str]) -> str:
    return "was" if len(names) == 1 else "were"
