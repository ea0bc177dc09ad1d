"""T_i = Parallel(T_A, T_G, T_Li, 3), the tree of every robot: paper, section V, equation (1)."""

from __future__ import annotations

import itertools

import pytest

from mrbt_mesh.core.bt.evaluator import parallel_status
from mrbt_mesh.core.bt.robot_tree import (
    AssignmentValues,
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


def ticked(tree: RobotTree, values: AssignmentValues) -> Status:
    """T_A's status after a tick."""
    tree.tick_assignment(values)
    tree.tick(RUNNING, None)
    return tree.statuses[1]


@pytest.mark.parametrize(
    ("values", "status"),
    [
        (AssignmentValues(True, False, True, SUCCESS), SUCCESS),
        (AssignmentValues(False, True, True, SUCCESS), SUCCESS),
        (AssignmentValues(True, True, False, SUCCESS), FAILURE),
        (AssignmentValues(True, True, True, FAILURE), FAILURE),
        (AssignmentValues(True, True, True, RUNNING), RUNNING),
    ],
)
def test_after_a_trigger_t_a_needs_consistent_requests_and_an_assignment(
    values: AssignmentValues, status: Status
) -> None:
    tree = RobotTree({"weld"})
    tree.tick_assignment(AssignmentValues(True, False, status is not SUCCESS, SUCCESS))
    assert ticked(tree, values) is status


@pytest.mark.parametrize("before", [SUCCESS, FAILURE, RUNNING])
def test_without_a_trigger_t_a_keeps_its_last_status(before: Status) -> None:
    tree = RobotTree({"weld"})
    tree.tick_assignment(AssignmentValues(True, False, True, before))
    for solved in (SUCCESS, FAILURE):
        assert ticked(tree, AssignmentValues(False, False, True, solved)) is before


def test_t_i_succeeds_when_all_three_parts_do() -> None:
    for t_g, assigned, solved in itertools.product(
        (RUNNING, SUCCESS, FAILURE), ("weld", None, "fly"), (RUNNING, SUCCESS, FAILURE)
    ):
        tree = RobotTree({"weld"})
        tree.tick_assignment(AssignmentValues(True, True, True, solved))
        tree.tick(t_g, assigned)
        whole, *parts = tree.statuses
        assert parts[:2] == [solved, t_g]
        assert whole is parallel_status(parts, 3)
