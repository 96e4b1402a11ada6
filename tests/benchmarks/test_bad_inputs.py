"""Bad inputs are drawn over every verb, and what each sound command names is there."""

from __future__ import annotations

import re

from benchmarks.bad_input_files import COMMANDS, words_of
from benchmarks.bad_inputs import SHARES, _wrong_ending
from ipmclab.cli.app import GROUPS, VERBS


def test_every_verb_has_its_share() -> None:
    assert set(SHARES) == set(COMMANDS) == {*VERBS, *GROUPS}
    for name, group in GROUPS.items():
        drawn = {words_of(command)[1] for command in COMMANDS[name]}
        assert drawn == {one.name for one in group.registered_commands}


def test_how_a_bad_input_may_end() -> None:
    told = "error: --rate: '3' has no unit; write for example '50 Hz'\n"
    assert _wrong_ending(["simulate"], 2, "", told) == []
    assert _wrong_ending(["simulate", "--json"], 2, '{"error": {"message": "no", "repair": "yes"}}', told) == []
    for words, status, out, err, why in (
        (["simulate"], 2, "", "", "no message"),
        (["simulate"], 1, "", "error: numpy: ValueError; this is a fault in ipmclab\n", "a fault of the program"),
        (["simulate"], 3, "", told, "it ended with 3"),
        (["simulate", "--json"], 0, '{"value": NaN}', "", "no single JSON document"),
    ):
        (found,) = _wrong_ending(words, status, out, err)
        assert re.match(why, found)
