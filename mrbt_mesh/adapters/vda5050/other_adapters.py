"""Messages between the adapters of a fleet, so that no two vehicles do the same work.

Each vehicle has an additional topic, `mrbt`. Before an order, its adapter announces there what the
order is for (`VehicleClaim`), and afterwards that the vehicle no longer works on it. An adapter
that gets the same work waits for that. When an adapter has ended (its last will), the remaining
adapters cancel the order of its vehicle and watch the vehicle until it has stopped. Work that the
vehicle completed nevertheless is not repeated.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import time
import uuid
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import anyio

from mrbt_mesh.adapters.vda5050.dialects import (
    INSTANT_ACTIONS,
    STATE,
    VehicleAddress,
    cancel_order,
    instant_message,
    state_request,
)
from mrbt_mesh.adapters.vda5050.layout_file import LayoutFile
from mrbt_mesh.adapters.vda5050.messages import (
    FINISHED,
    MessageError,
    VehicleState,
    decode,
    read_state,
)
from mrbt_mesh.adapters.vda5050.vehicle import AGAIN_S, ENDED, HOLD_S, OBEY_S, OURS, ours_runs

if TYPE_CHECKING:
    import aiomqtt
    from anyio.abc import TaskGroup

ADAPTER = "mrbt"
# A last will counts if the broker lives GRACE_S longer; adapters then act in turn, TURN_S apart.
GRACE_S, TURN_S = 0.3, 0.02
# An adapter that has not returned this long after an outage of the broker counts as ended.
RETURN_S = 5.0
# A wait of this length is reported to the team.
TELL_S = 2.0


def message(kind: str, **more: Any) -> bytes:
    """Encode a message for the topic of an adapter."""
    return json.dumps({"adapter": kind, **more}).encode()


HERE, GONE, STOPPING, STOPPED = (message(kind) for kind in ("here", "gone", "stopping", "stopped"))


@dataclass(frozen=True)
class OrderedWork:
    """The purpose of an order: a ground local task of an activation."""

    activation: str
    local_task: str


@dataclass
class VehicleClaim:
    """A vehicle does this work by this order. `since_s`: since when it should have stopped."""

    work: OrderedWork
    order_id: str
    action_ids: tuple[str, ...]
    since_s: float | None = None

    def said(self) -> Mapping[str, Any]:
        """Return the claim as plain data for messages."""
        return {
            "stopping": self.since_s is not None,
            "activation": self.work.activation,
            "local_task": self.work.local_task,
            "order": self.order_id,
            "actions": self.action_ids,
        }


@dataclass
class _Watch:
    """Watches the vehicle of an adapter that has ended."""

    began_s: float
    claim: VehicleClaim | None
    cancels: set[str] = field(default_factory=set)
    sent_s: float | None = None
    first_sent_s: float | None = None
    # True if the order is cancelled regardless of the vehicle's state: it may be in transit.
    at_once: bool = True
    state: VehicleState | None = None
    heard_s: float = 0.0
    seen: dict[str, str] = field(default_factory=dict)

    def sent(self, action_id: str, now_s: float) -> None:
        self.cancels.add(action_id)
        self.sent_s = now_s
        self.first_sent_s = self.first_sent_s or now_s

    def heard(self, state: VehicleState, now_s: float) -> None:
        self.state, self.heard_s = state, now_s
        self.seen |= state.actions

    @property
    def is_at_it(self) -> bool:
        """True if the vehicle works on one of the adapters' orders, or is still stopping."""
        state, claim = self.state, self.claim
        if state is None or (claim is not None and state.order_id not in ("", claim.order_id)):
            return False
        return bool(state.stops) or ours_runs(state)

    @property
    def has_done_it(self) -> bool:
        """True if all actions of the vehicle's order were seen finished."""
        ids = self.claim.action_ids if self.claim is not None else ()
        return bool(ids) and all(self.seen.get(each) == FINISHED for each in ids)

    def has_stopped(self, now_s: float) -> bool:
        """Return whether the order has stopped and cannot start any more, or the wait is over."""
        state, limit_s = self.state, HOLD_S if self.state is not None else OBEY_S
        if now_s - self.began_s >= limit_s:
            return True
        if state is None or self.is_at_it:
            return False
        if self.first_sent_s is None:
            return not self.at_once
        answered = any(state.status_of(each) in ENDED for each in self.cancels)
        answered |= any(e.is_of("actionId", each) for e in state.errors for each in self.cancels)
        # The vehicle may continue an order that it names even if it lists none of its actions.
        is_mute = self.claim is not None and state.order_id == self.claim.order_id and not self.seen
        return answered or (not is_mute and self.heard_s - self.first_sent_s >= AGAIN_S)


