"""Ways in which a robot's program may misbehave: no robot dies of it, and each is told by name.

Two robots, in virtual time, run a mission of one local task, `bad`. A way is a function: a local
task, a bid, a background function, or a leaf of a BehaviorTree.CPP tree. `told` is what the reason
of the failure, or the problem of the program, says of it; None: there is nothing to tell.
"""

from __future__ import annotations

import asyncio
import gc
import re
import time
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import replace
from typing import Any

import anyio
import numpy as np
import pytest

from mrbt_mesh import RobotProgram, TaskContext, TaskFailedError
from mrbt_mesh.btcpp import BehaviorTree, NodeStatus
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.runtime import bid_calls
from mrbt_mesh.runtime.program import functions_of
from mrbt_mesh.runtime.user_code import UserCall
from mrbt_mesh.sim import Lose, SimulationResult, run, simulate
from tests.support.build import action, make_mission, sequence, task
from tests.support.effort import at_size
from tests.support.misbehaving_code import HERE, STARTED, WAYS, Way, way

# -- what it leaves behind --------------------------------------------------------------------


@way(f"a task started by: ValueError: later {HERE}", result="success")
async def starts_a_task_that_fails_later(task: TaskContext) -> None:
    async def later() -> None:
        await asyncio.sleep(1)
        raise ValueError("later")

    STARTED.append(asyncio.ensure_future(later()))


@way(f"a task started by: SystemExit: 4 {HERE}", result="success")
async def starts_a_task_that_exits_later(task: TaskContext) -> None:
    async def later() -> None:
        await asyncio.sleep(1)
        raise SystemExit(4)

    STARTED.append(asyncio.ensure_future(later()))


# Of what runs for nobody only the log knows.
@way(None, result="success")
async def exits_in_a_callback(task: TaskContext) -> None:
    def leave() -> None:
        raise SystemExit(5)

    asyncio.get_running_loop().call_later(1, leave)


@way(None, result="success")
async def leaks_an_async_generator(task: TaskContext) -> None:
    async def poses() -> AsyncIterator[int]:
        try:
            yield 1
        finally:
            await asyncio.sleep(1)

    async for _ in poses():
        break


@way(None, result="success")
async def raises_in_a_destructor(task: TaskContext) -> None:
    class Arm:
        def __del__(self) -> None:
            raise OSError("gone")

    Arm()


# -- code that blocks -------------------------------------------------------------------------


def is_noticed() -> bool:
    """True once the watchdog has named the code that runs now, however busy the machine is."""
    return UserCall.stepping is not None and UserCall.stepping.blocked != ""


@way(r"blocked for 0\.1 s of real time at test_user_code_misbehaviour\.py:\d+")
async def sleeps_for_real(task: TaskContext) -> None:
    while not is_noticed():
        time.sleep(0.05)


@way(r"blocked for 0\.1 s of real time at test_user_code_misbehaviour\.py:\d+")
async def computes_for_long(task: TaskContext) -> None:
    while not is_noticed():
        pass


# -- bids -------------------------------------------------------------------------------------


def bidding(name: str, bid: Callable[..., Any], told: str) -> None:
    bid.__name__ = name
    way(f"^made no bid: {told}", "bid", "success")(bid)


async def _cancelled_bid(task: TaskContext) -> float:
    future = asyncio.get_running_loop().create_future()
    future.cancel()
    return float(await future)


async def _endless_bid(task: TaskContext) -> float:
    await anyio.sleep_forever()
    return 1.0


def _exiting_bid(task: TaskContext) -> float:
    raise SystemExit(2)


def _slow_bid(task: TaskContext) -> float:
    while not is_noticed():
        time.sleep(0.05)
    return 1.0


bidding("bid_divides", lambda: 1 / 0, f"ZeroDivisionError: division by zero {HERE}")
bidding("bid_exits", _exiting_bid, f"SystemExit: 2 {HERE}")
bidding("bid_awaits_a_cancelled_future", _cancelled_bid, f"CancelledError.* {HERE}")
bidding("bid_never_comes", _endless_bid, "no answer within 5 s")
bidding("bid_is_a_text", lambda: "3", "a bid is a number from -1000000 to 1000000, or None")
bidding("bid_is_no_number", lambda: float("nan"), "a bid is a number")
bidding("bid_blocks", _slow_bid, "blocked for 0.1 s of real time")


# -- background functions ---------------------------------------------------------------------


def sensing(name: str, error: BaseException, told: str) -> None:
    async def sense() -> None:
        await anyio.sleep(1)
        raise error

    sense.__name__ = name
    way(told, "background", "success")(sense)


sensing("background_fails", ValueError("no camera"), f"ValueError: no camera {HERE}")
sensing("background_exits", SystemExit(6), f"SystemExit: 6 {HERE}")
sensing("background_is_cancelled", asyncio.CancelledError(), f"CancelledError.* {HERE}")
sensing("background_interrupts", KeyboardInterrupt(), f"KeyboardInterrupt {HERE}")


# -- leaves of its trees ----------------------------------------------------------------------


def leaf(name: str, category: str, function: Callable[..., Any], told: str | None) -> None:
    async def work(task: TaskContext) -> None:
        robot = RobotProgram()
        getattr(robot, category)("Leaf")(function)
        tree = BehaviorTree.from_text(
            '<root BTCPP_format="4"><BehaviorTree ID="M"><Leaf/></BehaviorTree></root>'.replace(
                "<Leaf/>", f'<{category.capitalize()} ID="Leaf"/>'
            ),
            leaves=functions_of(robot).leaves,
        )
        if await tree.run() is not NodeStatus.SUCCESS:
            raise TaskFailedError("the tree failed")

    work.__name__ = name
    way(told)(work)


