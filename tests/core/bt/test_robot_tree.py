"""T_i = Parallel(T_A, T_G, T_Li, 3), the tree of every robot: paper, section V, equation (1)."""

from __future__ import annotations

import itertools

import pytest

from mrbt_mesh.core.bt.evaluator import parallel_status
from mrbt_mesh.core.bt.robot_tree import RobotTree, assignment_tree, local_tree
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


@pytest.mark.parametrize(
    ("finished", "requested", "feasible", "status"),
    [
        (True, False, True, SUCCESS),
        (False, True, True, SUCCESS),
        (True, True, False, FAILURE),
    ],
)
def test_a_trigger_has_t_a_assign_agents(
    finished: bool, requested: bool, feasible: bool, status: Status
) -> None:
    tree = RobotTree({"weld"})
    tree.tick_assignment(finished, requested, feasible)
    tree.tick(RUNNING, None)
    assert tree.statuses[1] is status


def test_without_a_trigger_t_a_keeps_its_last_solved_status() -> None:
    tree = RobotTree({"weld"})
    tree.tick_assignment(True, False, False)
    tree.tick_assignment(False, False, True)
    tree.tick(RUNNING, None)
    assert tree.statuses[1] is FAILURE


def test_t_i_succeeds_when_all_three_parts_do() -> None:
    for t_g, assigned, feasible in itertools.product(
        (RUNNING, SUCCESS, FAILURE), ("weld", None, "fly"), (True, False)
    ):
        tree = RobotTree({"weld"})
        tree.tick_assignment(True, True, feasible)
        tree.tick(t_g, assigned)
        whole, *parts = tree.statuses
        assert parts[1] is t_g
        assert whole is parallel_status(parts, 3)
