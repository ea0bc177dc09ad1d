"""Nav2's nodes, as its documentation describes them; measured trees are in test_nav2_measured."""

from __future__ import annotations

from typing import Any

import anyio
import pytest

from mrbt_mesh.btcpp import BehaviorTree, NodeStatus, TickError, TreeNode
from mrbt_mesh.btcpp.executor.nav2 import NAV2
from mrbt_mesh.btcpp.executor.node import FAILURE, RUNNING, SKIPPED, SUCCESS
from mrbt_mesh.btcpp.files.builtin_nodes import NAV2_NODES, children_allowed
from mrbt_mesh.errors import FileError
from tests.support.btcpp.running import in_virtual_time
from tests.support.btcpp.ticked import Ticked


def leaves(*says: str) -> str:
    return "".join(f'<Leaf says="{each}"/>' for each in says)


def test_pipeline_sequence_ticks_earlier_children_again() -> None:
    # The documentation's table: A runs, then B while A is ticked on, then C.
    tree = Ticked(
        "<PipelineSequence>"
        + leaves("RUNNING SUCCESS RUNNING RUNNING SUCCESS", "RUNNING SUCCESS", "RUNNING SUCCESS")
        + "</PipelineSequence>"
    )
    assert tree.run(4) == [RUNNING, RUNNING, RUNNING, SUCCESS]
    assert tree.ticks == [4, 3, 2]


def test_pipeline_sequence_fails_with_any_child() -> None:
    tree = Ticked(
        f"<PipelineSequence>{leaves('SUCCESS SUCCESS FAILURE', 'RUNNING')}</PipelineSequence>"
    )
    assert tree.run(3) == [RUNNING, RUNNING, FAILURE]
    assert tree.halts == [0, 1]


def recovery(*says: str, retries: int = 1) -> Ticked:
    body = leaves(*says)
    return Ticked(f'<RecoveryNode number_of_retries="{retries}">{body}</RecoveryNode>')


def test_recovery_node_tries_again_after_its_recovery() -> None:
    tree = recovery("FAILURE SUCCESS", "RUNNING SUCCESS")
    assert tree.run(2) == [RUNNING, SUCCESS]
    assert tree.ticks == [2, 2]
    tree = recovery("FAILURE", "SUCCESS", retries=2)
    assert tree.run() == [FAILURE]
    assert tree.ticks == [3, 2]
    assert recovery("FAILURE", "FAILURE", retries=5).run() == [FAILURE]
    assert recovery("FAILURE", "SUCCESS", retries=0).run() == [FAILURE]


def test_recovery_node_is_skipped_with_its_first_child() -> None:
    body = '<Leaf says="SUCCESS" _skipIf="true"/><Leaf says="SUCCESS"/>'
    assert Ticked(f"<RecoveryNode>{body}</RecoveryNode>").run() == [SKIPPED]


@pytest.mark.parametrize(("wraps", "second"), [("true", SUCCESS), ("false", FAILURE)])
def test_round_robin_takes_the_next_child_at_each_turn(wraps: str, second: object) -> None:
    # Without wrap_around it fails after its last child, even if that has succeeded.
    body = leaves("SUCCESS", "SUCCESS")
    tree = Ticked(f'<RoundRobin wrap_around="{wraps}">{body}</RoundRobin>')
    assert tree.run(3) == [SUCCESS, second, SUCCESS]
    assert tree.ticks == [2, 1]


def test_round_robin_fails_when_all_have_failed() -> None:
    tree = Ticked(f"<RoundRobin>{leaves('FAILURE', 'RUNNING FAILURE')}</RoundRobin>")
    assert tree.run(2) == [RUNNING, FAILURE]
    assert tree.ticks == [1, 2]


def test_rate_controller_ticks_its_child_at_a_rate() -> None:
    tree = Ticked(f'<RateController hz="10">{leaves("SUCCESS RUNNING SUCCESS")}</RateController>')
    gate: Any = tree.executor.root
    ticks = []
    for now_ms in range(0, 420, 20):
        tree.now_ms = now_ms
        tree.executor._world.now_us = now_ms * 1_000
        gate.execute()  # as below a PipelineSequence, which does not reset it
        ticks.append(tree.ticks[0])
    # Every 100 ms; the second time it runs for 20 ms more.
    assert ticks[:5] == [1] * 5
    assert ticks[5:7] == [2, 3]
    assert ticks[7:11] == [3] * 4
    assert ticks[11] == 4
    with pytest.raises(TickError, match="hz=0 is not positive"):
        Ticked(f'<RateController hz="0">{leaves("SUCCESS")}</RateController>').run()


