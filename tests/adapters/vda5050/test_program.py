"""A vehicle's robot as its runtime sees it: tasks, bids, faults. The broker has its own tests
(tests/processes/test_vda5050.py).
"""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import anyio
import pytest

from mrbt_mesh.adapters.vda5050 import program as vda5050_program
from mrbt_mesh.adapters.vda5050.layout_file import load_layout
from mrbt_mesh.adapters.vda5050.messages import Link
from mrbt_mesh.adapters.vda5050.other_adapters import (
    ADAPTER,
    GONE,
    HERE,
    HOLD_S,
    OrderedWork,
    VehicleClaim,
    message,
)
from mrbt_mesh.adapters.vda5050.program import ConnectedVehicle
from mrbt_mesh.errors import TaskFailedError
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.sim.world.clock import VirtualClock, VirtualLoop
from tests.support import fake_port
from tests.support.extras import said_without
from tests.support.fake_port import Told
from tests.support.paths import EXAMPLES
from tests.support.vda5050.model_agv import ModelAgv

F2 = load_layout(EXAMPLES / "warehouse/agvs.yaml").addresses["F2"].topic("mrbt")


OWN = ("count", "deliver")
STOPS = load_layout(EXAMPLES / "warehouse/agvs.yaml").local_tasks["count"].filled(("R1",)).stops


def context(port: Any) -> TaskContext:
    return fake_port.context(port, "", robot="F1", robot_type="Fork", capabilities=OWN)


class Robot:
    """A member with a model vehicle, connected by hand."""

    def __init__(self) -> None:
        self.told = Told()
        self.file = load_layout(EXAMPLES / "warehouse/agvs.yaml")
        self.member = ConnectedVehicle(self.file, "F1")
        self.member._background = context(self.told)
        self.agv = ModelAgv("W1", 0, 0)

    @classmethod
    def connected(cls) -> Robot:
        """One whose vehicle has sent its state."""
        robot = cls()
        robot.connect()
        robot.hear()
        return robot

    def connect(self) -> None:
        self.member._apply(self.member.vehicle.linked)
        self.take("connection", {"connectionState": str(Link.ONLINE)})

    def take(self, name: str, message: Any) -> None:
        self.member._take(name, json.dumps(message).encode())

    def hear(self, **changes: Any) -> None:
        self.take("state", self.agv.message(**changes))

    def deliver(self) -> None:
        sent, self.member._outbox = self.member._outbox, []
        for each in sent:
            if each.topic == ADAPTER:
                continue
            self.agv.take(each.topic, each.body)

    def capabilities(self) -> list[tuple[Any, ...]]:
        found = [each for each in self.told.said if "capability" in each[0]]
        self.told.said.clear()
        return found


def test_without_the_extra_it_says_what_to_install() -> None:
    layout = EXAMPLES / "warehouse/agvs.yaml"
    call = f"robot_program({str(layout)!r})._functions.check_computer()"
    said = said_without("aiomqtt", "mrbt_mesh.adapters.vda5050", call)
    assert "pip install 'mrbt-mesh[vda5050]'" in said


def test_the_package_does_not_import_the_library() -> None:
    text = Path("mrbt_mesh/adapters/vda5050/program.py")
    assert "\nimport aiomqtt" not in (EXAMPLES.parent / text).read_text()


async def test_faults_take_capabilities_and_give_them_back() -> None:
    robot = Robot()
    robot.connect()
    *_, last = robot.capabilities()
    assert last == ("defer_capability", "all", "the vehicle has not sent its state")
    robot.hear()
    assert robot.capabilities() == [("restore_capability", "all")]
    manual = ("lose_capability", "all", "the vehicle's operating mode is MANUAL", True)
    robot.hear(operatingMode="MANUAL")
    assert robot.capabilities() == [manual]
    robot.hear()
    assert robot.capabilities() == [("restore_capability", "all")]
    # An error that the layout file names prevents one local task.
    broken = [{"errorType": "forkError", "errorLevel": "WARNING"}]
    deliver = ("lose_capability", "deliver", "the vehicle has an error: forkError", True)
    robot.hear(errors=broken)
    assert robot.capabilities() == [deliver]
    robot.hear(errors=broken, operatingMode="MANUAL")
    assert robot.capabilities() == [manual]
    robot.hear(errors=broken)
    assert robot.capabilities() == [("restore_capability", "all"), deliver]
    robot.hear()
    assert robot.capabilities() == [("restore_capability", "deliver")]


