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
