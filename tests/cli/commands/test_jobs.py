"""Times on the command line of jobs."""

from __future__ import annotations

from datetime import datetime, timedelta

import click
import pytest

from mrbt_mesh.cli.commands.jobs import job_time, submit

OPTION = submit.params[0]
CONTEXT = click.Context(submit)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("+90", timedelta(seconds=90)),
        ("+0.5", timedelta(seconds=0.5)),
        ("2026-05-04T14:30+02:00", datetime.fromisoformat("2026-05-04T12:30+00:00")),
        ("2026-05-04 14:30", datetime(2026, 5, 4, 14, 30).astimezone()),
    ],
)
def test_a_time_is_absolute_or_from_now(text: str, expected: datetime | timedelta) -> None:
    assert job_time(CONTEXT, OPTION, text) == expected


def test_a_time_of_the_day_is_that_of_today() -> None:
    found = job_time(CONTEXT, OPTION, "14:30")
    assert isinstance(found, datetime)
    assert (found.hour, found.minute) == (14, 30)
    assert found.tzinfo is not None


@pytest.mark.parametrize("text", ["soon", "+", "+nan", "+-5", "+1e99", "-5", "600", "25:00"])
def test_anything_else_is_refused_with_examples(text: str) -> None:
    with pytest.raises(click.BadParameter, match="is no time: \\+600"):
        job_time(CONTEXT, OPTION, text)
