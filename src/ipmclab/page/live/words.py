"""What the header says of the bench, the words that matter most first: what does not fit is cut off at their end."""

from __future__ import annotations

from typing import Final

from ipmclab.page.live.output import Output

WORDS: Final = {
    "idle": "no experiment is running",
    "starting": "the recorder starts",
    "planned": "the plan waits for your start",
    "preparing": "",
    "asking": "waits for the operator",
    "recording": "recording",
    "ended": "",
    "lost": "",
}
"""What the bench may be doing, and how that is said; what the output is at comes after it."""

_LEVELS: Final = {"untouched": "no voltage given out", "zero": "output at 0 V", "driven": "", "unsure": ""}
_ACTED: Final = "the guardian brought the output to 0 V"


def in_words(bench: str, output: Output, silent: int | None, more: str) -> str:
    """What the header says after the word for what the bench does.

    Parameters
    ----------
    bench : str
        One of ``WORDS``.
    output : Output
    silent : int [s], optional
        How long no reading has come of a run.
    more : str
        What else is known, such as why a recorder is lost.

    Examples
    --------
    >>> in_words("ended", Output(), None, "")
    'no voltage given out'
    >>> in_words("recording", Output(), 3, "")
    'no reading has come from the recorder for 3 s'
    """
    silence = f"no reading has come from the recorder for {silent} s" if silent is not None else ""
    if output.level == "unsure":
        return _joined(output.why, silence, more)
    acted = _ACTED if output.guardian == "zero" else ""
    if bench == "recording" and (acted or silence):
        return f"{acted} (no reading for {silent} s)" if acted and silence else acted or silence
    level = acted or _LEVELS[output.level]
    if bench == "lost":
        level = level or "the recorder may be driving the output"
        return _joined("" if output.is_virtual else level, more)
    text = more or WORDS[bench]
    return text if bench in ("idle", "starting", "planned", "recording") else ", ".join(filter(None, (text, level)))


def guard_in_words(bench: str, output: Output) -> str:
    """What the header says of the guard and the guardian.

    Examples
    --------
    >>> guard_in_words("ended", Output())
    'guard: off'
    """
    guardian = output.guardian_report
    if guardian == "failed":
        return "guardian: failed"
    if guardian == "unread":
        return "guardian: acted, not read back"
    if output.level == "unsure" and guardian:
        return "guardian: no word yet"
    if guardian == "zero":
        return "guardian: acted"
    if bench in ("idle", "ended", "lost"):
        return "guard: off"
    if output.is_virtual:
        return "guard: simulated strip"
    return f"guard: {guardian or ('on' if bench == 'recording' else 'ready')}"


def _joined(*parts: str) -> str:
    return "; ".join(part for part in parts if part)
