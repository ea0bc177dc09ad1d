"""Robots' programs bid: what becomes of whatever they may answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import anyio
import pytest

from mrbt_mesh import ProgramError, RobotProgram, TaskContext
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.features.bids.messages import BidMade, BidsMade, RequestBid
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.actions import ActionRunner, RobotIdentity
from mrbt_mesh.runtime.program_loader import check_program
from tests.support.action_host import Host
from tests.support.paths import mission_file

COURIERS = mission_file("couriers")
PARCELS = ("bread", "keys", "flowers")


class BidHost(Host):
    """Tells when the runner has said something."""

    def __init__(self) -> None:
        super().__init__()
        self.has_said = anyio.Event()

    def submit(self, event: Input) -> None:
        super().submit(event)
        self.has_said.set()

    @property
    def bids(self) -> list[BidsMade]:
        return [event for event in self.said if isinstance(event, BidsMade)]


def answers(program: RobotProgram, *parcels: str) -> list[BidsMade]:
    """What comes of asking for bids for these parcels at once, until somebody has answered."""

    async def ask() -> list[BidsMade]:
        host = BidHost()
        async with anyio.create_task_group() as group:
            identity = RobotIdentity("K1", "bicycle", 1, 1.0)
            runner = ActionRunner(group, program, load_mission(COURIERS), identity, host)
            for parcel in parcels:
                local_task = f"deliver({parcel})"
                name = f"delivery({parcel})"
                runner.carry_out(
                    RequestBid(f"a-{parcel}", name, local_task, 2 * MICRO, Incarnation(1, "n"))
                )
            await host.has_said.wait()
            group.cancel_scope.cancel()
        return host.bids

    return anyio.run(ask)


def answer(bid: Callable[..., Any]) -> BidMade:
    """What comes of one function's bid."""
    program = RobotProgram()
    program.bid("deliver")(bid)
    ((made,),) = (event.bids for event in answers(program, "bread"))
    assert (made.activation, made.local_task) == ("a-bread", "deliver(bread)")
    return made


def test_a_bid_may_be_a_plain_function_or_an_async_one() -> None:
    seen: list[TaskContext] = []

    def plain(task: TaskContext, parcel: str) -> float:
        seen.append(task)
        return -2.5 if parcel == "bread" else 0

    async def slowly(task: TaskContext, parcel: str) -> int:
        await anyio.lowlevel.checkpoint()
        return 3

    assert answer(plain).performance == -2_500_000
    assert answer(slowly).performance == 3_000_000
    (task,) = seen
    assert (task.robot, task.performance, task.arguments) == ("K1", 2.0, ("bread",))
    assert (task.global_task, task.activation) == ("delivery(bread)", "a-bread")


def test_none_is_no_bid_and_nothing_is_wrong_with_it() -> None:
    assert answer(lambda parcel: None) == BidMade("a-bread", "deliver(bread)", None)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e7, -1e7, True, "3", [1]])
def test_what_is_no_number_in_range_is_no_bid(value: Any) -> None:
    made = answer(lambda parcel: value)
    assert made.performance is None
    assert made.error.startswith("a bid is a number from -1000000 to 1000000, or None, not ")


def test_an_exception_is_no_bid_with_its_traceback() -> None:
    async def late(task: TaskContext, parcel: str) -> float:
        raise TimeoutError("the map server")

    def broken(task: TaskContext, parcel: str) -> float:
        return 1 / 0

    assert answer(broken).performance is None
    assert "ZeroDivisionError" in answer(broken).error
    assert "the map server" in answer(late).error
    assert "takes 0 arguments besides the context, found 1" in answer(lambda: 1.0).error


def test_bids_that_are_made_at_once_are_told_at_once() -> None:
    program = RobotProgram()

    @program.bid("*")
    async def bid(task: TaskContext, parcel: str) -> float:
        if parcel == "keys":
            await anyio.lowlevel.checkpoint()
        return len(parcel)

    (event,) = answers(program, *PARCELS)
    assert {made.local_task for made in event.bids} == {f"deliver({each})" for each in PARCELS}


def test_a_program_says_what_it_bids_for_once() -> None:
    program = RobotProgram()
    program.bid("deliver")(lambda parcel: 1.0)
    with pytest.raises(ProgramError, match="bid 'deliver' is registered twice"):
        program.bid("deliver")(lambda parcel: 2.0)
    with pytest.raises(ProgramError, match="is not a function"):
        program.bid("carry")(RobotProgram)


def test_a_program_without_the_bids_that_a_mission_asks_for_is_refused() -> None:
    mission = load_mission(COURIERS)
    program = RobotProgram()

    @program.local_task("*")
    async def anything(*_: object) -> None: ...

    assert check_program(program, mission, ["deliver"]) == [
        'no bid for the local task deliver; add @robot.bid("deliver")'
    ]
    program.bid("*")(lambda parcel: 1.0)
    assert check_program(program, mission, ["deliver"]) == []


def test_the_runner_names_a_bid_that_is_missing_all_the_same() -> None:
    """As where a robot is given a capability that its program does not know."""
    ((made,),) = (event.bids for event in answers(RobotProgram(), "bread"))
    assert made.error == "the robot's program has no bid for 'deliver'"
