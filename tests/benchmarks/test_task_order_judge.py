"""The judge of the order of jobs: what it finds in events that were made up."""

from __future__ import annotations

from typing import Any

from benchmarks.task_order_judge import Handed, Verdict, judge

ABLE = frozenset({"R1", "R2"})


def job(name: str, at_s: float = 0.0, priority: int = 0, **more: Any) -> Handed:
    return Handed(name, at_s, priority, more.pop("able", ABLE), **more)


def event(at_s: float, robot: str, what: str, name: str, place: str = "") -> dict[str, Any]:
    outcome = "success" if what == "end" else None
    row = {"t": at_s, "robot": robot, "event": what, "activation": f"run:1@{name}:do::0"}
    return row | {"outcome": outcome} | ({"place": place} if place else {})


def done(at_s: float, robot: str, name: str) -> list[dict[str, Any]]:
    """It drives for a second and works for a second."""
    times = ((at_s, "start"), (at_s + 1, "begin"), (at_s + 2, "end"))
    return [event(t, robot, what, name, "p" if what == "start" else "") for t, what in times]


def judged(jobs: list[Handed], *rows: list[dict[str, Any]], most: int = 1) -> Verdict:
    return judge(jobs, [each for row in rows for each in row], {}, most)


def test_jobs_in_their_order_are_fine() -> None:
    jobs = [job("a"), job("b", 0.1), job("c", 0.2, priority=1)]
    found = judged(jobs, done(1, "R1", "c"), done(1.1, "R2", "a"), done(4, "R2", "b"))
    assert (found.broken, found.overtaken.total(), found.done) == ([], 0, 3)


def test_a_job_of_priority_must_not_be_overtaken() -> None:
    jobs = [job("a"), job("b", priority=1)]
    found = judged(jobs, done(1, "R1", "a"), done(4, "R1", "b"))
    assert found.broken == ["1.00: R1 begins a before b, of priority"]


def test_a_job_is_overtaken_as_often_as_is_stated_and_no_more() -> None:
    jobs = [job("a"), job("b", 0.1), job("c", 0.2)]
    rows = done(1, "R1", "b"), done(4, "R1", "c"), done(7, "R1", "a")
    assert judged(jobs, *rows, most=2).broken == []
    assert judged(jobs, *rows).broken == ["4.00: a is overtaken once more, by c"]


def test_what_a_robot_cannot_do_or_another_is_on_is_not_overtaken() -> None:
    jobs = [job("a", able=frozenset({"R2"})), job("b", 0.1)]
    assert judged(jobs, done(1, "R1", "b"), done(4, "R2", "a")).overtaken.total() == 0
    jobs = [job("a"), job("b", 0.1)]
    assert judged(jobs, done(1, "R2", "a"), done(1.5, "R1", "b")).overtaken.total() == 0


def test_what_too_few_robots_are_free_for_is_not_overtaken() -> None:
    jobs = [job("a", 1.5, priority=1, count=2), job("b"), job("c", 0.2)]
    pair = [event(5, "R1", "start", "a"), event(5, "R2", "start", "a")]
    ends = [event(6, "R1", "end", "a"), event(6, "R2", "end", "a")]
    found = judged(jobs, done(1, "R1", "b"), done(2.5, "R2", "c"), pair, ends)
    assert (found.broken, found.done) == ([], 3)


def test_turns_and_turns_back_are_counted() -> None:
    jobs = [job("a"), job("b", 0.1)]
    way = [event(1, "R1", "start", "a", "p"), event(2, "R1", "cancel", "a")]
    back = [event(2, "R1", "start", "b", "q"), event(3, "R1", "cancel", "b")]
    found = judged(jobs, way, back, done(3, "R1", "a"), done(6, "R1", "b"))
    assert (found.turns, found.turns_back) == (2, 1)
    urgent = [job("a"), job("b", 0.1, priority=1)]
    onward = [event(2, "R1", "start", "b", "q"), event(3, "R1", "end", "b")]
    assert judged(urgent, way, onward, done(4, "R1", "a")).turns == 0


def test_what_is_never_done_or_too_late_is_named() -> None:
    found = judged([job("a"), job("b", deadline_s=2.0)], done(1, "R1", "b"))
    assert (found.broken, found.missed) == (["a was never done"], {0: 1})
