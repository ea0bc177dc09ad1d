"""A vehicle's robot as its runtime sees it: tasks, bids, faults. The broker has its own tests
(tests/processes/test_vda5050.py).
"""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import anyio
import pytest

from mrbt_mesh.adapters.vda5050 import program as vda5050_program
from mrbt_mesh.adapters.vda5050.layout_file import load_layout
from mrbt_mesh.adapters.vda5050.messages import Link
from mrbt_mesh.adapters.vda5050.other_adapters import GONE, GRACE_S, HERE, STOPPED
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
            self.agv.take(each.topic, each.body)

    def capabilities(self) -> list[tuple[str, ...]]:
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
    manual = ("lose_capability", "all", "the vehicle's operating mode is MANUAL")
    robot.hear(operatingMode="MANUAL")
    assert robot.capabilities() == [manual]
    robot.hear()
    assert robot.capabilities() == [("restore_capability", "all")]
    # An error that the layout file names prevents one local task.
    broken = [{"errorType": "forkError", "errorLevel": "WARNING"}]
    deliver = ("lose_capability", "deliver", "the vehicle has an error: forkError")
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
    assert robot.capabilities() == [("lose_capability", "all", said)]


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
    for message in ([], {"orderId": 3}, "x"):
        robot.take("state", message)
    assert robot.member.vehicle.state is None


def client() -> Any:
    """A connection to the broker that keeps what is published."""
    published: list[str] = []

    async def publish(topic: str, *_: Any, **__: Any) -> None:
        published.append(topic)

    return SimpleNamespace(published=published, publish=publish)


@pytest.mark.parametrize(
    ("later", "stops"),
    [(None, True), (HERE, False), (STOPPED, False)],
)
def test_the_vehicle_of_a_robot_that_died_is_stopped_before_another_order_goes(
    later: bytes | None, stops: bool
) -> None:
    broker = client()

    async def main() -> None:
        robot = Robot.connected()
        async with anyio.create_task_group() as group:
            robot.member._adapters.hear(F2, GONE, group, broker)
            group.start_soon(robot.member.perform, context(robot.told), ())
            await anyio.wait_all_tasks_blocked()
            assert robot.member._job is None
            if later is not None:
                robot.member._adapters.hear(F2, later, group, broker)
            while robot.member._job is None:
                await anyio.sleep(0.01)
            await anyio.sleep(2 * GRACE_S)
            group.cancel_scope.cancel()

    clock = VirtualClock()
    anyio.run(main, backend_options={"loop_factory": lambda: VirtualLoop(clock)})
    wanted = [F2.replace("mrbt", "instantActions"), F2]
    assert broker.published == (wanted if stops else [])


async def test_a_broker_that_ends_with_all_last_wills_stops_and_loses_nothing() -> None:
    robot, broker = Robot.connected(), client()
    robot.capabilities()
    broken = json.dumps({"connectionState": str(Link.BROKEN)}).encode()
    async with anyio.create_task_group() as group:
        robot.member._adapters.hear(F2, GONE, group, broker)
        group.start_soon(robot.member._take_link, broken)
        await anyio.wait_all_tasks_blocked()
        group.cancel_scope.cancel()  # as the end of the connection does
    assert (broker.published, robot.capabilities()) == ([], [])
    await robot.member._take_link(broken)  # the broker lives on
    assert robot.capabilities() == [
        ("lose_capability", "all", f"the vehicle is not online (connection topic: {Link.BROKEN})")
    ]
