"""Local tasks that are BehaviorTree.CPP trees, run by a program: without a team."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext, TaskFailedError
from mrbt_mesh.btcpp import NodeStatus, Out
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.expand import expand
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from mrbt_mesh.core.agent.effects import CancelAction, StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished, ActionStopped
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.program_trees import ProgramTree
from mrbt_mesh.features.values.blackboard import ValueType
from mrbt_mesh.features.values.traits import Traits
from mrbt_mesh.runtime.actions import ActionRunner, RobotIdentity
from mrbt_mesh.runtime.program_loader import check_program
from mrbt_mesh.sim.world.clock import VirtualClock, VirtualLoop
from tests.support.action_host import Host
from tests.support.build import action, make_mission

XML = (
    '<root BTCPP_format="4"><BehaviorTree ID="Look"><Sequence><Drive goal="{goal}"/>'
    '<Find sure="{sure}"/><Script code="far := goal > 2"/></Sequence></BehaviorTree></root>'
)
PORTS, OUTPUTS = (("goal", "3"),), (("far", "far_away"), ("sure", "found"), ("gone", "lost"))


def mission_of(xml: str = XML, outputs: tuple[tuple[str, str], ...] = OUTPUTS) -> Mission:
    mission = make_mission(action("look"))
    conditions = {name: ConditionType(name) for name in ("far_away", "found", "lost")}
    trees = {"look": ProgramTree("look.xml", xml, "Look", PORTS, outputs)}
    return replace(mission, program_trees=trees, conditions=conditions)


def program_of(told: list[str], answer: bool | str = True) -> RobotProgram:
    robot = RobotProgram()

    @robot.action("Drive")
    async def drive(task: TaskContext, goal: int) -> None:
        told.append(f"{task.robot} drives to {goal}")
        await anyio.sleep(goal / 3)

    @robot.action("Find")
    async def find(sure: Out[bool]) -> bool:
        if isinstance(answer, str):
            raise TaskFailedError(answer)
        sure.set(answer)
        return answer

    return robot


def carried_out(
    mission: Mission, program: RobotProgram, cancel_s: float = 0, activation: str = "g#0"
) -> tuple[Any, float]:
    """How the local task `look` ends, and when."""
    clock = VirtualClock()
    (said,) = run_look(mission, program, clock, cancel_s, activation).said
    return said, clock.now_us / 1e6


def run_look(
    mission: Mission,
    program: RobotProgram,
    clock: VirtualClock,
    cancel_s: float = 0,
    activation: str = "g#0",
) -> Host:
    """Carry the local task `look` out, in virtual time."""
    loop = VirtualLoop(clock)
    host = Host(clock)

    async def main() -> None:
        async with anyio.create_task_group() as group:
            identity = RobotIdentity("A1", "a", 1, 1.0)
            runner = ActionRunner(group, program, mission, identity, host)
            start = StartAction(7, activation, "g", "look", (), MICRO, Incarnation(1, "n"))
            runner.carry_out(start)
            if cancel_s:
                await anyio.sleep(cancel_s)
                runner.carry_out(CancelAction(7))

    try:
        loop.run_until_complete(main())
    finally:
        loop.close()
    return host


def test_the_statuses_of_its_nodes_are_told_when_they_change() -> None:
    ticked = run_look(mission_of(), program_of([]), VirtualClock()).ticked
    nodes = expand(library_of(parse_document(XML, "look.xml"), Findings()), "Look").root.walk()
    assert {len(statuses) for statuses in ticked} == {len([*nodes])}
    assert all(before != after for before, after in pairwise(ticked))
    assert ticked[0][0] == NodeStatus.RUNNING


def test_ports_come_from_the_mission_and_outputs_go_with_the_outcome() -> None:
    told: list[str] = []
    end, at_s = carried_out(mission_of(), program_of(told))
    assert isinstance(end, ActionFinished)
    assert end.success
    assert end.conditions == (("far_away", True), ("found", True))
    assert told == ["A1 drives to 3"]
    assert at_s == 1.0


@pytest.mark.parametrize(("most", "is_set"), [(9, True), (2, False)])
def test_an_output_may_be_an_entry_of_the_blackboard(most: int, is_set: bool) -> None:
    mission = mission_of(outputs=(("goal", "count"), ("gone", "count")))
    count = ConditionType("count", default=None, traits=Traits(values=ValueType(low=0, high=most)))
    mission = replace(mission, conditions={"count": count})
    end = carried_out(mission, program_of([]), activation="r:0:look::0")[0]
    assert (end.success, end.conditions) == (is_set, (("count", 3),) if is_set else ())
    assert is_set or "count is not set: it is a whole number from 0 to 2, not" in end.reason


def test_a_tree_may_read_what_only_the_program_knows() -> None:
    """Entries that nothing in the tree writes, numbers of names, and what Nav2's nodes ask for."""
    told: list[str] = []
    robot = program_of(told)

    @robot.entry("charge")
    def charge(task: TaskContext) -> float:
        return 12.5 if task.robot == "A1" else 0.0

    robot.enum("LOW", 10)
    robot.source("robot_pose")(lambda: (0.0, 0.0))
    xml = XML.replace(
        "<Sequence>", '<Sequence><ScriptCondition code="charge > LOW"/><DistanceController>'
    ).replace("<Find", "</DistanceController><Find")
    end, _ = carried_out(mission_of(xml), robot)
    assert isinstance(end, ActionFinished)
    assert end.success, end
    assert told == ["A1 drives to 3"]


