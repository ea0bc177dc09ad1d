"""Snapshots of a tree as JSON, as py_trees_js and the viewers that are made with it show them."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.core.bt.tree import CONTROLS, LEAVES, Kind, Node, Status
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.observer.observer import Observer

_STATUS = {
    Status.IDLE: "INVALID",
    Status.RUNNING: "RUNNING",
    Status.SUCCESS: "SUCCESS",
    Status.FAILURE: "FAILURE",
}
# As py_trees' own viewers colour them.
_COLOURS = {Kind.SEQUENCE: "#FFA500", Kind.FALLBACK: "#00FFFF", Kind.PARALLEL: "#FFFF00"}
LEAF, DECORATOR, CONTROL = "#555555", "#DDDDDD", "#FFA500"


class SnapshotExport:
    """Snapshots as JSON lines, one after each change."""

    summary = "Write snapshots of the tree for py_trees_js, as JSON lines."
    suffix = ".jsonl"

    def start(
        self, mission: Mission, began_us: int, began_unix_us: int
    ) -> tuple[bytes, Callable[[Observer, int], bytes]]:
        """There is no header."""
        observed = ObservedTree(mission)
        last: dict[str, Any] = {}

        def line(observer: Observer, now_us: int) -> bytes:
            nonlocal last
            found = snapshot(observed, observer)
            if found == last:
                return b""
            last = found
            timestamp = (now_us - began_us + began_unix_us) / 1e6
            return json.dumps({"timestamp": timestamp, **found}).encode() + b"\n"

        return b"", line


export = SnapshotExport()


def snapshot(observed: ObservedTree, observer: Observer) -> dict[str, Any]:
    """A tree with its statuses, its conditions on the blackboard, and the robots at work.

    The ids of nodes are numbers from 1 on, depth first.
    """
    statuses, nodes = observed.statuses(observer), observed.tree.nodes
    workers: dict[str, list[str]] = {}
    for line in observer.plan.assignments.values() if observer.plan is not None else ():
        workers.setdefault(line.global_task, []).append(line.robot)
    behaviours = {}
    for node in nodes:
        at_work = ", ".join(workers.get(node.subject, ())) if node.kind is Kind.ACTION else ""
        is_running = statuses[node.index] == Status.RUNNING
        behaviours[_id(node.index)] = _behaviour(
            node, Status(statuses[node.index]), at_work if is_running else ""
        )
    team = {n.subject for n in observer.mission.tree.nodes if n.kind is Kind.CONDITION}
    read = [n for n in nodes if n.kind is Kind.CONDITION and n.subject in team]
    holds = observer.facts.condition
    return {
        "visited_path": [_id(n.index) for n in nodes if statuses[n.index] != Status.IDLE],
        "behaviours": behaviours,
        "blackboard": {
            "behaviours": {_id(node.index): {f"/{node.subject}": "r"} for node in read},
            "data": {
                f"/{name}": str(holds(name)) for name in dict.fromkeys(n.subject for n in read)
            },
        },
    }


def _id(index: int) -> str:
    return str(index + 1)


def _behaviour(node: Node, status: Status, feedback: str) -> dict[str, Any]:
    found: dict[str, Any] = {
        "id": _id(node.index),
        "status": _STATUS[status],
        "name": node.name or node.subject or node.label,
        "colour": _colour(node.kind),
        "data": {"Type": str(node.kind), "Feedback": feedback},
    }
    if node.kind not in LEAVES:
        found["children"] = [_id(child) for child in node.children]
    if node.kind is Kind.PARALLEL:
        found["details"] = f"{node.limit} of {len(node.children)}"
    return found


def _colour(kind: Kind) -> str:
    if kind in LEAVES:
        return LEAF
    return _COLOURS.get(kind, CONTROL if kind in CONTROLS else DECORATOR)
