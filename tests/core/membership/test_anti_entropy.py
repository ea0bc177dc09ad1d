"""Which peers are asked for facts that were missed, and when."""

from __future__ import annotations

from mrbt_mesh.core.facts.records import NO_CLAIM
from mrbt_mesh.core.membership.timing import NEVER_US
from tests.support.harness import MS, TIMING
from tests.support.replicas import replica


def test_facts_that_differ_are_asked_for_after_a_while_and_again_if_no_answer_comes() -> None:
    mine = replica("A")
    mine.compare_digest("B", b"another!", 1_000 * MS)
    assert mine.anti_entropy.peers_to_ask(1_000 * MS) == []
    deadline_us = mine.anti_entropy.next_ask_us
    assert deadline_us == 1_000 * MS + TIMING.repair_us
    assert mine.anti_entropy.peers_to_ask(deadline_us) == ["B"]
    mine.anti_entropy.mark_asked("B", deadline_us)
    assert mine.anti_entropy.peers_to_ask(deadline_us) == []
    assert mine.anti_entropy.is_asking("B", deadline_us)
    assert mine.anti_entropy.peers_to_ask(deadline_us + TIMING.ask_timeout_us) == ["B"]


def test_facts_that_came_to_agree_by_themselves_are_not_asked_for() -> None:
    mine = replica("A")
    mine.compare_digest("B", b"another!", 0)
    mine.compare_digest("B", mine.facts.map.digest(), 10)
    assert mine.anti_entropy.next_ask_us == NEVER_US


