"""What a monitor asks, and what it is told."""

from __future__ import annotations

import json
import struct

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.groot2.monitored import MAX_TRANSITIONS, NO_HOOKS
from tests.support.groot2 import Desk, header

WELD, COVER = 4, 5


def test_statuses_follow_the_team() -> None:
    desk = Desk()
    assert desk.statuses() == [0, 0, 0, 0, 0]
    desk.go("pass 300")
    assert desk.statuses() == [1, 1, 3, 1, 0]
    desk.go("succeed A", "pass 300")
    assert desk.statuses() == [1, 2, 3, 2, 1]
    desk.go("set A done=true", "pass 300")
    # `weld` is not reached any more: idle, and what it was.
    assert desk.statuses() == [1, 2, 2, 12, 1]


def test_the_blackboard_holds_the_conditions() -> None:
    desk = Desk()
    desk.go("pass 300", "set A done=true", "pass 100")
    (data,) = desk.ask("B", b"MainTree;nonsense")
    assert msgpack.unpackb(data) == {"MainTree": {"done": True}}
    (data,) = desk.ask("B", b"\xff;;")
    assert msgpack.unpackb(data) == {}


def test_of_a_robot_only_the_conditions_of_the_team_are_entries() -> None:
    desk = Desk("A")
    desk.go("pass 300")
    (data,) = desk.ask("B", b"MainTree;T_A::2")
    found = msgpack.unpackb(data)
    assert found == {"MainTree": {"done": False}, "T_A::2": {}}


def test_a_recording_has_what_changed_since_it_began() -> None:
    desk = Desk()
    desk.go("pass 300")
    (began,) = desk.ask("r", b"start")
    assert int(began) > 1_600_000_000_000_000
    desk.go("pass 500", "succeed A", "pass 300")
    (data,) = desk.ask("t")
    found = [
        (int.from_bytes(data[at : at + 6], "little"), *struct.unpack_from("<HB", data, at + 6))
        for at in range(0, len(data), 9)
    ]
    assert [(uid, status) for _, uid, status in found] == [(2, 2), (WELD, 2), (COVER, 1)]
    assert all(500_000 <= at_us <= 800_000 for at_us, _, _ in found)
    assert desk.ask("t") == [b""], "they are told once"
    assert desk.ask("r", b"stop") == []
    desk.go("set A done=true", "pass 300")
    assert desk.ask("t") == [b""]


def test_a_recording_that_nobody_fetches_stays_small() -> None:
    desk = Desk()
    desk.ask("r", b"start")
    desk.go("pass 300")
    for number in range(MAX_TRANSITIONS):
        desk.go(f"set A done={str(number % 2 == 0).lower()}", "pass 100")
    (data,) = desk.ask("t")
    assert len(data) == 9 * MAX_TRANSITIONS


def test_there_are_no_breakpoints() -> None:
    desk = Desk()
    hook = json.dumps({"uid": 1, "position": 0, "enabled": True, "mode": 0, "once": False})
    for kind in "IRU":
        assert desk.error(kind, hook.encode()) == NO_HOOKS
        assert desk.error(kind) == "must be 2 parts message"
    assert desk.ask("D") == [b"[]"]
    # Said by a monitor that leaves.
    assert desk.ask("A") == desk.ask("X") == []


@pytest.mark.parametrize("kind", ["B", "r"])
def test_what_needs_data_is_not_asked_for_without(kind: str) -> None:
    assert Desk().error(kind) == "must be 2 parts message"


def test_what_is_not_known_is_said() -> None:
    desk = Desk()
    assert desk.error("N") == desk.error("Z") == "Request not recognized"
    assert desk.monitored.answer([b"abc"], 0) == [b"error", b"wrong request header"]
    assert desk.monitored.answer([], 0) == [b"error", b"wrong request header"]


@given(st.lists(st.binary(max_size=20), max_size=4), st.sampled_from("TSBIRUDAXrtN\0"))
def test_any_message_has_an_answer(parts: list[bytes], kind: str) -> None:
    for request in (parts, [header(kind), *parts]):
        answer = DESK.monitored.answer(request, 0)
        assert answer[0] == b"error" or answer[0][:6] == request[0]


DESK = Desk()


def test_the_id_of_the_tree_is_that_of_mission_and_tree() -> None:
    def tree_id(robot: str | None) -> bytes:
        return Desk(robot).monitored.answer([header("S")], 0)[0][6:]

    assert tree_id(None) == tree_id(None)
    assert len({tree_id(None), tree_id("A"), tree_id("B")}) == 3
