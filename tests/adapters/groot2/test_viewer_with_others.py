"""Against what others have written: BehaviorTree.CPP 4 itself, and an open monitor for it.

`make test-interop` installs them; they are no part of requirements-dev.lock.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from mrbt_mesh.adapters.groot2.monitor import FullTree
from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.core.bt.tree import Tree
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.groot2 import Desk, Monitor, monitoring, served
from tests.support.paths import EXAMPLES

INSTALL = "not installed: make test-interop"
MISSIONS = sorted(EXAMPLES.glob("*/mission.yaml"))


def free_ports() -> int:
    """The first of two ports in a row that are free: its publisher wants both."""
    while True:
        with socket.socket() as first, socket.socket() as second, suppress(OSError):
            first.bind(("", 0))
            port = int(first.getsockname()[1])
            second.bind(("", port + 1))
            return port


@contextmanager
def publisher(tree: Tree) -> Iterator[tuple[Any, Monitor]]:
    """BehaviorTree.CPP's own publisher of our tree, ticked by nobody, and a client of it."""
    btcpp = pytest.importorskip("behaviortreepy", reason=f"BehaviorTree.CPP is {INSTALL}")
    factory = btcpp.BehaviorTreeFactory()
    root = ElementTree.fromstring(FullTree(tree, "T_G").xml)
    for element in root.iter():
        # Its Python wrapper registers only nodes without ports of their own.
        for port in [name for name in element.attrib if name.startswith("arg_")]:
            del element.attrib[port]
    for node in root.iterfind("TreeNodesModel/*"):
        if node.tag in ("Action", "Condition"):
            register = getattr(factory, f"register_simple_{node.tag.lower()}")
            register(node.get("ID"), lambda _: btcpp.NodeStatus.SUCCESS)
    made = factory.create_tree_from_text(ElementTree.tostring(root, encoding="unicode"))
    port = free_ports()
    server = btcpp.Groot2Publisher(made, port)
    try:
        with monitoring(port) as monitor:
            yield made, monitor
    finally:
        del server


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.parent.name)
@pytest.mark.parametrize("is_robot", [False, True], ids=["team", "robot"])
def test_behaviortree_cpp_counts_the_nodes_as_we_do(path: Path, is_robot: bool) -> None:
    """It reads our XML, numbers the nodes by itself, and tells its monitors the same tree."""
    mission = load_mission(path)
    tree = ObservedTree(mission, next(iter(mission.robots)) if is_robot else None).tree
    mine = ElementTree.fromstring(FullTree(tree, "T_G").xml)
    with publisher(tree) as (_, monitor):
        (xml,) = monitor.ask("T")
        statuses = monitor.statuses()
    theirs = ElementTree.fromstring(xml)

    def nodes(root: ElementTree.Element) -> dict[str, tuple[str | None, ...]]:
        numbered = (element for element in root.iter() if "_uid" in element.attrib)
        return {
            e.attrib["_uid"]: (e.tag, e.get("ID"), e.get("_fullpath"))
            if e.tag == "SubTree"  # whose name is left out there
            else (e.tag, e.get("name"))
            for e in numbered
        }

    assert nodes(mine) == nodes(theirs)
    paths = [[e.get("_fullpath") for e in root.iter("BehaviorTree")] for root in (mine, theirs)]
    assert paths[0] == paths[1]
    assert sorted(statuses) == [node.index + 1 for node in tree.nodes]


def test_its_publisher_and_ours_answer_alike() -> None:
    """Headers, kinds of data and errors, for all that has an answer without breakpoints."""
    desk = Desk()
    desk.go("pass 300")
    with (
        publisher(desk.observer.mission.tree) as (_, theirs),
        served(desk.monitored) as port,
        monitoring(port) as ours,
    ):
        for kind, more in (
            *(("S", ()), ("D", ()), ("A", ()), ("X", ()), ("t", ()), ("r", (b"stop",))),
            *(("r", (b"bogus",)), ("B", (b"MainTree",))),
        ):
            lengths = [[len(part) for part in each.ask(kind, *more)] for each in (theirs, ours)]
            if kind == "B":
                assert [len(each) for each in lengths] == [1, 1]
            else:
                assert lengths[0] == lengths[1], kind
        for each in (theirs, ours):
            (began,) = each.ask("r", b"start")
            assert abs(int(began) / 1e6 - 1.8e9) < 1e9, "Unix time in microseconds, as text"
        for parts in (
            [b"abc"],
            [struct.pack("<BBI", 2, ord("B"), 1)],
            [struct.pack("<BBI", 2, ord("I"), 1)],
            [struct.pack("<BBI", 2, ord("Z"), 1)],
        ):
            assert theirs.raw(*parts) == ours.raw(*parts)


def test_an_open_monitor_shows_the_team() -> None:
    client = pytest.importorskip("btview.client", reason=f"btview is {INSTALL}")
    model = pytest.importorskip("btview.model")
    desk = Desk()
    desk.go("pass 300", "succeed A", "pass 300")
    desk.go("set A done=true", "pass 300")
    with served(desk.monitored) as port:
        monitor = client.Groot2Client("127.0.0.1", port, timeout_ms=10_000)
        tree = monitor.fetch_tree()
        statuses = monitor.poll().statuses
        board = monitor.fetch_blackboard(["MainTree"])
        monitor.close()
    names = {node.uid: node.display_name for node in tree.walk()}
    status = model.NodeStatus
    assert {names[uid]: state.status for uid, state in statuses.items()} == {
        "ReactiveSequence": status.RUNNING,
        "ReactiveFallback": status.SUCCESS,
        "done": status.SUCCESS,
        "weld": status.IDLE,
        "cover": status.RUNNING,
    }
    (weld,) = [uid for uid, name in names.items() if name == "weld"]
    assert statuses[weld].previous == status.SUCCESS
    assert board == {"MainTree": {"done": True}}