def test_distance_controller_ticks_its_child_each_metre() -> None:
    pose = [0.0, 0.0]
    body = f'<DistanceController distance="1">{leaves("SUCCESS")}</DistanceController>'
    tree = Ticked(body, sources={"robot_pose": lambda: (pose[0], pose[1])})
    gate: Any = tree.executor.root
    ticks = []
    for step in range(9):
        pose[0] = 0.5 * step
        gate.execute()
        ticks.append(tree.ticks[0])
    assert ticks == [1, 1, 2, 2, 3, 3, 4, 4, 5]


def test_speed_controller_is_faster_the_faster_the_robot_is() -> None:
    ports = 'min_rate="1" max_rate="10" min_speed="0" max_speed="1"'
    speed = [1.0]
    body = f"<SpeedController {ports}>{leaves('SUCCESS')}</SpeedController>"
    tree = Ticked(body, sources={"robot_speed": lambda: speed[0]})
    gate: Any = tree.executor.root
    ticked_ms: list[int] = []
    for now_ms in range(0, 3_001, 100):
        speed[0] = 1.0 if now_ms < 500 else 0.0
        tree.executor._world.now_us = now_ms * 1_000
        before = tree.ticks[0]
        gate.execute()
        ticked_ms += [now_ms] * (tree.ticks[0] - before)
    assert ticked_ms == [0, 100, 200, 300, 400, 500, 1500, 2500]


def test_sources_that_are_missing_are_told_before_the_first_tick() -> None:
    with pytest.raises(FileError, match="the source 'robot_pose'"):
        Ticked(f"<DistanceController>{leaves('SUCCESS')}</DistanceController>")


def test_goal_updater_passes_the_latest_goal_on() -> None:
    body = (
        '<GoalUpdater input_goal="{goal}" output_goal="{used}"><Note what="{used}"/></GoalUpdater>'
    )
    latest: list[str | None] = [None]
    tree = Ticked(body, {"goal": "dock"}, sources={"goal_update": lambda: latest[0]})
    tree.run()
    latest[0] = "gate"
    tree.run()
    assert tree.seen == ["dock", "gate"]


# -- what Nav2's default trees need besides -----------------------------------------------------


def test_check_and_executor_know_the_same_nodes() -> None:
    assert NAV2.keys() == NAV2_NODES.keys()
    for name, model in NAV2_NODES.items():
        least, most = children_allowed(name, model.category)
        assert (least, most) == NAV2[name].CHILDREN, name


def test_a_node_of_the_program_goes_before_one_of_nav2() -> None:
    tree = BehaviorTree.from_text(
        '<root BTCPP_format="4"><BehaviorTree ID="M"><SingleTrigger><Go/></SingleTrigger>'
        "</BehaviorTree></root>"
    )
    tree.action("Go")(lambda: True)

    class Mine(TreeNode):
        CHILDREN = (1, 1)

        def tick(self) -> NodeStatus:
            return RUNNING

    tree.node("SingleTrigger")(Mine)
    assert isinstance(tree.executor.root, Mine)


def test_nonblocking_sequence_ticks_all_its_children() -> None:
    body = leaves("RUNNING SUCCESS", "SUCCESS", "RUNNING RUNNING SUCCESS")
    tree = Ticked(f"<NonblockingSequence>{body}</NonblockingSequence>")
    assert tree.run(3) == [RUNNING, RUNNING, SUCCESS]
    assert tree.ticks == [3, 3, 3]
    tree = Ticked(f"<NonblockingSequence>{leaves('RUNNING', 'FAILURE')}</NonblockingSequence>")
    assert tree.run() == [FAILURE]
    assert tree.halts == [1, 0]


def test_persistent_sequence_keeps_its_place_in_an_entry() -> None:
    body = leaves("SUCCESS", "RUNNING FAILURE SUCCESS", "SUCCESS")
    text = f'<PersistentSequence current_child_idx="{{at}}">{body}</PersistentSequence>'
    tree = Ticked(text, {"at": 1})
    assert tree.run(2) == [RUNNING, FAILURE]
    assert tree.ticks == [0, 2, 0]
    assert tree.board["at"] == 0
    assert tree.run() == [SUCCESS]
    assert tree.ticks == [1, 3, 1]
    tree = Ticked(text, {"at": 0})
    assert tree.run() == [RUNNING]
    tree.executor.halt()
    assert tree.board["at"] == 1
    with pytest.raises(TickError, match="'at' has no value"):
        Ticked(text).run()
    with pytest.raises(TickError, match="current_child_idx=-1 is not a child"):
        Ticked(text, {"at": -1}).run()


