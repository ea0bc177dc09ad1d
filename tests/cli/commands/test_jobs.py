"""mrbt submit: one job by arguments, or many by lines (see also test_job_lines.py)."""

from __future__ import annotations

import pytest

from tests.support.command import mrbt, refused


def test_a_job_has_a_type() -> None:
    assert "Missing argument 'TYPE': a type of jobs, or --stdin" in refused(mrbt("submit"))


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["inspect", "shelf_1"], "TYPE, ARGUMENT: "),
        (["--id", "a", "--priority", "3"], "--id, --priority: "),
        (["--wait"], "--wait: "),
    ],
)
def test_what_lines_say_is_not_said_beside_them(words: list[str], named: str) -> None:
    said = refused(mrbt("submit", "--stdin", *words))
    assert f"error: {named}with --stdin, lines say which jobs" in said


def test_arguments_with_and_without_names_are_refused_before_a_team_is_looked_for() -> None:
    said = refused(mrbt("submit", "deliver", "shelf=shelf_2", "dock_1", "3"))
    assert "'shelf=shelf_2' has a name and 'dock_1' has none: give all arguments in order" in said


def test_input_without_lines_is_refused_before_a_team_is_looked_for() -> None:
    assert "standard input has no job; one per line is expected" in refused(
        mrbt("submit", "--stdin")
    )


def test_a_priority_may_be_negative() -> None:
    said = refused(mrbt("job", "priority", "a1", "-5", "--run-dir", "/nowhere/at/all"))
    assert "No such option" not in said
    assert "/nowhere/at/all" in said