async def test_a_vehicle_that_is_not_there_yet_is_no_fault_until_the_start_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(vda5050_program, "START_UP_S", 0.0)
    robot = Robot()
    robot.member._tell_faults()
    assert robot.capabilities() == [("defer_capability", "all", "no connection to the broker")]
    await robot.member._end_start_up()
    robot.member._broker_error = " localhost:1883: refused"
    robot.member._tell_faults()
    said = "no connection to the broker localhost:1883: refused"
    assert robot.capabilities() == [("lose_capability", "all", said, True)]


async def test_a_bid_waits_for_the_first_state() -> None:
    robot = Robot()
    bids: list[float | None] = []

    async def ask() -> None:
        bids.append(await robot.member.bid(STOPS))

    async with anyio.create_task_group() as group:
        group.start_soon(ask)
        await anyio.wait_all_tasks_blocked()
        assert bids == []
        robot.connect()
        robot.hear()
    assert bids == [-6.0]
    robot.hear(operatingMode="MANUAL")
    assert await robot.member.bid(STOPS) is None


async def test_a_task_is_an_order_and_fails_with_a_reason() -> None:
    robot = Robot.connected()
    port = Told()
    async with anyio.create_task_group() as group:
        group.start_soon(robot.member.perform, context(port), STOPS)
        await anyio.wait_all_tasks_blocked()
        robot.deliver()
        for _ in range(3):
            robot.agv.step()
            robot.hear()
    assert [name for name, *_ in port.said] == ["report_progress"] * 2


async def test_a_refused_task_fails_with_the_vehicles_words() -> None:
    robot = Robot.connected()
    robot.agv.refuses = True

    async def perform() -> None:
        with pytest.raises(TaskFailedError, match="refused the order: orderError"):
            await robot.member.perform(context(Told()), STOPS)

    async with anyio.create_task_group() as group:
        group.start_soon(perform)
        await anyio.wait_all_tasks_blocked()
        robot.deliver()
        robot.hear()


async def test_a_cancelled_task_ends_when_its_vehicle_has_stopped() -> None:
    robot = Robot.connected()
    ended = anyio.Event()

    async def perform() -> None:
        try:
            await robot.member.perform(context(Told()), STOPS)
        finally:
            ended.set()

    async with anyio.create_task_group() as group:
        group.start_soon(perform)
        await anyio.wait_all_tasks_blocked()
        robot.deliver()
        robot.hear()
        group.cancel_scope.cancel()
        with anyio.CancelScope(shield=True):
            await anyio.wait_all_tasks_blocked()
            assert not ended.is_set()
            assert robot.agv.is_active
            robot.deliver()
            robot.hear()
    assert ended.is_set()
    assert not robot.agv.is_active


async def test_positions_of_the_layouts_map_are_told_and_nonsense_is_left_out() -> None:
    robot = Robot()
    robot.connect()
    robot.take("visualization", {"agvPosition": {"x": 1, "y": 2, "theta": 0.5, "mapId": "hall"}})
    robot.take("visualization", {"agvPosition": {"x": 1, "y": 2, "theta": 0.5, "mapId": "yard"}})
    assert [each for each in robot.told.said if each[0] == "report_position"] == [
        ("report_position", 1.0, 2.0, 0.5)
    ]
    for nonsense in ([], {"orderId": 3}, "x"):
        robot.take("state", nonsense)
    assert robot.member.vehicle.state is None


