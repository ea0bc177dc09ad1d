"""The tree that a monitor is shown, its requests and the replies, byte by byte."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.groot2 import monitor
from mrbt_mesh.adapters.groot2.monitor import (
    MAX_TRANSITIONS,
    NO_HOOKS,
    FullTree,
    MonitorRequest,
    parse_request,
    shown,
    status_buffer,
    transition,
)
from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.btcpp.files.document import parse_document, type_id
from mrbt_mesh.core.bt.tree import Kind, build_tree
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.build import action, condition, fallback, sequence
from tests.support.groot2 import Desk, header
from tests.support.paths import EXAMPLES, mission_file

TREE_ID = bytes(range(16))


def test_a_request_and_the_header_of_its_answer() -> None:
    """As BehaviorTree.CPP's publisher answers: the request again, and the tree's id."""
    request = parse_request(b"\x02SM\x00\x00\x00")
    assert request == MonitorRequest(ord("S"), 77)
    assert request.reply_header(TREE_ID) == b"\x02SM\x00\x00\x00" + TREE_ID


@pytest.mark.parametrize(
    "data",
    [b"", b"\x02S", b"\x02SM\x00\x00\x00\x00", b"\x01SM\x00\x00\x00", b"\x03SM\x00\x00\x00"],
)
def test_what_is_no_request_of_this_protocol(data: bytes) -> None:
    assert parse_request(data) is None


@given(st.binary(max_size=40))
def test_any_bytes_are_a_request_or_none(data: bytes) -> None:
    request = parse_request(data)
    if request is not None:
        assert request.reply_header(b"")[:6] == data


def test_statuses_take_three_bytes_each() -> None:
    assert status_buffer([1, 2, 12]) == b"\x01\x00\x01\x02\x00\x02\x03\x00\x0c"
    assert status_buffer([0] * 300)[-3:] == b"\x2c\x01\x00"


@pytest.mark.parametrize(
    ("story", "expected"),
    [
        ([0], 0),
        ([1], 1),
        ([1, 0], 11),
        ([1, 2, 0], 12),
        ([1, 3, 0], 13),
        ([1, 3, 0, 0], 13),
        ([1, 3, 0, 1], 1),
    ],
)
def test_a_node_that_is_idle_again_shows_what_it_was(story: list[int], expected: int) -> None:
    status = 0
    for each in story:
        status = shown(status, each)
    assert status == expected


def test_a_transition_takes_nine_bytes() -> None:
    assert transition(0x010203040506, 0x0708, 3) == b"\x06\x05\x04\x03\x02\x01\x08\x07\x03"
    assert transition((1 << 48) + 5, 1, 0) == transition(5, 1, 0)


MISSIONS = sorted(EXAMPLES.glob("*/mission.yaml"))


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.parent.name)
@pytest.mark.parametrize("is_robot", [False, True], ids=["team", "robot"])
def test_every_node_has_the_uid_of_its_index(path: Path, is_robot: bool) -> None:
    mission = load_mission(path)
    tree = ObservedTree(mission, next(iter(mission.robots)) if is_robot else None).tree
    document = parse_document(FullTree(tree, mission.name).xml, "full tree")
    elements = {int(e.get("_uid")): e for e in document.root.walk() if e.get("_uid")}
    assert sorted(elements) == [node.index + 1 for node in tree.nodes]
    described = {element.get("ID") for element in document.model_lists[0].children}
    for node in tree.nodes:
        element = elements[node.index + 1]
        if node.kind is Kind.SUBTREE:
            assert element.tag == "SubTree"
        else:
            assert type_id(element) in described
        if node.kind in (Kind.ACTION, Kind.CONDITION):
            assert element.get("name") == (node.name or node.subject)


def test_paths_and_blackboards_of_subtrees() -> None:
    mission = load_mission(mission_file("vehicle_repair"))
    found = FullTree(mission.tree, "T_G")
    document = parse_document(found.xml, "full tree")
    paths = [tree.get("_fullpath") for tree in document.trees]
    assert paths[0] == ""
    assert len(set(paths)) == len(paths) == 6
    assert list(found.blackboards) == ["MainTree", *paths[1:]]
    assert found.blackboards["MainTree"][0] == "nominal"
    assert found.blackboards[paths[1]] == ("broken(1)",)
    used = {e.get("_fullpath") for e in document.root.walk() if e.tag == "SubTree"}
    assert used == {*paths[1:]}


def test_a_tree_of_more_nodes_than_uids_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(monitor, "MAX_UID", 3)
    tree = build_tree(sequence(fallback(condition("a"), action("b")), action("c")))
    with pytest.raises(InputError, match="big: 5 nodes, Groot2's protocol has 3"):
        FullTree(tree, "big")


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


@pytest.mark.slow
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


def test_a_jobs_node_is_shown_as_a_parallel_of_its_types() -> None:
    tree = load_mission(mission_file("deliveries")).tree
    xml = FullTree(tree, "deliveries").xml
    assert '<Parallel name="Jobs" success_count="2"' in xml
    assert xml.count("_uid=") == len(tree.nodes)