def test_pause_resume_controller_changes_its_child() -> None:
    wanted = iter([False, True, True, True, False, False, False])
    body = leaves("RUNNING RUNNING SUCCESS", "RUNNING", "SUCCESS", "RUNNING SUCCESS")
    text = f"<PauseResumeController>{body}</PauseResumeController>"
    tree = Ticked(text, sources={"paused": lambda: next(wanted)})
    # Works; begins to pause; pauses twice; begins to resume, which takes two ticks; works.
    assert tree.run(7) == [RUNNING] * 7
    assert tree.ticks == [2, 2, 1, 2]
    assert tree.halts == [1, 1, 0, 0]
    alone = Ticked(f"<PauseResumeController>{leaves('RUNNING SUCCESS')}</PauseResumeController>")
    assert alone.run(2) == [RUNNING, SUCCESS]


def test_single_trigger_runs_its_child_once_in_a_run() -> None:
    body = f"<SingleTrigger>{leaves('RUNNING SUCCESS')}</SingleTrigger>"
    tree = Ticked(f"<PipelineSequence>{body}{leaves('RUNNING')}</PipelineSequence>")
    # It goes on below a PipelineSequence, which then ends with it.
    assert tree.run(3) == [RUNNING, RUNNING, FAILURE]
    assert tree.ticks == [2, 1]
    # A new run does the work again.
    again = Ticked(f'<Repeat num_cycles="3">{body}</Repeat>', yields=False)
    assert again.run(2) == [RUNNING, SUCCESS]
    assert again.ticks == [4]


@pytest.mark.parametrize("port", ["", 'goal="{goal}"', 'goals="{goal}"'])
def test_goal_updated_controller_ticks_for_a_new_goal(port: str) -> None:
    body = f"<GoalUpdatedController {port}>{leaves('SUCCESS')}</GoalUpdatedController>"
    tree = Ticked(body, {"goal": "a"})
    gate = tree.executor.root
    found = []
    for goal in ("a", "a", "b", "b"):
        tree.board["goal"] = goal
        found.append(gate.execute())  # as below a PipelineSequence, which does not reset it
    assert found == [SUCCESS, RUNNING, SUCCESS, RUNNING]


NEAR, DETOUR, ELSEWHERE = [(0, 0), (1, 0)], [(0, 0), (0, 5), (1, 0)], [(0, 0), (9, 9)]


def test_path_longer_on_approach_ticks_for_a_detour_near_the_goal() -> None:
    text = f'<PathLongerOnApproach path="{{path}}">{leaves("RUNNING FAILURE")}'
    tree = Ticked(f"{text}</PathLongerOnApproach>")
    ends = []
    for path in (None, NEAR, NEAR, DETOUR, DETOUR, DETOUR, ELSEWHERE, NEAR):
        if path is not None:
            tree.board["path"] = path
        ends += tree.run()
    assert ends == [SUCCESS, SUCCESS, SUCCESS, RUNNING, FAILURE, SUCCESS, SUCCESS, SUCCESS]
    # One of as many points counts as the same path.
    for path in (NEAR, [(0, 0), (0, 3), (1, 0)], [(0, 0), (9, 3), (1, 0)]):
        tree.board["path"] = path
        tree.run()
    assert tree.ticks == [3]
    tree.board["path"] = "no path"
    with pytest.raises(TickError, match=r"list of points \(x, y\)"):
        tree.run()


def test_goal_updater_takes_many_goals_too() -> None:
    body = '<GoalUpdater input_goals="{a}" output_goals="{b}"><Note what="{b}"/></GoalUpdater>'
    tree = Ticked(body, {"a": "x;y"})
    assert tree.run() == [SUCCESS]
    assert tree.seen == ["x;y"]


def test_recovery_node_tries_once_again_by_default() -> None:
    tree = Ticked(f"<RecoveryNode>{leaves('FAILURE', 'SUCCESS')}</RecoveryNode>")
    assert tree.run() == [FAILURE]
    assert tree.ticks == [2, 1]


# -- below controls that tick their children again ----------------------------------------------


