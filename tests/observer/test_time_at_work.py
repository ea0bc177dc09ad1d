"""For how long robots have been at work is known to an observer that came later, too."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.observer.headline import Level, headline
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.time_at_work import (
    duration_text,
    late_after_s,
    time_at_work,
    time_text,
)
from tests.support.script import Script
from tests.support.watched import WELD, watched


def late(*commands: str) -> tuple[Script, Observer]:
    """A team that an observer begins to watch after these commands."""
    script, before = watched(WELD, *commands)
    now_us = script.team.now_us
    observer = Observer(before.mission, before.facts.run, before.membership.timing, min_cost_flow)
    observer.watch_from(now_us, 0)
    script.team.observers.append(observer)
    script.block(["pass 600"])
    observer.read(script.team.processes["A"].agent.view.facts.map, script.team.now_us)
    script.block(["pass 600"])
    return script, observer


def test_one_that_watched_from_the_beginning_knows_when_work_began() -> None:
    script, observer = watched(WELD, "pass 5000")
    found = time_at_work(observer, "A", script.team.now_us)
    assert found is not None
    assert (found.local_task, round(found.for_s)) == ("weld", 5)
    assert found.expected_s is None, "the mission does not say how long welding takes"
    assert not found.is_overdue
    assert time_at_work(observer, "B", script.team.now_us) is None


def test_one_that_came_later_knows_it_by_the_robots_word() -> None:
    script, observer = late("pass 20000")
    found = time_at_work(observer, "A", script.team.now_us)
    assert found is not None
    assert 21 < found.for_s < 22
    script.block(["pass 3000"])
    later = time_at_work(observer, "A", script.team.now_us)
    assert later is not None
    assert later.since_us == found.since_us, "the moment stays, whatever messages take"


def test_what_takes_far_longer_than_it_should_is_said_at_once() -> None:
    script = Script()
    script.block(["work weld 4", *WELD, "pass 11000"])
    observer = script.team.observer
    assert observer is not None
    found = time_at_work(observer, "A", script.team.now_us)
    assert found is not None
    assert found.expected_s == 4.0
    assert not found.is_overdue
    assert headline(observer, (), script.team.now_us)[0].text == "running"
    script.block(["pass 2000"])
    first = headline(observer, (), script.team.now_us)[0]
    assert (first.level, first.text) == (
        Level.WARN,
        "A has worked on weld for 13 s, 4 s is expected",
    )


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        *((0.0, "0 s"), (0.5, "0.5 s"), (4.0, "4 s"), (42.4, "42 s"), (180.0, "3 min")),
        *((7_200.0, "2 h"), (7_500.0, "2 h 5 min")),
    ],
)
def test_durations_are_short(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_the_time_it_should_take_is_told_where_it_is_known() -> None:
    assert time_text(42.0, 5.0) == "42 s of 5 s"
    assert time_text(42.0, None) == "42 s"


def test_late_is_what_takes_more_than_three_times_as_long_as_it_should() -> None:
    assert late_after_s(5.0) == 15.0
    assert late_after_s(None) is None
