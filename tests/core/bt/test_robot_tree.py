"""T_i = Parallel(T_A, T_G, T_Li, 3), the tree of every robot: paper, section V, equation (1)."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

from mrbt_mesh.core.bt.evaluator import parallel_status
from mrbt_mesh.core.bt.robot_tree import (
    AssignmentLeaves,
    RobotTree,
    assignment_tree,
    local_tree,
)
from mrbt_mesh.core.bt.tree import Kind, Status

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE


def test_t_a_has_the_four_leaves_of_the_paper_in_their_order() -> None:
    tree = assignment_tree()
    assert [node.subject for node in tree.nodes if node.kind in (Kind.ACTION, Kind.CONDITION)] == [
        "local_task_finished",
        "new_global_task_executed",
        "check_consistency",
        "assign_agents",
    ]


def test_t_li_has_a_branch_for_every_local_task_that_the_robot_can_do() -> None:
    assert [node.subject for node in local_tree({"weld", "look"}).actions()] == ["look", "weld"]


def test_t_li_requests_exactly_what_is_assigned() -> None:
    tree = RobotTree({"weld", "look"})
    assert tree.tick(RUNNING, "weld") == "weld"
    assert tree.statuses[3] is RUNNING
    assert tree.tick(RUNNING, "look") == "look"
    assert tree.tick(RUNNING, None) is None
    assert tree.statuses[3] is SUCCESS


def test_what_a_robot_cannot_do_is_a_failure_of_its_own_tree() -> None:
    tree = RobotTree({"weld"})
    assert tree.tick(RUNNING, "fly") is None
    assert tree.statuses[3] is FAILURE


@pytest.mark.parametrize("outcome", [SUCCESS, FAILURE])
def test_a_branch_of_t_li_has_the_outcome_of_the_local_task(outcome: Status) -> None:
    tree = RobotTree({"weld", "look"})
    tree.tick(RUNNING, "weld")
    assert tree.tick(RUNNING, "weld", outcome) is None
    assert tree.statuses[3] is outcome
    assert tree.tick(RUNNING, "look") == "look"
    assert tree.statuses[3] is RUNNING
    tree.tick(RUNNING, None)
    assert tree.statuses[3] is SUCCESS


class Leaves:
    """Leaves of T_A that say what they are told, and note when they are ticked."""

    def __init__(
        self, finished: bool, requested: bool, consistent: bool = True, solved: Status = SUCCESS
    ) -> None:
        self.ticked: list[str] = []
        self.values = AssignmentLeaves(
            lambda: self.note("finished", finished),
            lambda: self.note("requested", requested),
            lambda: self.note("consistent", consistent),
            lambda: self.note("assign", solved),
        )

    def note(self, name: str, value: Any) -> Any:
        self.ticked.append(name)
        return value


def ticked(tree: RobotTree, leaves: Leaves) -> tuple[Status, list[str]]:
    """T_A's status after a tick, and its leaves in the order in which they were ticked."""
    tree.tick_assignment(leaves.values)
    tree.tick(RUNNING, None)
    return tree.statuses[1], leaves.ticked


@pytest.mark.parametrize(
    ("leaves", "status", "order"),
    [
        (Leaves(True, False), SUCCESS, ["finished", "consistent", "assign"]),
        (Leaves(False, True), SUCCESS, ["finished", "requested", "consistent", "assign"]),
        (Leaves(True, True, False), FAILURE, ["finished", "consistent"]),
        (Leaves(True, True, True, FAILURE), FAILURE, ["finished", "consistent", "assign"]),
        (Leaves(True, True, True, RUNNING), RUNNING, ["finished", "consistent", "assign"]),
    ],
)
def test_a_trigger_has_t_a_check_consistency_and_then_assign_agents(
    leaves: Leaves, status: Status, order: list[str]
) -> None:
    assert ticked(RobotTree({"weld"}), leaves) == (status, order)


@pytest.mark.parametrize("before", [SUCCESS, FAILURE])
def test_without_a_trigger_t_a_does_nothing_and_keeps_its_last_status(before: Status) -> None:
    tree = RobotTree({"weld"})
    tree.tick_assignment(Leaves(True, False, True, before).values)
    assert ticked(tree, Leaves(False, False)) == (before, ["finished", "requested"])


def test_an_assignment_that_takes_place_elsewhere_is_running_until_it_has_ended() -> None:
    tree = RobotTree({"weld"})
    tree.tick_assignment(Leaves(True, False, True, RUNNING).values)
    assert ticked(tree, Leaves(False, False))[0] is RUNNING
    tree.end_assignment(FAILURE)
    assert ticked(tree, Leaves(False, False))[0] is FAILURE


def test_t_i_succeeds_when_all_three_parts_do() -> None:
    for t_g, assigned, solved in itertools.product(
        (RUNNING, SUCCESS, FAILURE), ("weld", None, "fly"), (RUNNING, SUCCESS, FAILURE)
    ):
        tree = RobotTree({"weld"})
        tree.tick_assignment(Leaves(True, True, True, solved).values)
        tree.tick(t_g, assigned)
        whole, *parts = tree.statuses
        assert parts[:2] == [solved, t_g]
        assert whole is parallel_status(parts, 3)