def test_a_team_that_is_never_quiet_is_repaired_all_the_same() -> None:
    mine = replica("A")
    for now_us in range(0, 4 * TIMING.repair_us + 1, TIMING.repair_us // 2):
        if now_us % TIMING.heartbeat_us == 0:
            mine.compare_digest("B", b"another!", now_us)
        mine.write([("claim", NO_CLAIM)], now_us)
    assert mine.anti_entropy.peers_to_ask(4 * TIMING.repair_us) == ["B"]


def test_few_are_asked_at_a_time_and_ever_fewer_while_none_has_answered() -> None:
    mine = replica("A")
    for peer in "BCDEFGHIJKLMNOPQRS":
        mine.compare_digest(peer, b"another!", 0)
    asked = []
    for step in range(16):
        peers = mine.anti_entropy.peers_to_ask(step * TIMING.repair_us)
        for peer in peers:
            mine.anti_entropy.mark_asked(peer, step * TIMING.repair_us)
        asked.append("".join(peers))
    # Six are asked in vain, then it waits twice as long, and after six more four times.
    assert [step for step, peers in enumerate(asked) if peers] == [1, 2, 5, 7, 13]
    assert "".join(asked) == "BCDEFGHIJKLMNOP"
    mine.anti_entropy.mark_answered("P", 16 * TIMING.repair_us)
    assert mine.anti_entropy.choose_to_ask("QRS", 16 * TIMING.repair_us) == ["Q", "R", "S"]


def test_one_answer_among_many_questions_in_vain_does_not_bring_back_the_haste() -> None:
    mine = replica("A")
    for peer in "BCDEFGHIJKLMNOPQ":
        mine.compare_digest(peer, b"another!", 0)
        mine.anti_entropy.mark_asked(peer, 0)
    mine.anti_entropy.mark_answered("B", 1)
    late_us = TIMING.ask_timeout_us
    assert mine.anti_entropy.is_asking("C", late_us), "its eight others count: it waits for twice"
    assert not mine.anti_entropy.is_asking("C", 2 * late_us)


def test_where_answers_take_long_facts_may_take_as_long() -> None:
    mine = replica("A")
    mine.compare_digest("B", b"another!", 0)
    mine.anti_entropy.mark_asked("B", 0)
    took_us = 40 * TIMING.repair_us
    mine.anti_entropy.mark_answered("B", took_us)
    mine.compare_digest("C", b"another!", took_us)
    # A quarter of what the first answer took, twice.
    assert mine.anti_entropy.peers_to_ask(took_us + 20 * TIMING.repair_us - 1) == []
    assert mine.anti_entropy.peers_to_ask(took_us + 20 * TIMING.repair_us) == ["C"]


def test_a_peer_that_has_had_the_time_to_answer_is_not_asked_again_soon() -> None:
    mine = replica("A")
    for peer, none_at_us in ("B", 1), ("C", TIMING.repair_us):
        mine.compare_digest(peer, b"another!", 0)
        mine.anti_entropy.mark_asked(peer, 0)
        mine.anti_entropy.mark_unanswered(peer, none_at_us)
    assert not mine.anti_entropy.is_asking("B", TIMING.repair_us + 1)
    assert mine.anti_entropy.is_asking("C", TIMING.repair_us + 1)


def test_who_was_slow_himself_may_have_what_he_lacks_unread() -> None:
    mine = replica("A")
    mine.compare_digest("B", b"another!", 0)
    mine.compare_digest("C", b"another!", 0)
    mine.anti_entropy.mark_asked("B", 0)
    lag_us = 10 * TIMING.ask_timeout_us
    mine.anti_entropy.allow_for_own_lag(lag_us)
    assert mine.anti_entropy.peers_to_ask(lag_us) == []
    assert mine.anti_entropy.is_asking("B", lag_us)
    assert mine.anti_entropy.peers_to_ask(lag_us + TIMING.repair_us) == ["C"]


def test_who_was_not_asked_comes_before_who_did_not_answer() -> None:
    mine = replica("A")
    for peer in "BCDE":
        mine.compare_digest(peer, b"another!", 0)
    for peer in mine.anti_entropy.peers_to_ask(TIMING.repair_us):
        mine.anti_entropy.mark_asked(peer, TIMING.repair_us)
    later_us = TIMING.repair_us + TIMING.ask_timeout_us
    assert mine.anti_entropy.peers_to_ask(later_us) == ["E", "B", "C"]


def test_a_peer_that_holds_what_this_replica_held_before_is_left_time_to_ask_itself() -> None:
    mine = replica("A")
    before = mine.facts.map.digest()
    mine.compare_digest("B", before, 0)
    mine.write([("claim", NO_CLAIM)], 0)
    mine.compare_digest("B", before, 0)
    mine.compare_digest("C", b"another!", 0)
    assert mine.anti_entropy.peers_to_ask(TIMING.repair_us) == ["C"]
    mine.compare_digest("C", mine.facts.map.digest(), TIMING.repair_us)
    assert mine.anti_entropy.peers_to_ask(TIMING.ask_timeout_us - 1) == []
    assert mine.anti_entropy.peers_to_ask(TIMING.ask_timeout_us) == ["B"]


def test_a_peer_that_was_behind_and_now_holds_something_else_is_asked_soon() -> None:
    mine = replica("A")
    before = mine.facts.map.digest()
    mine.compare_digest("B", before, 0)
    mine.write([("claim", NO_CLAIM)], 0)
    mine.compare_digest("B", before, 0)
    assert mine.anti_entropy.peers_to_ask(TIMING.repair_us) == []
    mine.compare_digest("B", b"another!", TIMING.repair_us)
    assert mine.anti_entropy.next_ask_us <= 2 * TIMING.repair_us
    assert mine.anti_entropy.peers_to_ask(mine.anti_entropy.next_ask_us) == ["B"]


def test_a_peer_whose_facts_have_arrived_since_its_last_heartbeat_is_not_asked_for_them() -> None:
    mine, ahead = replica("A"), replica("B")
    data, _ = ahead.write([("claim", NO_CLAIM)], 0)
    mine.compare_digest("B", ahead.facts.map.digest(), 0)
    mine.receive("B", data, 1)
    assert mine.peers_to_ask(TIMING.ask_timeout_us) == []
    assert mine.anti_entropy.next_ask_us == NEVER_US


def test_a_peer_that_sends_no_heartbeat_after_facts_have_changed_is_not_asked() -> None:
    mine = replica("A")
    mine.compare_digest("B", b"another!", 0)
    mine.write([("claim", NO_CLAIM)], 1)
    assert mine.anti_entropy.peers_to_ask(TIMING.repair_us + 1) == []
    assert mine.anti_entropy.peers_to_ask(TIMING.overdue_us) == []
    assert mine.anti_entropy.next_ask_us == NEVER_US


def test_a_peer_that_catches_up_is_not_asked_however_long_it_takes() -> None:
    mine = replica("A")
    for now_us in range(0, 10 * TIMING.ask_timeout_us, TIMING.heartbeat_us):
        before = mine.facts.map.digest()
        mine.compare_digest("C", before, now_us)
        mine.write([("claim", NO_CLAIM)], now_us)
        mine.compare_digest("B", before, now_us)
        assert mine.peers_to_ask(now_us) == []


def test_a_peer_that_is_always_a_little_ahead_is_not_asked() -> None:
    mine, ahead = replica("A"), replica("B")
    for now_us in range(0, 10 * TIMING.ask_timeout_us, TIMING.heartbeat_us):
        data, _ = ahead.write([("claim", NO_CLAIM)], now_us)
        mine.compare_digest("B", ahead.facts.map.digest(), now_us)
        assert mine.peers_to_ask(now_us) == []
        mine.receive("B", data, now_us + 1)
        mine.compare_digest("C", b"another!", now_us + 1)
        mine.anti_entropy.forget("C")
        ahead.receive("A", mine.write([("claim", NO_CLAIM)], now_us + 2)[0], now_us + 3)
