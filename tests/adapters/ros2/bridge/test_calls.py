"""Calls of services: they end once, and what was lost is told."""

from __future__ import annotations

from mrbt_mesh.adapters.ros2.bridge.calls import CallKeeper
from mrbt_mesh.adapters.ros2.bridge.server import RunEnded, SendCall, ServerTold


def ready() -> CallKeeper:
    keeper = CallKeeper(1.0, 0.0)
    assert keeper.heard(0.0) == [ServerTold(True, "")]
    return keeper


def silent(keeper: CallKeeper) -> None:
    effects = [e for tick in range(1, 25) for e in keeper.tick(tick * 0.05)]
    assert ServerTold(False, "does not answer") in effects


def test_a_call_and_its_answer() -> None:
    keeper = ready()
    assert keeper.start(3, b"", {"x": 1}, 0.1) == [SendCall(3, {"x": 1})]
    assert not keeper.is_clear
    answer = keeper.answered(3, "why", {"n": 1}, 0.2)
    assert answer == [RunEnded(3, "succeeded", "why", {"n": 1})]
    assert keeper.is_clear
    assert keeper.answered(3, "", {}, 0.3) == []


def test_it_waits_for_its_server() -> None:
    keeper = CallKeeper(1.0, 0.0)
    assert keeper.start(3, b"", {}, 0.1) == []
    assert keeper.heard(0.2) == [ServerTold(True, ""), SendCall(3, {})]


def test_nobody_waits_for_what_is_cancelled() -> None:
    keeper = ready()
    keeper.start(3, b"", {}, 0.1)
    assert keeper.cancel(4, 0.2) == []
    assert keeper.cancel(3, 0.2) == [RunEnded(3, "cancelled", "", {})]
    assert keeper.answered(3, "", {}, 0.3) == []
    keeper.start(4, b"", {}, 0.4)
    assert keeper.refused(4, "no field", 0.4) == [RunEnded(4, "unfit", "no field", {})]


def test_an_answer_may_have_been_lost_with_its_server() -> None:
    keeper = ready()
    keeper.start(3, b"", {}, 0.0)
    silent(keeper)
    assert keeper.heard(5.0) == [RunEnded(3, "lost", "", {}), ServerTold(True, "")]


def test_a_call_that_was_not_sent_is_not_lost() -> None:
    keeper = ready()
    silent(keeper)
    assert keeper.start(3, b"", {}, 2.0) == []
    assert keeper.heard(3.0) == [ServerTold(True, ""), SendCall(3, {})]


def test_to_publish_is_no_sign_of_life_of_those_who_listen() -> None:
    keeper = ready()
    ticks = iter(tick * 0.05 for tick in range(1, 25))
    while (now_s := next(ticks)) < 0.9:
        keeper.tick(now_s)
    assert keeper.start(3, b"", "jump", now_s) == [SendCall(3, "jump")]
    assert keeper.published(3) == [RunEnded(3, "succeeded", "", {})]
    told = [effect for now_s in ticks for effect in keeper.tick(now_s)]
    assert ServerTold(False, "does not answer") in told


def test_of_several_services_under_one_name_none_is_called() -> None:
    two, one = frozenset({b"a", b"b"}), frozenset({b"a"})
    keeper = CallKeeper(1.0, 0.0)
    keeper.servers(two, 0.0)
    told = ServerTold(False, "is 2 servers that would all be called: give them namespaces")
    assert keeper.heard(0.1) == [told]
    assert keeper.start(3, b"", {}, 0.2) == []
    keeper.servers(one, 0.3)
    assert keeper.heard(0.4) == [ServerTold(True, ""), SendCall(3, {})]


def test_it_does_not_wait_for_ever() -> None:
    keeper = CallKeeper(1.0, 0.0)
    keeper.start(3, b"", {}, 0.1)
    assert [e for e in keeper.tick(29.0) if isinstance(e, RunEnded)] == []
    assert RunEnded(3, "absent", "has not been found", {}) in keeper.tick(30.2)
