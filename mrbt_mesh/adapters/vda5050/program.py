"""A robot program whose robots are VDA 5050 vehicles.

`vehicle.py` makes the decisions; this module adds the clock, the broker and the robot's runtime.
The broker sends the last will of this adapter to the adapters of the other robots, and one of them
cancels the vehicle's order: so a vehicle does not keep driving when its robot's process has died
and another robot takes over. Before an order is sent, the other adapters are told what it is for
(`other_adapters.py`), and none starts the same work until this vehicle has stopped.

A broker that is shut down normally sends all last wills before it ends, also those of vehicles. So
a last will counts only if its broker is still alive after `GRACE_S`.
"""

from __future__ import annotations

import json
import ssl
import time
import uuid
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anyio

from mrbt_mesh.adapters.binding import ALL, FillError, LostCapabilities, News
from mrbt_mesh.adapters.vda5050.dialects import CONNECTION, ORDER, STATE, VISUALIZATION, Message
from mrbt_mesh.adapters.vda5050.layout import RouteError, StopTemplate, TaskTemplate
from mrbt_mesh.adapters.vda5050.layout_file import LayoutFile, load_layout
from mrbt_mesh.adapters.vda5050.messages import (
    Link,
    MessageError,
    VehiclePlace,
    decode,
    read_link,
    read_place,
    read_state,
)
from mrbt_mesh.adapters.vda5050.other_adapters import (
    ADAPTER,
    GONE,
    GRACE_S,
    OrderedWork,
    OtherAdapters,
    VehicleClaim,
)
from mrbt_mesh.adapters.vda5050.vehicle import (
    HOLD_S,
    NO_BROKER,
    Effect,
    Ended,
    OrderProgress,
    Send,
    Vehicle,
)
from mrbt_mesh.errors import InputError, TaskFailedError, require
from mrbt_mesh.runtime.context import RobotContext, TaskContext
from mrbt_mesh.runtime.log import robot_logger
from mrbt_mesh.runtime.program import RobotProgram

if TYPE_CHECKING:
    import aiomqtt

TICK_S = 0.25
RECONNECT_S = 0.5
# How long a cancelled task waits for its vehicle to stop: short enough that the task itself does
# not count as hanging. Until the vehicle has stopped, it gets no other order, and no other vehicle
# gets the same work.
STOP_S = 4.0
# How long a bid waits for the first state.
FIRST_STATE_S = 5.0
# A vehicle that has sent nothing is pending for this long; after that it is a fault.
START_UP_S = 20.0


def robot_program(layout_file: str | Path, *, record_work: bool = False) -> RobotProgram:
    """A program for robots that are the vehicles of a layout file, listed by robot id.

    `record_work` is passed to RobotProgram. Raises InputError for a file that cannot be used.
    Whether the extra is installed is checked before a robot starts.
    """
    file = load_layout(Path(layout_file))
    program = RobotProgram(record_work=record_work)
    program.for_mission(file.check_mission)
    program.before_start(lambda: require("VDA 5050", "vda5050", "aiomqtt"))

    @cache
    def member(robot: str) -> ConnectedVehicle:
        return ConnectedVehicle(file, robot)

    @program.background
    async def connect(context: RobotContext) -> None:
        await member(context.robot).run(context)

    def serve(name: str, template: TaskTemplate) -> None:
        def filled(arguments: tuple[str, ...]) -> TaskTemplate:
            try:
                return template.filled(arguments)
            except FillError as error:
                raise TaskFailedError(str(error)) from None

        @program.local_task(name)
        async def perform(task: TaskContext, *arguments: str) -> None:
            wanted = filled(arguments)
            await member(task.robot).perform(task, wanted.stops)
            for condition, value in wanted.sets.items():
                task.set_condition(condition, value)

        @program.bid(name)
        async def bid(task: TaskContext, *arguments: str) -> float | None:
            return await member(task.robot).bid(filled(arguments).stops)

    for name, template in file.local_tasks.items():
        serve(name, template)
    return program


