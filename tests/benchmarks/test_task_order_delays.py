"""The judge of idle robots, lateness and turns: what it finds in events that were made up."""

from __future__ import annotations

from typing import Any

from benchmarks.task_order_delays import Area, delays
from benchmarks.task_order_judge import Handed

ABLE = frozenset({"R1", "R2"})
AREA = Area({"p": (0.0, 0.0), "q": (10.0, 0.0), "r": (20.0, 0.0)}, {"R1": "p", "R2": "q"}, 2.0)


def job(name: str, at_s: float, place: str, priority: int = 0, **more: Any) -> Handed:
    return Handed(name, at_s, priority, ABLE, place=place, work_s=1.0, **more)


def event(at_s: float, robot: str, what: str, name: str, place: str = "") -> dict[str, Any]:
    outcome = "success" if what == "end" else None
    row = {"t": at_s, "robot": robot, "event": what, "activation": f"run:1@{name}:do::0"}
    return row | {"outcome": outcome} | ({"place": place} if place else {})


def done(at_s: float, robot: str, name: str, place: str, way_s: float) -> list[dict[str, Any]]:
    begin_s = at_s + way_s
    start = event(at_s, robot, "start", name, place)
    return [start, event(begin_s, robot, "begin", name), event(begin_s + 1, robot, "end", name)]


def judged(jobs: list[Handed], *rows: list[dict[str, Any]]) -> list[str]:
    return delays(jobs, [each for row in rows for each in row], {}, AREA)


def test_a_job_that_a_robot_sets_out_for_at_once_is_fine() -> None:
    assert judged([job("a", 1, "q")], done(1.1, "R2", "a", "q", 0.1)) == []


def test_an_idle_robot_beside_a_job_that_nobody_is_on_the_way_to_is_named() -> None:
    jobs = [job("a", 1, "p"), job("b", 1, "q")]
    rows = done(1.1, "R1", "a", "p", 0.1), done(20, "R1", "b", "q", 5.0)
    found = judged(jobs, *rows)
    assert any("R2 was idle from 1.50 and could have ended b at 2.50" in each for each in found)
    assert judged(jobs, rows[0], done(1.2, "R2", "b", "q", 0.1)) == []


def test_a_job_of_priority_that_nobody_sets_out_for_is_named() -> None:
    jobs = [job("a", 1, "r"), job("b", 1, "r"), job("c", 2, "p", priority=1)]
    others = done(1.1, "R2", "a", "r", 5.0), done(1.1, "R1", "b", "r", 10.0)
    late = judged(jobs, *others, done(12.1, "R1", "c", "p", 10.0))
    assert "nobody set out for c, of the highest priority, at 2.50" in late


def test_a_deadline_that_was_missed_and_could_have_been_met_is_named() -> None:
    jobs = [job("a", 1, "p", deadline_s=8.0)]
    assert judged(jobs, done(1.1, "R1", "a", "p", 1.0)) == []
    assert "a missed 8.00, and could have ended at 2.50" in judged(
        jobs, done(1.1, "R2", "a", "p", 9.0)
    )


def test_a_second_turn_before_the_robot_works_is_named() -> None:
    jobs = [job("a", 1, "p"), job("b", 1, "q"), job("c", 1, "r")]
    turns = [
        event(1.1, "R2", "start", "a", "p"),
        event(2.0, "R2", "cancel", "a"),
        event(2.0, "R2", "start", "c", "r"),
        event(3.0, "R2", "cancel", "c"),
    ]
    found = judged(jobs, turns, done(3.0, "R2", "a", "p", 5.0))
    assert "R2 turned round again: a to c at 2.00, c to a at 3.00" in found
    assert not any("again" in each for each in judged(jobs, turns[:3]))


def test_a_robot_whose_job_has_expired_has_not_turned_round() -> None:
    jobs = [job("a", 1, "p"), job("b", 1, "q"), job("c", 1, "r", deadline_s=3.0)]
    turns = [
        event(1.1, "R2", "start", "a", "p"),
        event(2.0, "R2", "cancel", "a"),
        event(2.0, "R2", "start", "c", "r"),
        event(3.01, "R2", "cancel", "c"),
    ]
    found = judged(jobs, turns, done(3.01, "R2", "a", "p", 5.0))
    assert not any("again" in each for each in found)
