"""The trees of a mission with the statuses of their nodes, as an observer sees them."""

from __future__ import annotations

import pytest

from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.observer import Observer
from tests.support.script import Script
from tests.support.watched import COVER, watched


def shown(tree: ObservedTree, observer: Observer) -> dict[str, Status]:
    """Path of a node -> its status; of several with one path the last."""
    statuses = tree.statuses(observer)
    nodes = tree.tree.nodes
    assert len(statuses) == len(nodes)
    return {tree.tree.path(node.index): Status(statuses[node.index]) for node in nodes}


def test_t_g_is_that_of_the_plan() -> None:
    _, observer = watched(COVER, "succeed A", "pass 200")
    tree = ObservedTree(observer.mission)
    assert list(shown(tree, observer).values()) == [Status.RUNNING, Status.SUCCESS, Status.RUNNING]
    assert tree.title == "T_G of m"


def test_nothing_is_said_of_a_team_of_which_nobody_is_heard() -> None:
    script = Script()
    script.block(COVER[:-2])
    observer = script.team.observer
    assert observer is not None
    observer.update(0)
    assert set(ObservedTree(observer.mission).statuses(observer)) == {Status.IDLE}
    assert set(ObservedTree(observer.mission, "A").statuses(observer)) == {Status.IDLE}


@pytest.mark.parametrize("robot", ["A", "B", "C"])
@pytest.mark.parametrize(
    "commands",
    [[], ["succeed A", "pass 500"], ["succeed A", "pass 300", "kill B", "pass 3000"]],
)
def test_t_i_has_the_statuses_that_the_robot_itself_has(robot: str, commands: list[str]) -> None:
    """Whatever the observer works out from facts, the robot's own T_i says the same."""
    script, observer = watched(COVER, *commands)
    if robot not in script.team.processes:
        return
    tree = ObservedTree(observer.mission, robot)
    statuses = tree.statuses(observer)
    nodes = tree.tree.nodes
    assert nodes[0].kind is Kind.PARALLEL
    mine = tuple(Status(statuses[index]) for index in (0, *nodes[0].children))
    assert mine == script.team.processes[robot].agent.view.statuses


def test_what_a_robot_works_on_runs_in_its_t_li() -> None:
    _, observer = watched(COVER)
    found = shown(ObservedTree(observer.mission, "A"), observer)
    running = [path for path, status in found.items() if status is Status.RUNNING]
    assert any("T_Li" in path and path.endswith("/weld") for path in running)
    idle = shown(ObservedTree(observer.mission, "C"), observer)
    assert not any("T_Li" in p and s is Status.RUNNING for p, s in idle.items())


def test_a_dead_robot_has_no_statuses() -> None:
    _, observer = watched(COVER, "kill B", "pass 3000")
    assert set(ObservedTree(observer.mission, "B").statuses(observer)) == {Status.IDLE}


def test_a_subtree_has_the_status_of_what_it_names() -> None:
    _, observer = watched(COVER, "succeed A", "pass 200")
    tree = ObservedTree(observer.mission, "A")
    statuses = tree.statuses(observer)
    for node in tree.tree.nodes:
        if node.kind is Kind.SUBTREE:
            assert statuses[node.index] == statuses[node.children[0]]


def test_a_robot_that_the_mission_lacks_is_said() -> None:
    _, observer = watched(COVER)
    with pytest.raises(InputError, match=r"mission m has no robot 'X' \(it has A, B, C\)"):
        ObservedTree(observer.mission, "X")