class ConnectedVehicle:
    """One robot's vehicle, its connection to the broker, and its running task."""

    def __init__(self, file: LayoutFile, robot: str) -> None:
        """Raises InputError if the file has no vehicle of this robot."""
        if robot not in file.vehicles:
            raise InputError(f"{file.file}: vehicles has no {robot}")
        self._file = file
        self._address = file.addresses[robot]
        self._log = robot_logger(robot).bind(vehicle=self._address.serial_number)
        self._session = uuid.uuid4().hex[:12]
        self.vehicle = Vehicle(
            f"{robot}-{self._session}",
            file.layout,
            self._address.dialect,
            file.battery,
            time.monotonic(),
            file.no_progress_s,
        )
        self._background: RobotContext | None = None
        self._job: TaskContext | None = None
        self._work: OrderedWork | None = None
        self._end: Ended | None = None
        self._outbox: list[Send] = []
        self._news = News()
        self._header_ids: dict[str, int] = {}
        self._is_starting = True
        self._broker_error = ""
        self._lost = LostCapabilities()
        self._refused: set[str] = set()
        self._adapters = OtherAdapters(file, robot, self._news.tell)
        self._link_news = 0

    # -- what the robot's runtime asks for ------------------------------------------------------

    async def perform(self, task: TaskContext, stops: tuple[StopTemplate, ...]) -> None:
        """Have the vehicle carry out an order; when cancelled, cancel it there too.

        Raises TaskFailedError.
        """
        work = OrderedWork(task.activation, task.local_task)
        while holder := self._adapters.holder(work, task.partners):
            self._log.info("waits_for_vehicle", robot=holder, local_task=task.local_task)
            while self._adapters.holder(work, task.partners) == holder:
                await self._news.wait()
        if self._adapters.was_done(work):
            self._log.warning("done_by_another_vehicle", local_task=task.local_task)
            return
        self._job, self._work, self._end = task, work, None
        try:
            self._apply(lambda now_s: self.vehicle.start(stops, now_s, work))
            while self._end is None:
                await self._news.wait()
        except BaseException:
            self._job = None
            self._apply(self.vehicle.cancel)
            with anyio.CancelScope(shield=True), anyio.move_on_after(STOP_S):
                while self.vehicle.is_reachable and not self.vehicle.is_clear:
                    await self._news.wait()
            raise
        self._job = None
        if not self._end.success:
            raise TaskFailedError(self._end.reason)

    async def bid(self, stops: tuple[StopTemplate, ...]) -> float | None:
        """Return minus the metres to drive; None if the vehicle cannot do it now."""
        with anyio.move_on_after(FIRST_STATE_S):
            while not self.vehicle.is_reachable:
                await self._news.wait()
        state = self.vehicle.state
        if state is None or self.vehicle.fault(time.monotonic()):
            return None
        try:
            return -round(self._file.layout.length_m(state, stops), 2)
        except RouteError:
            return None

    async def run(self, context: RobotContext) -> None:
        """Keep a connection to the broker as long as the robot lives."""
        self._background = context
        # Until its vehicle is heard, a robot must report that it can do nothing.
        self._tell_faults()
        async with anyio.create_task_group() as group:
            group.start_soon(self._tick)
            group.start_soon(self._end_start_up)
            while True:
                await self._connect()
                self._adapters.unlinked()
                self._apply(self.vehicle.unlinked)
                await anyio.sleep(RECONNECT_S)

    # -- the broker ----------------------------------------------------------------------------

    async def _connect(self) -> None:
        """Open one connection and serve it until it ends."""
        import aiomqtt

        broker, address = self._file.broker, self._address
        try:
            async with aiomqtt.Client(
                broker.host,
                broker.port,
                username=broker.username,
                password=broker.password,
                keepalive=broker.keepalive_s,
                tls_context=ssl.create_default_context() if broker.tls else None,
                will=aiomqtt.Will(address.topic(ADAPTER), GONE, qos=1),
                timeout=2 * broker.keepalive_s,
            ) as client:
                for name in (CONNECTION, STATE, VISUALIZATION):
                    await client.subscribe(address.topic(name), qos=1)
                self._broker_error = ""
                await self._adapters.begin(client)
                self._log.info("broker_connected", broker=f"{broker.host}:{broker.port}")
                self._outbox.clear()
                self._apply(self.vehicle.linked)
                await self._exchange(client)
        except (aiomqtt.MqttError, OSError) as error:
            self._broker_error = f" {broker.host}:{broker.port}: {error}"
            self._log.warning("broker_unreachable", error=str(error))

    async def _exchange(self, client: aiomqtt.Client) -> None:
        """Receive and send, until the connection ends."""
        import aiomqtt

        async with anyio.create_task_group() as group:
            group.start_soon(self._send_on, client)
            group.start_soon(self._adapters.look_for_the_dead, group, client)
            try:
                async for message in client.messages:
                    topic, payload = str(message.topic), message.payload
                    if not isinstance(payload, bytes | bytearray):
                        continue
                    name = topic.rpartition("/")[2]
                    if name == ADAPTER:
                        self._adapters.hear(topic, payload, group, client)
                    elif self._adapters.hear_state(topic, payload, message.retain):
                        continue
                    elif name == CONNECTION and not message.retain:
                        group.start_soon(self._take_link, payload)
                    elif name == CONNECTION or not message.retain:
                        # A retained state may be old, so it is ignored.
                        self._take(name, payload)
            except aiomqtt.MqttError as error:
                self._log.warning("broker_lost", error=str(error))
            except BaseException:
                # The robot stops cleanly, so the broker will not send the last will.
                with anyio.CancelScope(shield=True), anyio.move_on_after(STOP_S):
                    self._apply(self.vehicle.cancel)
                    await self._send(client)
                raise
            group.cancel_scope.cancel()

    async def _take_link(self, payload: bytes | bytearray) -> None:
        """Process a connection message; a last will counts only if the broker stays alive."""
        self._link_news += 1
        mine = self._link_news
        if str(Link.BROKEN).encode() in payload:
            await anyio.sleep(GRACE_S)
        if mine == self._link_news:
            self._take(CONNECTION, payload)

    async def _send_on(self, client: aiomqtt.Client) -> None:
        while True:
            await self._send(client)
            await self._news.wait()

    async def _send(self, client: aiomqtt.Client) -> None:
        import aiomqtt

        while self._outbox:
            effect = self._outbox.pop(0)
            if effect.topic == ADAPTER:
                await self._adapters.tell(client, json.dumps(effect.body).encode())
                continue
            try:
                payload = self._payload(effect.topic, effect.body)
                await client.publish(self._address.topic(effect.topic), payload)
            except aiomqtt.MqttError:
                # The connection has ended, which the receiving side notices; all is sent again.
                return

    def _payload(self, topic: str, body: Message) -> bytes:
        header_id = self._header_ids.get(topic, 0)
        self._header_ids[topic] = (header_id + 1) % (1 << 32)
        return json.dumps(self._address.headed(header_id, time.time(), body)).encode()

    def _take(self, name: str, payload: bytes | bytearray) -> None:
        """Process a message; an invalid one is logged once per topic and dropped."""
        try:
            message = decode(payload)
            if name == CONNECTION:
                link = read_link(message)
                self._log.info("vehicle_connection", state=str(link))
                self._apply(lambda now_s: self.vehicle.connection(link, now_s))
            elif name == STATE:
                state = read_state(message)
                self._tell_place(state.place)
                self._apply(lambda now_s: self.vehicle.said(state, now_s))
            elif name == VISUALIZATION:
                self._tell_place(read_place(message))
        except MessageError as error:
            if name == STATE:
                reason = str(error)
                self._apply(lambda now_s: self.vehicle.unreadable(reason, now_s))
            if name not in self._refused:
                self._refused.add(name)
                self._log.warning("message_refused", topic=name, error=str(error))

    def _tell_place(self, place: VehiclePlace | None) -> None:
        if place is None or not place.is_localized or self._background is None:
            return
        if place.map_id in ("", self._file.layout.map_id):
            try:
                self._background.report_position(place.x, place.y, place.theta)
            except ValueError as error:
                raise MessageError(str(error)) from None

    # -- what follows --------------------------------------------------------------------------

    async def _tick(self) -> None:
        while True:
            self._apply(self.vehicle.tick)
            await anyio.sleep(TICK_S)

    async def _end_start_up(self) -> None:
        await anyio.sleep(START_UP_S)
        self._is_starting = False

    def _apply(self, step: Callable[[float], list[Effect]]) -> None:
        """Let the vehicle take one step, and carry out the resulting effects."""
        now_s = time.monotonic()
        for effect in step(now_s):
            match effect:
                case Send():
                    if effect.topic == ORDER:
                        self._claim(effect.body)
                    self._outbox.append(effect)
                    self._log.info("sent", topic=effect.topic, **_named(effect.body))
                case Ended():
                    self._end = effect
                case OrderProgress(fraction):
                    if self._job is not None:
                        self._job.report_progress(fraction)
        self._release(now_s)
        self._tell_faults()
        self._news.tell()

    def _claim(self, order: Message) -> None:
        """Announce what an order is for before it is sent."""
        mine = self._adapters.mine
        if self._work is None or (mine is not None and mine.order_id == order["orderId"]):
            return
        ids = tuple(action["actionId"] for node in order["nodes"] for action in node["actions"])
        mine = self._adapters.mine = VehicleClaim(self._work, order["orderId"], ids)
        self._outbox.append(Send(ADAPTER, {"adapter": "works", "claim": mine.said()}))

    def _release(self, now_s: float) -> None:
        """Announce that the vehicle no longer works on the order, once it cannot run any more.

        Also announced when the vehicle is out of reach, since its work is then unknown, or HOLD_S
        after it should have stopped.
        """
        mine, vehicle = self._adapters.mine, self.vehicle
        if mine is None or vehicle.order_id == mine.order_id:
            return
        if mine.since_s is None:
            mine.since_s = now_s
            self._outbox.append(Send(ADAPTER, {"adapter": "stopping"}))
        is_over = vehicle.is_clear or vehicle.is_out_of_reach(now_s)
        if is_over or now_s - mine.since_s >= HOLD_S:
            self._adapters.mine = None
            done = vehicle.has_done(mine.work)
            self._outbox.append(Send(ADAPTER, {"adapter": "stopped", "done": done}))

    def _tell_faults(self) -> None:
        """Report capabilities that this robot has lost or regained."""
        if self._background is None:
            return
        self._is_starting &= not self.vehicle.is_reachable
        fault = self.vehicle.fault(time.monotonic())
        if fault == NO_BROKER:
            fault += self._broker_error
        found = {ALL: (fault, self._is_starting)} if fault else self._prevented()
        if not fault:
            held = self._adapters.told()
            found |= {n: (why, True) for n, why in held.items() if self._background.can(n)}
        if self._lost.tell(self._background, dict(sorted(found.items()))):
            self._log.warning("capabilities", lost={name: why for name, (why, _) in found.items()})

    def _prevented(self) -> dict[str, tuple[str, bool]]:
        """Return the local tasks that the vehicle's errors prevent, according to the file."""
        errors = self.vehicle.state.errors if self.vehicle.state is not None else ()
        found = (
            (name, error) for error in errors for name in self._file.errors.get(error.type, ())
        )
        can = self._background.can if self._background is not None else bool
        return {n: (f"the vehicle has an error: {error}", False) for n, error in found if can(n)}


def _named(body: Message) -> dict[str, Any]:
    """Return the part of a message that is logged."""
    if "orderId" in body:
        return {"order": body["orderId"], "nodes": [node["nodeId"] for node in body["nodes"]]}
    actions = body["actions"] if "actions" in body else body["instantActions"]
    return {"actions": [action["actionType"] for action in actions]}