def test_a_tree_that_fails_fails_with_the_reason_of_its_leaf() -> None:
    end, _ = carried_out(mission_of(), program_of([], "too dark"))
    assert isinstance(end, ActionFinished)
    assert (end.success, end.error) == (False, "too dark")
    end, _ = carried_out(mission_of(), program_of([], answer=False))
    assert (end.success, end.error) == (False, "the tree Look ended as FAILURE")
    assert end.conditions == (("found", False),)


def test_a_tree_that_is_cancelled_stops_its_leaves() -> None:
    end, at_s = carried_out(mission_of(), program_of([]), cancel_s=0.25)
    assert end == ActionStopped(7)
    assert at_s == 0.25


def test_a_mistake_in_a_run_is_a_failure_that_says_where() -> None:
    end, _ = carried_out(mission_of(XML.replace("goal > 2", "goal > gaol")), program_of([]))
    assert isinstance(end, ActionFinished)
    assert not end.success
    assert "gaol" in end.error.partition(", in the script '")[0]
    assert end.error.endswith("(look.xml:1)")
    missing = XML.replace("<Find", '<Sleep msec="{nap}"/><Find')
    end, _ = carried_out(mission_of(missing), program_of([]))
    assert end.error == end.reason == "port 'msec': the entry 'nap' has no value (look.xml:1)"


def test_what_a_program_lacks_is_told_before_the_start() -> None:
    mission = mission_of()
    assert check_program(program_of([]), mission, ["look"]) == []
    (lacking,) = check_program(RobotProgram(), mission, ["look"])[:1]
    assert lacking.startswith("tree of look (look.xml:1: Look/Sequence/Drive: 'Drive' is an action")
    assert check_program(RobotProgram(), mission, []) == []


@pytest.mark.parametrize(
    ("held", "order"), [(True, 'part="2" side="left"'), (False, 'a="2" b="left"')]
)
def test_a_condition_of_the_team_needs_no_function(
    held: bool, order: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its ports are the arguments, by name or in their order."""
    asked = []

    def read_condition(_: Host, name: str) -> bool:
        asked.append(name)
        return held

    monkeypatch.setattr(Host, "read_condition", read_condition)
    xml = XML.replace("<Sequence>", f"<Sequence><Ready {order}/>")
    mission = mission_of(xml)
    ready = ConditionType("Ready", ("part", "side"))
    mission = replace(mission, conditions={**mission.conditions, "Ready": ready})
    assert check_program(program_of([]), mission, ["look"]) == []
    end, _ = carried_out(mission, program_of([]))
    assert (end.success, set(asked)) == (held, {"Ready(2,left)"})
    # The program's own function goes before.
    program = program_of([])
    program.condition("Ready")(lambda **ports: not held)
    assert carried_out(mission, program)[0].success is not held


def test_the_same_in_python(tmp_path: Path) -> None:
    path = tmp_path / "look.xml"
    path.write_text(XML)
    told: list[str] = []
    robot = program_of(told)

    @robot.local_task("look")
    async def look(task: TaskContext) -> None:
        await robot.run_tree(task, path, "Look", goal=5)

    mission = replace(mission_of(), program_trees={})
    end, _ = carried_out(mission, robot)
    assert end.success
    assert told == ["A1 drives to 5"]
    robot = program_of([], "too dark")
    with pytest.raises(TaskFailedError, match="too dark"):
        anyio.run(partial(robot.run_tree, _context(), path, "Look", goal=0))


def _context() -> Any:
    class Nobody:
        robot = "A1"

    return Nobody()


def test_a_tree_that_is_skipped_has_nothing_to_do_and_succeeds() -> None:
    xml = XML.replace("<Sequence>", '<Sequence _skipIf="true">')
    ended, _ = carried_out(mission_of(xml, ()), program_of([]))
    assert isinstance(ended, ActionFinished)
    assert ended.success
