"""Times on the command line of jobs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta

import click
import pytest

from mrbt_mesh.cli.commands.jobs import submit
from mrbt_mesh.cli.job_times import job_time

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
    local = found.astimezone()
    assert (local.hour, local.minute, local.date()) == (14, 30, datetime.now().date())


@pytest.mark.parametrize("text", ["soon", "+", "+nan", "+-5", "-5", "600", "25:00"])
def test_anything_else_is_refused_with_examples(text: str) -> None:
    with pytest.raises(click.BadParameter, match="is not a time: \\+600"):
        job_time(CONTEXT, OPTION, text)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("+1000000000", r"\+1000000000: at most \+31622400 \(a year from now\)"),
        ("+1e99", r"at most \+31622400"),
        ("+inf", r"at most \+31622400"),
        ("9999-12-31T23:59", "9999-12-31T23:59: give a time that is at most a year from now"),
        ("9999-12-31T23:59-05:00", "give a time that is at most a year from now"),
        ("0001-01-01T00:00+05:00", "before 1970; give a time from now on"),
    ],
)
def test_a_time_that_is_too_far_is_refused_with_the_limit(text: str, reason: str) -> None:
    with pytest.raises(click.BadParameter, match=reason):
        job_time(CONTEXT, OPTION, text)


def test_a_time_of_today_that_has_passed_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    options = {each.name: each for each in submit.params}
    job_time(CONTEXT, options["not_before"], "23:59:59.999999")
    job_time(CONTEXT, options["not_before"], "2026-05-04T14:30")
    job_time(CONTEXT, options["deadline"], "00:00")
    assert capsys.readouterr().err == ""
    job_time(CONTEXT, options["not_before"], "00:00")
    assert capsys.readouterr().err == "00:00 today has passed: it may begin at once\n"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("2026-03-29T02:30", "02:30:00 is skipped by the clocks in this time zone"),
        ("2026-10-25T02:30", "02:30:00\\+02:00 or 2026-10-25T02:30:00\\+01:00"),
    ],
)
def test_a_time_that_is_no_moment_is_refused(
    text: str, reason: str, in_zone: Callable[[str], None]
) -> None:
    in_zone("CET-1CEST,M3.5.0,M10.5.0/3")
    with pytest.raises(click.BadParameter, match=reason):
        job_time(CONTEXT, OPTION, text)
    assert job_time(CONTEXT, OPTION, text + "+02:00") == datetime.fromisoformat(text + "+02:00")


def test_a_zone_that_the_machine_does_not_know_is_not_taken_for_utc(
    in_zone: Callable[[str], None],
) -> None:
    in_zone("Europe/Nowhere")
    with pytest.raises(click.BadParameter, match=r"no time zone 'Europe/Nowhere' \(TZ\)"):
        job_time(CONTEXT, OPTION, "2026-05-04T14:30")
    assert job_time(CONTEXT, OPTION, "2026-05-04T14:30Z") is not None


def test_a_zone_that_is_none_is_named(in_zone: Callable[[str], None]) -> None:
    in_zone("UTC-25")
    with pytest.raises(click.BadParameter, match=r"'UTC-25' \(TZ\) is 24 hours or more from UTC"):
        job_time(CONTEXT, OPTION, "2026-05-04T14:30")


@pytest.fixture
def in_zone(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    def enter(zone: str) -> None:
        monkeypatch.setenv("TZ", zone)
        time.tzset()

    yield enter
    monkeypatch.undo()
    time.tzset()