class Broker:
    """A connection to the broker that keeps what is published; those who `watch` hear of it."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []

    async def publish(self, topic: str, payload: bytes, **_: Any) -> None:
        self.published.append((topic, json.loads(payload)))

    async def subscribe(self, topic: str, **_: Any) -> None:
        pass

    async def unsubscribe(self, topic: str) -> None:
        pass

    def cancels(self) -> list[str]:
        """The ids of the cancellations."""
        bodies = [body.get("actions", body.get("instantActions")) for _, body in self.published]
        actions = [action for each in bodies if each for action in each]
        return [each["actionId"] for each in actions if each["actionType"] == "cancelOrder"]


ORDER_ID = "mrbt-F2-x-order-1"
WORK = OrderedWork("act-1", "count(R1)")
CLAIM = VehicleClaim(WORK, ORDER_ID, (f"{ORDER_ID}/1",))


class Takeover:
    """F1 is given what the vehicle of F2 is at, in virtual time."""

    def __init__(self) -> None:
        self.robot, self.broker = Robot(), Broker()
        self.group: Any = None
        self.agv = ModelAgv("W2", 0, 0)

    def run(self, story: Callable[[], Awaitable[None]]) -> None:
        async def main() -> None:
            self.robot.connect()
            self.robot.hear()
            async with anyio.create_task_group() as group:
                self.group = group
                await story()
                group.cancel_scope.cancel()

        clock = VirtualClock()
        anyio.run(main, backend_options={"loop_factory": lambda: VirtualLoop(clock)})

    def says(self, payload: bytes) -> None:
        """An adapter says something on the topic of F2."""
        self.robot.member._adapters.hear(F2, payload, self.group, cast(Any, self.broker))

    def claims(self) -> None:
        self.says(HERE)
        self.says(message("works", claim=CLAIM.said()))

    async def begin(self, *partners: str) -> None:
        """F1's task begins; it may have to wait."""
        task = replace(context(self.robot.told), local_task="count(R1)", partners=partners)
        self.group.start_soon(self.robot.member.perform, task, STOPS)
        await anyio.wait_all_tasks_blocked()

    def hears(self, **changes: Any) -> None:
        """The vehicle of F2 says its state."""
        body = self.agv.message(**{"orderId": ORDER_ID} | changes)
        topic = F2.replace("mrbt", "state")
        self.robot.member._adapters.hear_state(topic, json.dumps(body).encode(), False)

    async def passes(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.25)):
            await anyio.sleep(0.25)
            self.robot.member._apply(self.robot.member.vehicle.tick)
            await anyio.wait_all_tasks_blocked()

    @property
    def has_begun(self) -> bool:
        return self.robot.member._job is not None


def actions(status: str, *more: dict[str, Any]) -> dict[str, Any]:
    return {"actionStates": [{"actionId": f"{ORDER_ID}/1", "actionStatus": status}, *more]}


def cancelling(action_id: str, status: str) -> dict[str, Any]:
    return {"actionId": action_id, "actionType": "cancelOrder", "actionStatus": status}


def test_the_vehicle_of_a_robot_that_died_has_stopped_before_another_gets_its_work() -> None:
    """Vehicles report a cancellation RUNNING until what cannot be interrupted has ended."""
    world = Takeover()

    async def story() -> None:
        world.claims()
        world.says(GONE)
        await world.begin()
        await world.passes(1.0)
        (cancel,) = world.broker.cancels()
        for _ in range(10):
            world.hears(**actions("RUNNING", cancelling(cancel, "RUNNING")))
            await world.passes(1.0)
            assert not world.has_begun
        assert world.broker.cancels() == [cancel]
        (told,) = {each[1:] for each in world.robot.capabilities() if "count(R1)" in each}
        assert "the vehicle of F2 may still do it" in told[1]
        world.hears(**actions("FAILED", cancelling(cancel, "FINISHED")))
        await world.passes(0.5)
        assert world.has_begun
        assert ("restore_capability", "count(R1)") in world.robot.capabilities()

    world.run(story)


def test_what_such_a_vehicle_does_to_its_end_is_not_done_again() -> None:
    world = Takeover()

    async def story() -> None:
        world.claims()
        world.says(GONE)
        await world.begin()
        await world.passes(1.0)
        (cancel,) = world.broker.cancels()
        world.hears(**actions("RUNNING", cancelling(cancel, "RUNNING")))
        world.hears(**actions("FINISHED", cancelling(cancel, "FINISHED")))
        world.robot.member._outbox.clear()
        await world.passes(0.5)
        assert not world.has_begun
        assert world.robot.member._outbox == []

    world.run(story)


def test_a_vehicle_that_refuses_to_stop_is_waited_for_but_not_for_ever() -> None:
    world = Takeover()

    async def story() -> None:
        world.claims()
        world.says(GONE)
        await world.begin()
        while anyio.current_time() < HOLD_S - 1:
            for cancel in world.broker.cancels():
                world.hears(**actions("RUNNING", cancelling(cancel, "FAILED")))
            await world.passes(1.0)
        assert not world.has_begun
        await world.passes(2.0)
        assert world.has_begun

    world.run(story)


