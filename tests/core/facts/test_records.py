"""Outcomes as facts: with the reason of a failure, and as they were before there were any."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.facts.records import Outcome, parse_record
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON, one_line

NAME = "outcome/r:1:a::0/a"


@given(st.booleans(), st.none() | st.integers(0, 9), st.text(max_size=300))
def test_an_outcome_is_read_as_it_was_written(success: bool, data: Any, text: str) -> None:
    outcome = Outcome(success, data, "" if success else one_line(text))
    assert parse_record(NAME, outcome.to_value())[1] == outcome


def test_outcomes_without_reasons_are_what_they_always_were() -> None:
    """Journals and recordings of earlier versions have these."""
    assert Outcome(False, None).to_value() == [False, None]
    assert parse_record(NAME, [False, {"a": 1}])[1] == Outcome(False, {"a": 1}, "")


@pytest.mark.parametrize(
    "value",
    [
        [True, None, "done"],
        [False, None, ""],
        [False, None, None],
        [False, None, "x" * (MAX_REASON + 1)],
        [False, None, "x", "y"],
        [False],
    ],
)
def test_what_is_no_outcome_is_refused(value: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        parse_record(NAME, value)


ESCAPE = "\x1b]0;title\x07\x9b2J\u202e\nnext"
SAFE = "?]0;title??2J??next"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("member", [ESCAPE, {}, {}, False, ESCAPE, ESCAPE, 1, True, {ESCAPE: ["look"]}]),
        ("job_end/j", ["failed", "look", [ESCAPE], ESCAPE, ESCAPE, ["A", ESCAPE], 1, 0]),
        ("job/j", [["look", [ESCAPE], 0, 0, 0, 0], ESCAPE, "", ""]),
        ("problem/loop", ESCAPE),
        ("mission_held", [1, ESCAPE, ESCAPE, 0]),
        ("condition/where", [ESCAPE, 1, 1]),
        (NAME, [False, None, ESCAPE]),
    ],
)
def test_no_text_of_a_record_reaches_a_terminal_as_a_command(name: str, value: Any) -> None:
    record = parse_record(name, value)[1]
    assert ESCAPE not in repr(record).encode().decode("unicode_escape")
    assert SAFE in repr(record)


def test_a_name_that_cannot_be_shown_is_refused() -> None:
    with pytest.raises(ValueError, match="printable"):
        parse_record("job_end/\x1b[2J", ["failed", "look", [], "me", "", [], 1])
