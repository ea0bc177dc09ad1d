"""Messages between the adapters of a fleet: the vehicle of a dead robot is stopped.

Each vehicle has one more topic, `mrbt`, for three messages: its adapter has started, its adapter
has ended (the last will), and another adapter has stopped the vehicle.
"""

from __future__ import annotations

import itertools
import json
import time
import uuid
from collections.abc import Callable
from typing import TYPE_CHECKING

import anyio

from mrbt_mesh.adapters.vda5050.dialects import INSTANT_ACTIONS, cancel_order, instant_message
from mrbt_mesh.adapters.vda5050.layout_file import LayoutFile
from mrbt_mesh.adapters.vda5050.vehicle import OURS

if TYPE_CHECKING:
    import aiomqtt
    from anyio.abc import TaskGroup

ADAPTER = "mrbt"
HERE, GONE, STOPPED = (
    json.dumps({"adapter": what}).encode() for what in ("here", "gone", "stopped")
)
# The broker must live this long after a last will; then one adapter after the other acts.
GRACE_S, TURN_S = 0.3, 0.02


class OtherAdapters:
    """The adapters of the other robots of a fleet.

    `gone`: the robots whose adapters have ended and whose vehicles have not been stopped yet;
    `changed` is called when it has become smaller.
    """

    def __init__(self, file: LayoutFile, robot: str, changed: Callable[[], None]) -> None:
        self.gone: set[str] = set()
        self._changed = changed
        self._mine = file.addresses[robot]
        self._others = {name: each for name, each in file.addresses.items() if name != robot}
        self._robots = {each.topic(ADAPTER): name for name, each in self._others.items()}
        self._turn_s = TURN_S * sorted(file.vehicles).index(robot)
        self._header_ids = itertools.count()

    async def begin(self, client: aiomqtt.Client) -> None:
        """Listen to the others, and announce this one; raises MqttError."""
        for topic in self._robots:
            await client.subscribe(topic, qos=1)
        await client.publish(self._mine.topic(ADAPTER), HERE, qos=1)

    def hear(
        self, topic: str, payload: bytes | bytearray, group: TaskGroup, client: aiomqtt.Client
    ) -> None:
        """Take in a message of another adapter. `group` ends with the client's connection."""
        robot = self._robots.get(topic)
        if robot is None:
            return
        if payload == GONE:
            self.gone.add(robot)
            group.start_soon(self._stop, client, robot)
        else:
            self._settle(robot)

    def _settle(self, robot: str) -> None:
        self.gone.discard(robot)
        self._changed()

    async def _stop(self, client: aiomqtt.Client, robot: str) -> None:
        """Cancel the order of a vehicle whose robot has died, unless another adapter does so."""
        import aiomqtt

        await anyio.sleep(GRACE_S + self._turn_s)
        if robot not in self.gone:
            return
        vehicle = self._others[robot]
        action = cancel_order(f"{OURS}{robot}-gone-{uuid.uuid4().hex[:8]}")
        body = instant_message([action], vehicle.dialect)
        payload = json.dumps(vehicle.headed(next(self._header_ids), time.time(), body)).encode()
        try:
            await client.publish(vehicle.topic(INSTANT_ACTIONS), payload, qos=1)
            await client.publish(vehicle.topic(ADAPTER), STOPPED, qos=1)
        except aiomqtt.MqttError:
            return  # the broker has ended as well, as the other side of it will notice
        self._settle(robot)