def _exits() -> bool:
    raise SystemExit(7)


async def _exits_later() -> bool:
    await anyio.sleep(1)
    raise SystemExit(7)


async def _waits() -> bool:
    await anyio.sleep(1)
    return True


async def _cancelled() -> None:
    future = asyncio.get_running_loop().create_future()
    future.cancel()
    await future


leaf("condition_exits", "condition", _exits, f"SystemExit: 7 {HERE}")
leaf("condition_says_no", "condition", lambda: "no", "Leaf returned 'no', which is not a status")
leaf("condition_waits", "condition", _waits, "the condition 'Leaf' waits")
leaf("condition_of_numpy", "condition", lambda: np.bool_(False), "the tree failed")
leaf("action_exits", "action", _exits_later, f"SystemExit: 7 {HERE}")
leaf("action_awaits_a_cancelled_future", "action", _cancelled, f"CancelledError.* {HERE}")
leaf("action_returns_zero", "action", lambda: 0, "Leaf returned 0, which is not a status")


# -- the runs ---------------------------------------------------------------------------------


def mission_of(kind: str) -> Mission:
    able = {"bad": 1.0, "rest": 1.0}
    needed = ("bad", 1, 1, True) if kind == "bid" else ("bad", 1, 1)
    mission = make_mission(
        sequence(action("bad"), action("rest")),
        {"R1": able, "R2": able},
        [task("bad", needed), task("rest", ("rest", 1, 1))],
    )
    return replace(mission, conditions={"heavy": ConditionType("heavy")})


async def rest(task: TaskContext) -> None:
    await anyio.sleep(10)


def result_of_travel(case: Way) -> SimulationResult:
    """The same as the function that drives to the place of the local task."""
    robot = RobotProgram()
    robot.local_task("*")(rest)

    @robot.travel
    async def drive(task: TaskContext, place: str) -> Any:
        is_bad = case.kind == "local task" or task.robot == "R1"
        return await (case.function if is_bad else rest)(task)

    places = {"dock": (0, 0), "home": (0, 0)}
    travel = Travel(places, {"bad": "dock"}, {"R1": "home", "R2": "home"}, {"R1": 1, "R2": 1})
    mission = replace(mission_of(case.kind), travel=travel)
    schedule = [(2_000_000, Lose("R1", "bad"))] if case.kind == "cancelled" else []
    return simulate(mission, robot, seed=1, schedule=schedule, timeout_us=200_000_000)


def result_of(case: Way) -> SimulationResult:
    robot = RobotProgram()
    robot.local_task("rest")(rest)
    schedule: list[tuple[int, Lose]] = []
    match case.kind:
        case "local task":
            robot.local_task("bad")(case.function)
        case "cancelled":
            # The first robot loses the capability at 2 s, and is cancelled.
            async def bad(task: TaskContext) -> Any:
                return await (case.function if task.robot == "R1" else rest)(task)

            robot.local_task("bad")(bad)
            schedule = [(2_000_000, Lose("R1", "bad"))]
        case "bid":
            robot.local_task("bad")(rest)
            robot.bid("bad")(case.function)
        case "background":
            robot.local_task("bad")(rest)
            robot.background(costs="none")(case.function)
    return simulate(mission_of(case.kind), robot, seed=1, schedule=schedule, timeout_us=200_000_000)


@pytest.fixture(scope="module", autouse=True)
def own_garbage() -> None:
    """What other tests left is not gone through again after each of these."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def short_limit(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(run, "BLOCK_LIMIT_S", 0.1)
    monkeypatch.setattr(bid_calls, "BID_LIMIT_S", 5.0)
    yield
    STARTED.clear()
    gc.collect()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", WAYS)
def test_no_robot_dies_and_each_way_is_told(name: str) -> None:
    case = WAYS[name]
    found = result_of(case)
    said = check(case, found)
    assert found.result == case.result
    if case.told is None:
        assert said == []
    else:
        assert any(re.search(case.told, each) for each in said), said


OF_LOCAL_TASKS = [n for n, each in WAYS.items() if each.kind in ("local task", "cancelled")]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", at_size(quick=OF_LOCAL_TASKS[::4], gate=OF_LOCAL_TASKS))
def test_a_function_that_drives_may_do_the_same(name: str) -> None:
    case = WAYS[name]
    found = result_of_travel(case)
    told = check(case, found)
    if case.kind == "local task" and case.result == "failure":
        assert found.result == "failure"
        assert any(each.startswith("cannot reach dock") for each in told), told


def check(case: Way, found: SimulationResult) -> list[str]:
    """What the run says of the case, in which no robot may die."""
    assert not [each for each in found.summary["faults"] if each["kind"] == "major"]
    # Of code that does not stop, the checkers say that it runs beside its successor.
    assert case.kind == "cancelled" or not found.violations
    said = [each["reason"] for each in found.summary["failures"]]
    said += [each["problem"] for each in found.summary["problems"]]
    return [each for each in said if each]


@pytest.mark.parametrize(("name", "ends"), [("long", True), ("ever", False)])
def test_that_code_still_runs_is_a_problem_until_it_has_ended(name: str, ends: bool) -> None:
    found = result_of(WAYS[f"shields_itself_for_{name}"])
    (problem,) = found.summary["problems"]
    assert "still runs" in problem["problem"]
    assert (problem.get("until_s") is not None) is ends


def test_there_are_enough_of_them() -> None:
    assert len(WAYS) >= 60
