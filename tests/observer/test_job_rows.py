"""Rows that are kept from one look to the next are those that would be made anew."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.bt.evaluation import JobEnded
from mrbt_mesh.core.facts.records import JobEnd, JobState
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.observer.job_rows import UNCONFIRMED, JobRows
from mrbt_mesh.observer.observer import Observer
from tests.support.commands import command, submission
from tests.support.one_robot import MISSION, desk

NAMES = [f"job-{number}" for number in range(30)]
CHANGES = {
    "job_cancelled": True,
    "job_hold": "held",
    "job_hold again": "released",
    "job_priority": 0,
}
DRAWN = st.tuples(
    st.sampled_from(sorted(CHANGES)),
    st.sampled_from(NAMES),
    st.integers(-2, 2),
)


@given(st.lists(DRAWN, max_size=12))
def test_kept_rows_are_as_new_ones(changes: list[tuple[str, str, int]]) -> None:
    """More jobs than are in the tree at a time: others come into it when one is cancelled."""
    (_, context), kept = desk(), JobRows()
    for stamp, name in enumerate(NAMES):
        context.facts.map.merge([submission(name, "inspect", "shelf_1", stamp=stamp + 1)])
    before = kept.update(context.facts, None, ())
    assert [row.why for row in before].count("behind others") == len(NAMES) - 20
    for change, name, priority in changes:
        value = priority if change == "job_priority" else CHANGES[change]
        stamp = context.facts.max_stamp + 1
        context.facts.map.merge([command(f"{change.split()[0]}/{name}", value, stamp)])
        context.facts.prune()
        rows = kept.update(context.facts, None, ())
        assert rows == JobRows().update(context.facts, None, ())
    places = {"held": 0, "waiting": 0}
    ranks = [places.get(row.state, 1) for row in kept.update(context.facts, None, ())]
    assert ranks == sorted(ranks)


def test_numbers_are_numbers_while_a_job_is_open_and_when_it_has_ended() -> None:
    (_, context), rows = desk(), JobRows()
    context.facts.map.merge([submission("a", "deliver", "shelf_1", "dock_2", "3", stamp=1)])
    expected = {"shelf": "shelf_1", "dock": "dock_2", "boxes": 3}
    (row,) = rows.update(context.facts, None, ())
    assert (row.state, row.arguments) == ("waiting", expected)
    context.facts.map.merge([command("job_cancelled/a", True, 2)])
    context.facts.prune()
    (row,) = rows.update(context.facts, None, ())
    assert (row.state, row.arguments) == ("cancelled", expected)


def test_an_ended_job_is_told_as_it_was_seen_or_as_not_known() -> None:
    """Of one that has ended the team keeps how, and neither its priority nor its times."""
    seen, late = (Observer(MISSION, "r", Timing(), min_cost_flow) for _ in range(2))
    end = JobEnd(JobState.SUCCEEDED, "inspect", ("shelf_1",), "me", "", ("D2",), 5)
    ends = [
        make_entry(robot, "job_end/a", Version(Incarnation(1, "n"), 5), end)
        for robot in ("D1", "D2")
    ]
    seen.record.fact(submission("a", "inspect", "shelf_1", priority=7, deadline_us=9), 1)
    seen.record.fact(command("job_priority/a", 8, 3), 2)
    for observer in (seen, late):
        observer.facts.map.merge(ends)
        for each in ends:
            observer.record.fact(each, 3)
    (row,), (unseen,) = JobRows().of(seen), JobRows().of(late)
    assert (row.state, row.priority, row.not_before_us, row.deadline_us) == ("succeeded", 8, 0, 9)
    assert (unseen.priority, unseen.not_before_us, unseen.deadline_us) == (None, None, None)
    assert row.robots == unseen.robots == ("D2",)


def test_a_job_whose_end_nobody_has_confirmed_says_so() -> None:
    (_, context), rows = desk(), JobRows()
    context.facts.map.merge([submission(name, "inspect", "shelf_1", stamp=1) for name in "ab"])
    evaluation = SimpleNamespace(job_ends=(JobEnded("a", True, ()),))
    plan: Any = SimpleNamespace(evaluation=evaluation, waiting=(), ahead=None)
    found = {row.id: (row.state, row.why) for row in rows.update(context.facts, plan, ())}
    assert found == {"a": ("waiting", UNCONFIRMED), "b": ("waiting", "")}


def test_no_job_of_a_mission_that_was_aborted_goes_on() -> None:
    observer = Observer(MISSION, "r", Timing(), min_cost_flow)
    for stamp, name in enumerate("abc", start=1):
        observer.facts.map.merge([submission(name, "inspect", "shelf_1", stamp=stamp)])
    observer.facts.map.merge([command("job_hold/b", "held", 4)])
    observer.facts.map.merge([command("job_cancelled/c", True, 5)])
    rows = JobRows()
    before = {row.id: row.state for row in rows.of(observer)}
    assert (before["a"], before["b"]) == ("waiting", "held")
    observer.facts.map.merge([command("aborted", True, 6)])
    shown = {row.id: row for row in rows.of(observer)}
    assert {shown[name].state for name in "ab"} == {"cancelled"}
    assert {shown[name].why for name in "ab"} == {"the mission was aborted"}
    again = {row.id: row for row in rows.of(observer)}
    assert all(again[name] is shown[name] for name in "ab"), "nothing has changed"