def test_other_work_does_not_wait_for_a_vehicle_that_does_not_stop() -> None:
    world = Takeover()

    async def story() -> None:
        world.says(
            message("works", claim=replace(CLAIM, work=OrderedWork("a", "count(R9)")).said())
        )
        world.says(GONE)
        await world.begin()
        assert world.has_begun

    world.run(story)


def test_a_robot_that_is_frozen_keeps_its_work_until_its_vehicle_is_stopped() -> None:
    """The team has given it up already, and the broker has not yet sent the last will."""
    world = Takeover()

    async def story() -> None:
        world.claims()
        await world.begin()
        await world.passes(7.5)
        assert not world.has_begun
        world.says(GONE)
        await world.passes(1.0)
        (cancel,) = world.broker.cancels()
        world.hears(**actions("FAILED", cancelling(cancel, "FINISHED")))
        await world.passes(0.5)
        assert world.has_begun

    world.run(story)


def test_partners_do_the_same_at_the_same_time() -> None:
    world = Takeover()

    async def story() -> None:
        world.claims()
        await world.begin("F2")
        assert world.has_begun

    world.run(story)


@pytest.mark.parametrize("done", [False, True])
def test_a_robot_that_lives_says_when_its_vehicle_has_stopped(done: bool) -> None:
    world = Takeover()

    async def story() -> None:
        world.claims()
        world.says(message("stopping"))
        await world.begin()
        await world.passes(5.0)
        assert not world.has_begun
        world.says(message("stopped", done=done))
        await world.passes(0.5)
        assert world.has_begun is not done

    world.run(story)


def test_an_adapter_that_is_back_at_once_is_not_taken_for_dead() -> None:
    world = Takeover()

    async def story() -> None:
        world.says(GONE)
        await world.begin()
        assert not world.has_begun
        world.says(HERE)
        await world.passes(1.0)
        assert world.has_begun
        assert world.broker.cancels() == []

    world.run(story)


async def test_what_an_order_is_for_is_said_before_it_and_taken_back_after_it() -> None:
    robot = Robot.connected()
    robot.member._outbox.clear()
    said: list[Any] = []
    async with anyio.create_task_group() as group:
        group.start_soon(robot.member.perform, context(Told()), STOPS)
        await anyio.wait_all_tasks_blocked()
        claim, order = robot.member._outbox
        assert (claim.topic, order.topic) == (ADAPTER, "order")
        assert claim.body["claim"]["order"] == order.body["orderId"]
        robot.deliver()
        robot.hear()
        group.cancel_scope.cancel()
        with anyio.CancelScope(shield=True):
            await anyio.wait_all_tasks_blocked()
            for _ in range(2):
                said += [e.body["adapter"] for e in robot.member._outbox if e.topic == ADAPTER]
                robot.deliver()
                robot.hear()
    said += [e.body["adapter"] for e in robot.member._outbox if e.topic == ADAPTER]
    assert said == ["stopping", "stopped"]


async def test_states_that_cannot_be_read_are_a_fault_that_says_so() -> None:
    robot = Robot()
    robot.connect()
    robot.hear(operatingMode=None)
    *_, (_, _, why) = robot.capabilities()
    assert "has not sent its state that can be read: operatingMode is not text" in why


async def test_a_broker_that_ends_with_all_last_wills_stops_and_loses_nothing() -> None:
    robot, broker = Robot.connected(), Broker()
    robot.capabilities()
    broken = json.dumps({"connectionState": str(Link.BROKEN)}).encode()
    async with anyio.create_task_group() as group:
        robot.member._adapters.hear(F2, GONE, group, cast(Any, broker))
        group.start_soon(robot.member._take_link, broken)
        await anyio.wait_all_tasks_blocked()
        group.cancel_scope.cancel()  # as the end of the connection does
    assert (broker.published, robot.capabilities()) == ([], [])
    await robot.member._take_link(broken)  # the broker lives on
    said = f"the vehicle is not online (connection topic: {Link.BROKEN})"
    assert robot.capabilities() == [("lose_capability", "all", said, True)]