def begun(gate: str, seconds: float, **entries: Any) -> list[float]:
    """When a plan is made while a robot that does not move follows a path for so long."""
    tree = BehaviorTree.from_text(
        '<root BTCPP_format="4"><BehaviorTree ID="M"><PipelineSequence>'
        f"<{gate}><RecoveryNode><Plan/><AlwaysFailure/></RecoveryNode></{gate.split()[0]}>"
        "<Follow/></PipelineSequence></BehaviorTree></root>"
    )
    times: list[float] = []
    for name, value in entries.items():
        tree.blackboard[name] = value
    tree.source("robot_pose")(lambda: (0.0, 0.0))
    tree.source("robot_speed")(lambda: 0.1)

    @tree.action("Plan")
    async def plan() -> None:
        times.append(round(anyio.current_time(), 2))
        await anyio.sleep(0.05)

    @tree.action("Follow")
    async def follow() -> None:
        await anyio.sleep(seconds)

    status, _ = in_virtual_time(tree.run)
    assert status is SUCCESS
    return times


def test_the_gates_hold_below_a_pipeline_sequence() -> None:
    # A new period begins when the plan is there, 0.05 s later.
    assert begun('RateController hz="1"', 3.5) == [0.0, 1.05, 2.1, 3.15]
    assert begun('DistanceController distance="1"', 3.5) == [0.0]
    assert len(begun('SpeedController min_rate="1" max_rate="1"', 3.5)) == 4
    assert begun("GoalUpdatedController", 3.5, goal="dock") == [0.0]


def test_a_gate_that_a_condition_ended_before_its_first_round_begins_then() -> None:
    gate = f'<RateController hz="10" _successIf="go">{leaves("SUCCESS")}</RateController>'
    tree = Ticked(f"<PipelineSequence>{gate}{leaves('RUNNING')}</PipelineSequence>", {"go": True})
    tree.run(4)
    assert tree.ticks == [1, 4]


@pytest.mark.parametrize("kind", ["PipelineSequence", "NonblockingSequence"])
def test_an_action_that_has_succeeded_is_not_begun_again(kind: str) -> None:
    tree = BehaviorTree.from_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="M"><{kind}><A/><B/></{kind}>'
        "</BehaviorTree></root>"
    )
    starts: list[str] = []
    for name, seconds in (("A", 0.1), ("B", 1.0)):

        @tree.action(name)
        async def act(name: str = name, seconds: float = seconds) -> None:
            starts.append(name)
            await anyio.sleep(seconds)

    status, _ = in_virtual_time(tree.run)
    assert status is SUCCESS
    assert starts == ["A", "B"]


@pytest.mark.parametrize("exact", [False, True])
def test_a_pause_resume_controller_does_its_work_in_each_run(exact: bool) -> None:
    # Nav2's one does not reset its children when it ends, so that an action is not begun again.
    body = "<PauseResumeController><Act/></PauseResumeController>"
    tree = BehaviorTree.from_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="M"><Repeat num_cycles="3">{body}</Repeat>'
        "</BehaviorTree></root>",
        exact=exact,
    )
    starts: list[str] = []

    @tree.action("Act")
    async def act() -> None:
        starts.append("Act")
        await anyio.sleep(0.1)

    status, _ = in_virtual_time(tree.run)
    assert status is SUCCESS
    assert len(starts) == (1 if exact else 3)


@pytest.mark.parametrize("exact", [False, True])
def test_a_fallback_that_goes_on_counts_what_was_skipped_before(exact: bool) -> None:
    """The library forgets how many children were skipped only when all of them have ended."""
    fallback = '<Leaf says="SUCCESS" _skipIf="true"/><Leaf says="SUCCESS FAILURE"/>'
    body = f"<Fallback>{fallback}</Fallback>{leaves('RUNNING')}"
    tree = Ticked(f"<PipelineSequence>{body}</PipelineSequence>", exact=exact)
    assert tree.run(2) == [RUNNING, RUNNING if exact else FAILURE]


def test_a_recovery_node_without_recovery_keeps_its_count() -> None:
    second = '<Leaf says="SUCCESS" _skipIf="skip"/>'
    tree = Ticked(f"<RecoveryNode>{leaves('FAILURE')}{second}</RecoveryNode>", {"skip": False})
    tree.run()
    assert tree.ticks == [2, 1]
    tree.board["skip"] = True
    assert tree.run() == [FAILURE]
    assert tree.ticks == [3, 1]


@pytest.mark.parametrize("kind", ["PipelineSequence", "RecoveryNode", "RoundRobin", "GoalUpdater"])
def test_what_is_skipped_with_its_children_is_idle(kind: str) -> None:
    count = NAV2[kind].CHILDREN[0]
    body = '<Leaf says="SUCCESS" _skipIf="true"/>' * count
    tree = Ticked(f"<{kind}>{body}</{kind}>")
    assert tree.run() == [SKIPPED]
    assert tree.is_idle