class OtherAdapters:
    """The adapters of the other robots of a fleet, and the work of their vehicles.

    `changed` is called when another adapter's work may have changed.
    """

    def __init__(self, file: LayoutFile, robot: str, changed: Callable[[], None]) -> None:
        self.mine: VehicleClaim | None = None
        self._claims: dict[str, VehicleClaim] = {}
        self._gone: dict[str, _Watch] = {}
        # Work that a vehicle completed although it was cancelled, and until when that counts.
        self._done: dict[OrderedWork, float] = {}
        # Robots with claims that have not announced themselves since the last connection.
        self._unheard: set[str] = set()
        self._changed = changed
        self._address = file.addresses[robot]
        self._others = {name: each for name, each in file.addresses.items() if name != robot}
        self._robots = {each.topic(ADAPTER): name for name, each in self._others.items()}
        self._states = {each.topic(STATE): name for name, each in self._others.items()}
        self._turn_s = TURN_S * sorted(file.vehicles).index(robot)
        self._header_ids = itertools.count()

    async def begin(self, client: aiomqtt.Client) -> None:
        """Subscribe to the other adapters, and announce this one. Raises MqttError."""
        for topic in self._robots:
            await client.subscribe(topic, qos=1)
        claim = self.mine.said() if self.mine is not None else None
        await client.publish(self._address.topic(ADAPTER), message("here", claim=claim), qos=1)

    def unlinked(self) -> None:
        """Called when the connection has ended; all watching ends.

        After a reconnection, the other adapters announce their work again; nothing is known about
        one that does not.
        """
        now_s = anyio.current_time()
        for robot in self._gone:
            if robot in self._claims:
                self._claims[robot].since_s = now_s
        self._gone.clear()
        self._unheard = {*self._claims}

    async def look_for_the_dead(self, group: TaskGroup, client: aiomqtt.Client) -> None:
        """Watch the vehicles of adapters that do not return after an outage."""
        await anyio.sleep(RETURN_S)
        for robot in sorted(self._unheard & self._claims.keys() - self._gone.keys()):
            self._watch(robot, group, client, False)

    # -- what others are at ---------------------------------------------------------------------

    def holder(self, work: OrderedWork, partners: Iterable[str]) -> str:
        """Return the robot whose vehicle must stop before another starts this work, or ""."""
        now_s = anyio.current_time()
        for robot in self._gone:
            if robot not in self._claims:
                return robot  # its work is unknown
        for robot, claim in list(self._claims.items()):
            if claim.since_s is not None and now_s - claim.since_s >= HOLD_S:
                del self._claims[robot]
            elif robot in partners:
                continue
            elif claim.work == work:
                if claim.since_s is None:
                    # It should have stopped: its robot is dead, but this was not noticed here yet.
                    claim.since_s = now_s
                return robot
            elif claim.since_s is not None and claim.work.local_task == work.local_task:
                return robot
        return ""

    def told(self) -> dict[str, str]:
        """Return why local tasks cannot start, by ground local task, if they waited long."""
        now_s, found = anyio.current_time(), {}
        for robot, claim in self._claims.items():
            if claim.since_s is not None and TELL_S <= now_s - claim.since_s < HOLD_S:
                found[claim.work.local_task] = (
                    f"the vehicle of {robot} may still do it, and has not stopped: "
                    f"nobody else begins it within {HOLD_S:g} s"
                )
        return found

    def was_done(self, work: OrderedWork) -> bool:
        """Return whether a vehicle completed this work after it was cancelled; answers once."""
        until_s = self._done.pop(work, None)
        return until_s is not None and anyio.current_time() < until_s

    def hear(
        self, topic: str, payload: bytes | bytearray, group: TaskGroup, client: aiomqtt.Client
    ) -> None:
        """Process a message of another adapter. `group` ends with the client's connection."""
        robot = self._robots.get(topic)
        if robot is None:
            return
        try:
            said = decode(payload)
        except MessageError:
            return
        self._unheard.discard(robot)
        match said.get("adapter"):
            case "gone":
                self._watch(robot, group, client, True)
            case "here":
                self._claimed(robot, said.get("claim"))
                if said.get("claim") is None:
                    self._gone.pop(robot, None)
                    if robot in self._claims:
                        self._watch(robot, group, client, False)
                if self.mine is not None:
                    group.start_soon(self.tell, client, message("works", claim=self.mine.said()))
            case "works":
                self._claimed(robot, said.get("claim"))
            case "stopping" if robot in self._claims:
                self._claims[robot].since_s = anyio.current_time()
            case "cancels" if robot in self._gone:
                self._gone[robot].sent(str(said.get("action")), anyio.current_time())
            case "stopped":
                self._settle(robot, said.get("done") is True)
        self._changed()

    def hear_state(self, topic: str, payload: bytes | bytearray, is_retained: bool) -> bool:
        """Process a state of another robot's vehicle, unless it is retained and so may be old.

        Returns whether the topic is that of another robot's vehicle.
        """
        robot = self._states.get(topic)
        if robot in self._gone and not is_retained:
            with contextlib.suppress(MessageError):
                self._gone[robot].heard(read_state(decode(payload)), anyio.current_time())
        return robot is not None

    def _claimed(self, robot: str, said: Any) -> None:
        if not isinstance(said, dict):
            return
        work = OrderedWork(str(said.get("activation")), str(said.get("local_task")))
        actions = said.get("actions")
        ids = tuple(map(str, actions)) if isinstance(actions, list) else ()
        self._gone.pop(robot, None)
        since_s = anyio.current_time() if said.get("stopping") is True else None
        self._claims[robot] = VehicleClaim(work, str(said.get("order")), ids, since_s)

    def _settle(self, robot: str, was_done: bool) -> None:
        self._gone.pop(robot, None)
        claim = self._claims.pop(robot, None)
        if claim is not None and was_done:
            self._done[claim.work] = anyio.current_time() + HOLD_S
        self._changed()

    # -- the vehicles of adapters that have ended ------------------------------------------------

    def _watch(self, robot: str, group: TaskGroup, client: aiomqtt.Client, at_once: bool) -> None:
        now_s, claim = anyio.current_time(), self._claims.get(robot)
        if claim is not None and claim.since_s is None:
            claim.since_s = now_s
        self._gone[robot] = _Watch(now_s, claim, at_once=at_once)
        group.start_soon(self._stop, client, robot, self._gone[robot])

    async def _stop(self, client: aiomqtt.Client, robot: str, watch: _Watch) -> None:
        """Stop the vehicle of a dead robot.

        Cancel its order, unless another adapter does so, and wait until the vehicle has stopped.
        """
        import aiomqtt

        vehicle = self._others[robot]
        try:
            await anyio.sleep(GRACE_S)
            if self._gone.get(robot) is not watch:
                return
            await client.subscribe(vehicle.topic(STATE), qos=1)
            await anyio.sleep(self._turn_s)
            if not watch.at_once:
                await self._order(client, vehicle, state_request(self._new_id(robot)))
            while self._gone.get(robot) is watch:
                now_s = anyio.current_time()
                if watch.has_stopped(now_s):
                    done = watch.has_done_it
                    await self.tell(client, message("stopped", done=done), vehicle)
                    self._settle(robot, done)
                elif (watch.at_once or watch.is_at_it) and self._is_due(watch, now_s):
                    await self._cancel(client, robot, watch)
                await anyio.sleep(0.05)
            await client.unsubscribe(vehicle.topic(STATE))
        except aiomqtt.MqttError:
            return  # the connection has ended, which the receiving side notices

    def _is_due(self, watch: _Watch, now_s: float) -> bool:
        """Return whether to send a cancellation: none was sent yet, or it may have been lost."""
        if watch.sent_s is None:
            return True
        is_stopping = watch.state is not None and bool(watch.state.stops)
        return now_s - watch.sent_s >= AGAIN_S + self._turn_s and not is_stopping

    async def _cancel(self, client: aiomqtt.Client, robot: str, watch: _Watch) -> None:
        vehicle, action_id = self._others[robot], self._new_id(robot)
        watch.sent(action_id, anyio.current_time())
        await self._order(client, vehicle, cancel_order(action_id))
        await self.tell(client, message("cancels", action=action_id), vehicle)
        await self._order(client, vehicle, state_request(self._new_id(robot)))

    def _new_id(self, robot: str) -> str:
        return f"{OURS}{robot}-gone-{uuid.uuid4().hex[:8]}"

    async def _order(self, client: aiomqtt.Client, vehicle: VehicleAddress, action: Any) -> None:
        body = instant_message([action], vehicle.dialect)
        payload = json.dumps(vehicle.headed(next(self._header_ids), time.time(), body)).encode()
        await client.publish(vehicle.topic(INSTANT_ACTIONS), payload, qos=1)

    async def tell(
        self, client: aiomqtt.Client, payload: bytes, of: VehicleAddress | None = None
    ) -> None:
        """Publish a message on the topic of this adapter, or of another one."""
        import aiomqtt

        with contextlib.suppress(aiomqtt.MqttError):
            await client.publish((of or self._address).topic(ADAPTER), payload, qos=1)
