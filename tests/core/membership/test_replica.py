"""One robot's replica: incarnations, stamps, and answers to what others lack."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.facts.records import (
    NO_CLAIM,
    ConditionValue,
    Outcome,
    RobotProblem,
)
from mrbt_mesh.core.facts.store import PARTS, FactMap, Incarnation, Version
from mrbt_mesh.core.membership.replica import PARTED_FROM, Replica
from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES, WireError
from tests.support.build import RUN
from tests.support.replicas import MISSION, replica


def test_a_new_incarnation_is_above_its_own_the_facts_and_what_was_heard() -> None:
    mine = replica("A")
    assert mine.next_incarnation(0) == Incarnation(1, "n")
    assert mine.next_incarnation(7) == Incarnation(8, "n")
    mine.write([("claim", NO_CLAIM)], 0)
    later = replica("A", "other")
    later.receive_state("A", mine.answer_pull(later.write_pull())[0], 0)
    assert later.next_incarnation(3) == Incarnation(9, "other")


def test_all_entries_of_a_batch_share_a_version_and_the_next_batch_has_a_greater_one() -> None:
    mine = replica("A")
    mine.next_incarnation(0)
    mine.write([("claim", NO_CLAIM), ("problem/clock", RobotProblem("1"))], 0)
    first = {entry.version for entry in mine.facts.map}
    assert first == {Version(Incarnation(1, "n"), 1)}
    mine.write([("claim", NO_CLAIM)], 0)
    newest = mine.facts.map.get("A", "claim")
    assert newest is not None
    assert newest.version > max(first)


def test_the_greatest_stamp_seen_is_known() -> None:
    mine, other = replica("A"), replica("B")
    data, _ = other.write([("condition/c", ConditionValue(True, 1, 41))], 0)
    mine.receive("B", data, 0)
    assert mine.facts.max_stamp == 41


def test_an_answer_holds_what_the_asker_lacks_whoever_wrote_it() -> None:
    asked, asking, dead = replica("A"), replica("B"), replica("C")
    asked.write([("claim", NO_CLAIM)], 0)
    asked.receive("C", dead.write([("problem/clock", RobotProblem("1"))], 0)[0], 0)
    received = asking.receive_state("A", asked.answer_pull(asking.write_pull())[0], 0)
    assert [(e.author, e.name) for e in received.changed] == [
        ("A", "claim"),
        ("C", "problem/clock"),
    ]
    assert asking.facts.map.digest() == asked.facts.map.digest()
    assert asking.receive_state("A", asked.answer_pull(asking.write_pull())[0], 0).changed == []


def test_a_long_answer_comes_in_pages_that_tear_no_batch_apart() -> None:
    asked, asking = replica("A"), replica("B")
    action_node = next(MISSION.tree.actions())
    for number in range(12):
        activation = f"{RUN}:{action_node.index}:a::{number}"
        outcome = (f"outcome/{activation}/a", Outcome(True, {"log": "x" * 200_000}))
        asked.write(
            [outcome, ("claim", NO_CLAIM), ("problem/clock", RobotProblem(str(number)))],
            0,
        )
    pages = asked.answer_pull(asking.write_pull())
    assert len(pages) > 2
    assert max(map(len, pages)) < MAX_MESSAGE_BYTES // 2
    seen: dict[Version, int] = {}
    for number, page in enumerate(pages):
        received = asking.receive_state("A", page, 0)
        assert received.refused == 0
        assert received.has_more is (number < len(pages) - 1)
        for version in {entry.version for entry in received.changed}:
            assert seen.setdefault(version, number) == number
    assert asking.facts.map.digest() == asked.facts.map.digest()


def with_many(count: int) -> Replica:
    """It has written so many batches of two facts, and replaced some of the facts since."""
    mine = replica("A")
    mine.next_incarnation(0)
    node = next(MISSION.tree.actions()).index
    for number in range(count):
        names = [f"outcome/{RUN}:{node}:a::{n}/a" for n in (number % 150, 1_000 + number % 70)]
        mine.write([(name, Outcome(True, {})) for name in names], 0)
    return mine


@given(st.lists(st.integers(0, 199), max_size=12), st.integers(60, 200))
def test_of_many_entries_only_those_in_parts_that_differ_are_sent(
    lacking: list[int], count: int
) -> None:
    asked, asking = with_many(count), replica("B")
    everything = asked.facts.map.of_author("A")
    lost = {everything[number % len(everything)].version for number in lacking}
    asking.facts.map.merge([entry for entry in everything if entry.version not in lost])
    received, pages = [], asked.answer_pull(asking.write_pull())
    for page in pages:
        received += asking.receive_state("A", page, 0).changed
    assert asking.facts.map.digest() == asked.facts.map.digest()
    assert {entry.version for entry in received} == lost
    if lost and len(everything) >= PARTED_FROM + 2 * len(lost):
        plain = asked.answer_pull(replica("C").write_pull())
        assert sum(map(len, pages)) < sum(map(len, plain))


def test_parts_whose_digests_are_equal_by_chance_hide_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked, asking = with_many(100), replica("B")
    asking.facts.map.merge(asked.facts.map.of_author("A")[2:])
    monkeypatch.setattr(FactMap, "part_digests", lambda *_: bytes(8 * PARTS))
    for page in asked.answer_pull(asking.write_pull()):
        asking.receive_state("A", page, 0)
    assert asking.facts.map.digest() == asked.facts.map.digest()


def test_entries_without_a_place_in_the_mission_are_counted_and_left_out() -> None:
    mine, other = replica("A"), replica("B")
    data, _ = other.write(
        [("condition/unheard_of", ConditionValue(True, 1, 1)), ("claim", NO_CLAIM)], 0
    )
    received = mine.receive("B", data, 0)
    assert received.refused == 1
    assert "not declared" in received.reason
    assert [entry.name for entry in received.changed] == ["claim"]


def test_a_question_that_is_noise_is_refused() -> None:
    with pytest.raises(WireError):
        replica("A").answer_pull(b"noise")
