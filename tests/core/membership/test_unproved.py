"""Facts that follow from others wait until something but their author's word speaks for them."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.facts.records import LATCH, JobEnd, JobState, Record
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry
from mrbt_mesh.core.membership.unproved import MAX_UNPROVED, Unproved

PATIENCE_US = 1_000
OTHERS = ("A", "B", "C")


def entry(author: str, name: str = "expired/x", record: Record = LATCH, number: int = 1) -> Entry:
    return make_entry(author, name, Version(Incarnation(1, "n"), number), record)


def end(state: JobState, *robots: str) -> JobEnd:
    return JobEnd(state, "look", (), "me", "", robots, 1)


def never(_: Entry) -> bool:
    return False


def test_one_robots_word_is_not_enough_however_often_it_comes() -> None:
    unproved = Unproved(PATIENCE_US)
    for _ in range(3):
        assert not unproved.add(entry("LIAR"), "LIAR")
    assert unproved.take(never, OTHERS, 10**9) == []
    assert unproved.changes == 1


def test_a_robot_that_passes_it_on_holds_it_too() -> None:
    unproved = Unproved(PATIENCE_US)
    assert not unproved.add(entry("A"), "A")
    assert unproved.add(entry("A"), "B")
    assert not unproved


def test_two_authors_who_say_the_same_confirm_each_other() -> None:
    unproved = Unproved(PATIENCE_US)
    assert not unproved.add(entry("A"), "A")
    assert unproved.add(entry("B"), "B")


def test_two_authors_who_say_different_things_do_not() -> None:
    unproved = Unproved(PATIENCE_US)
    assert not unproved.add(entry("A", "job_end/j", end(JobState.FAILED)), "A")
    assert not unproved.add(entry("LIAR", "job_end/j", end(JobState.SUCCEEDED)), "LIAR")
    assert not unproved.add(entry("LIAR", "job_end/j", end(JobState.FAILED, "A"), 2), "LIAR")


def test_what_ones_own_facts_show_is_taken_in() -> None:
    unproved = Unproved(PATIENCE_US)
    unproved.add(entry("A"), "A")
    assert unproved.take(lambda each: each.author == "A", OTHERS, 0) == [entry("A")]
    assert not unproved


def test_where_nobody_else_is_heard_the_word_of_one_counts_after_a_time() -> None:
    unproved = Unproved(PATIENCE_US)
    unproved.add(entry("A"), "A")
    assert unproved.take(never, ["A"], 50) == []
    assert unproved.next_us(["A"], 60) == 50 + PATIENCE_US
    assert unproved.take(never, ["A"], 49 + PATIENCE_US) == []
    assert unproved.take(never, ["A"], 50 + PATIENCE_US) == [entry("A")]


def test_the_time_counts_anew_once_another_was_heard() -> None:
    unproved = Unproved(PATIENCE_US)
    unproved.add(entry("A"), "A")
    assert unproved.next_us(["A"], 50) == 50 + PATIENCE_US
    assert unproved.next_us(["A", "B"], 60) is None
    assert unproved.take(never, ["A"], 10**9) == []
    assert unproved.take(never, ["A"], 10**9 + PATIENCE_US) == [entry("A")]


@pytest.mark.parametrize("heard", [["B"], [], ["B", "C"]])
def test_the_word_of_one_that_is_not_heard_any_more_is_not_enough(heard: list[str]) -> None:
    unproved = Unproved(PATIENCE_US)
    unproved.add(entry("A"), "A")
    for now_us in (0, 10**6, 10**9):
        assert unproved.take(never, heard, now_us) == []
        assert unproved.next_us(heard, now_us) is None
    assert unproved.add(entry("A"), "B"), "another robot passes it on, so it believes it"


def test_a_flood_of_one_author_pushes_out_its_own_facts_only() -> None:
    unproved = Unproved(PATIENCE_US)
    unproved.add(entry("A"), "A")
    for number in range(2 * MAX_UNPROVED):
        unproved.add(entry("LIAR", f"expired/{number}"), "LIAR")
    assert len(unproved.names) == MAX_UNPROVED + 1
    assert "expired/x" in unproved.names
