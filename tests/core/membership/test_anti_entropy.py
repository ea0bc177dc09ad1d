"""One robot's replica: incarnations, stamps, and answers to what others lack."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.facts.store import Incarnation, Version
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.anti_entropy import Replica
from mrbt_mesh.core.membership.timing import NEVER_US
from mrbt_mesh.core.membership.wire import MAX_MESSAGE_BYTES, Header, WireError
from tests.support.build import RUN, action, condition, make_mission, sequence
from tests.support.harness import MS, TIMING

MISSION = make_mission(sequence(condition("c"), action("a")))


def replica(robot: str, nonce: str = "n") -> Replica:
    header = Header(MISSION.digest[:16], MISSION.name, RUN, robot)
    return Replica(TeamFacts(MISSION, RUN), header, TIMING, nonce)


def test_a_new_incarnation_is_above_its_own_the_facts_and_what_was_heard() -> None:
    mine = replica("A")
    assert mine.next_incarnation(0) == Incarnation(1, "n")
    assert mine.next_incarnation(7) == Incarnation(8, "n")
    mine.write([("claim", None)], 0)
    later = replica("A", "other")
    later.receive_state(mine.answer_pull(later.write_pull())[0], 0)
    assert later.next_incarnation(3) == Incarnation(9, "other")


def test_all_entries_of_a_batch_share_a_version_and_the_next_batch_has_a_greater_one() -> None:
    mine = replica("A")
    mine.next_incarnation(0)
    mine.write([("claim", None), ("order", ["pause", 1])], 0)
    first = {entry.version for entry in mine.facts.map}
    assert first == {Version(Incarnation(1, "n"), 1)}
    mine.write([("claim", None)], 0)
    newest = mine.facts.map.get("A", "claim")
    assert newest is not None
    assert newest.version > max(first)


def test_stamps_are_above_everything_seen() -> None:
    mine, other = replica("A"), replica("B")
    data, _ = other.write([("condition/c", [True, 1, 41])], 0)
    mine.receive("B", data, 0)
    assert mine.next_stamp() == 42


def test_an_answer_holds_what_the_asker_lacks_whoever_wrote_it() -> None:
    asked, asking, dead = replica("A"), replica("B"), replica("C")
    asked.write([("claim", None)], 0)
    asked.receive("C", dead.write([("order", ["pause", 1])], 0)[0], 0)
    received = asking.receive_state(asked.answer_pull(asking.write_pull())[0], 0)
    assert [(e.author, e.name) for e in received.changed] == [("A", "claim"), ("C", "order")]
    assert asking.facts.map.digest() == asked.facts.map.digest()
    assert asking.receive_state(asked.answer_pull(asking.write_pull())[0], 0).changed == []


def test_a_long_answer_comes_in_pages_that_tear_no_batch_apart() -> None:
    asked, asking = replica("A"), replica("B")
    action_node = next(MISSION.tree.actions())
    for number in range(12):
        scope = f"{RUN}:{action_node.index}:a::{number}"
        outcome = (f"outcome/{scope}/a", [True, {"log": "x" * 200_000}])
        asked.write([outcome, ("claim", None), ("order", ["pause", number])], 0)
    pages = asked.answer_pull(asking.write_pull())
    assert len(pages) > 2
    assert max(map(len, pages)) < MAX_MESSAGE_BYTES // 2
    seen: dict[Version, int] = {}
    for number, page in enumerate(pages):
        received = asking.receive_state(page, 0)
        assert received.refused == 0
        assert received.has_more is (number < len(pages) - 1)
        for version in {entry.version for entry in received.changed}:
            assert seen.setdefault(version, number) == number
    assert asking.facts.map.digest() == asked.facts.map.digest()


def test_entries_without_a_place_in_the_mission_are_counted_and_left_out() -> None:
    mine, other = replica("A"), replica("B")
    data, _ = other.write([("condition/unheard_of", [True, 1, 1]), ("claim", None)], 0)
    received = mine.receive("B", data, 0)
    assert received.refused == 1
    assert "not declared" in received.reason
    assert [entry.name for entry in received.changed] == ["claim"]


def test_a_question_that_is_noise_is_refused() -> None:
    with pytest.raises(WireError):
        replica("A").answer_pull(b"noise")


def test_facts_that_differ_are_asked_for_after_a_while_and_again_if_no_answer_comes() -> None:
    mine = replica("A")
    mine.compare_digest("B", b"another!", 1_000 * MS)
    assert mine.peers_to_ask(1_000 * MS) == []
    deadline_us = mine.next_ask_us
    assert deadline_us == 1_000 * MS + TIMING.repair_us
    assert mine.peers_to_ask(deadline_us) == ["B"]
    mine.mark_asked("B", deadline_us)
    assert mine.peers_to_ask(deadline_us) == []
    assert mine.is_asking("B", deadline_us)
    assert mine.peers_to_ask(deadline_us + TIMING.ask_timeout_us) == ["B"]


def test_facts_that_came_to_agree_by_themselves_are_not_asked_for() -> None:
    mine = replica("A")
    mine.compare_digest("B", b"another!", 0)
    mine.compare_digest("B", mine.facts.map.digest(), 10)
    assert mine.next_ask_us == NEVER_US


def test_a_team_that_is_never_quiet_is_repaired_all_the_same() -> None:
    mine = replica("A")
    mine.compare_digest("B", b"another!", 0)
    for now_us in range(0, 4 * TIMING.repair_us + 1, TIMING.repair_us // 2):
        mine.write([("claim", None)], now_us)
    assert mine.peers_to_ask(4 * TIMING.repair_us) == ["B"]


def test_few_are_asked_at_a_time_and_more_while_none_has_answered() -> None:
    mine = replica("A")
    for peer in "BCDEFGH":
        mine.compare_digest(peer, b"another!", 0)
    asked: list[str] = []
    for now_us in range(0, 5 * TIMING.repair_us, TIMING.repair_us):
        peers = mine.peers_to_ask(now_us)
        assert len(peers) <= 3
        for peer in peers:
            mine.mark_asked(peer, now_us)
        asked += peers
    assert asked == list("BCDEFGH")


def test_who_was_not_asked_comes_before_who_did_not_answer() -> None:
    mine = replica("A")
    for peer in "BCDE":
        mine.compare_digest(peer, b"another!", 0)
    for peer in mine.peers_to_ask(TIMING.repair_us):
        mine.mark_asked(peer, TIMING.repair_us)
    later_us = TIMING.repair_us + TIMING.ask_timeout_us
    assert mine.peers_to_ask(later_us) == ["E", "B", "C"]


def test_a_peer_that_holds_what_this_replica_held_before_is_left_time_to_ask_itself() -> None:
    mine = replica("A")
    before = mine.facts.map.digest()
    mine.compare_digest("B", before, 0)
    mine.write([("claim", None)], 0)
    mine.compare_digest("B", before, 0)
    mine.compare_digest("C", b"another!", 0)
    assert mine.peers_to_ask(TIMING.repair_us) == ["C"]
    mine.compare_digest("C", mine.facts.map.digest(), TIMING.repair_us)
    assert mine.peers_to_ask(TIMING.ask_timeout_us - 1) == []
    assert mine.peers_to_ask(TIMING.ask_timeout_us) == ["B"]


def test_a_peer_that_was_behind_and_now_holds_something_else_is_asked_soon() -> None:
    mine = replica("A")
    before = mine.facts.map.digest()
    mine.compare_digest("B", before, 0)
    mine.write([("claim", None)], 0)
    mine.compare_digest("B", before, 0)
    assert mine.peers_to_ask(TIMING.repair_us) == []
    mine.compare_digest("B", b"another!", TIMING.repair_us)
    assert mine.next_ask_us <= 2 * TIMING.repair_us
    assert mine.peers_to_ask(mine.next_ask_us) == ["B"]
