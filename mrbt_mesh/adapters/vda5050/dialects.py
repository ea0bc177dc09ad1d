"""Wire differences between the versions of VDA 5050: topics, headers, field names.

Pure functions. Sources: the standard's texts and JSON schemas 1.1.0, 2.0.0, 2.1.0, 3.0.0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, TypeAlias

Message: TypeAlias = dict[str, Any]

ORDER, INSTANT_ACTIONS = "order", "instantActions"
CANCEL = "cancelOrder"
STATE, CONNECTION, VISUALIZATION = "state", "connection", "visualization"


@dataclass(frozen=True)
class Dialect:
    """One version of the standard.

    `instant_actions` are the keys under which instant actions are sent, `deviation` the keys of the
    distance by which a vehicle may miss a node. Where a version's text and its published schemas
    differ, vehicles follow either, so both keys are sent: `actions` and `instantActions`, and
    `actionType` and `actionName` of instant actions in 2.0.0, `allowedDeviationXy` and
    `allowedDeviationXY` in 2.1.0. `keeps_instant_actions`: vehicles list finished instant actions
    until they are told to clear them.
    """

    name: str
    version: str
    instant_actions: tuple[str, ...]
    names_instant_actions: bool = False
    deviation: tuple[str, ...] = ("allowedDeviationXy",)
    is_deviation_elliptic: bool = False
    edges_name_nodes: bool = True
    speed_limit: str = "maxSpeed"
    keeps_instant_actions: bool = False

    @property
    def major(self) -> str:
        """The version as used in topics, e.g. `v2`."""
        return f"v{self.version.partition('.')[0]}"


DIALECTS: Mapping[str, Dialect] = {
    dialect.name: dialect
    for dialect in (
        Dialect("1.1", "1.1.0", ("instantActions",)),
        Dialect("2.0", "2.0.0", ("actions", "instantActions"), names_instant_actions=True),
        Dialect(
            "2.1", "2.1.0", ("actions",), deviation=("allowedDeviationXy", "allowedDeviationXY")
        ),
        Dialect(
            "3.0",
            "3.0.0",
            ("actions",),
            deviation=("allowedDeviationXY",),
            is_deviation_elliptic=True,
            edges_name_nodes=False,
            speed_limit="maximumSpeed",
            keeps_instant_actions=True,
        ),
    )
}


@dataclass(frozen=True)
class VehicleAddress:
    """The prefix of a vehicle's topics: interface/vN/manufacturer/serial number/topic."""

    interface: str
    manufacturer: str
    serial_number: str
    dialect: Dialect

    def topic(self, name: str) -> str:
        """Return the topic `order`, `state`, ... of this vehicle."""
        parts = self.interface, self.dialect.major, self.manufacturer, self.serial_number, name
        return "/".join(parts)

    def headed(self, header_id: int, unix_time_s: float, body: Message) -> Message:
        """Return a message with its header."""
        return {
            "headerId": header_id,
            "timestamp": timestamp(unix_time_s),
            "version": self.dialect.version,
            "manufacturer": self.manufacturer,
            "serialNumber": self.serial_number,
            **body,
        }


def timestamp(unix_time_s: float) -> str:
    """Format a time in ISO 8601, in UTC with milliseconds, as the standard requires."""
    text = datetime.fromtimestamp(unix_time_s, UTC).isoformat(timespec="milliseconds")
    return text.replace("+00:00", "Z")


@dataclass(frozen=True)
class Action:
    """An action of a vehicle at a node. `blocking` is NONE, SOFT or HARD."""

    action_id: str
    type: str
    parameters: Mapping[str, Any]
    blocking: str = "HARD"

    def encoded(self) -> Message:
        """Return the action as in messages of all versions."""
        result: Message = {
            "actionId": self.action_id,
            "actionType": self.type,
            "blockingType": self.blocking,
        }
        if self.parameters:
            result["actionParameters"] = [
                {"key": key, "value": value} for key, value in self.parameters.items()
            ]
        return result


@dataclass(frozen=True)
class OrderNode:
    """A node of an order; `x` and `y` in metres, `theta` in radians.

    `deviation_m`: how far from the node the vehicle may be; 0: the vehicle's own tolerance.
    """

    name: str
    x: float
    y: float
    theta: float | None = None
    deviation_m: float = 0.0
    actions: tuple[Action, ...] = ()


@dataclass(frozen=True)
class VehicleOrder:
    """A complete order: released at once, driven from the first node to the last."""

    order_id: str
    map_id: str
    nodes: tuple[OrderNode, ...]
    speed_limits: tuple[float | None, ...]

    @property
    def last_sequence_id(self) -> int:
        """The sequence id of the last node. Nodes have even ids, edges odd ones."""
        return 2 * (len(self.nodes) - 1)

    @property
    def action_ids(self) -> tuple[str, ...]:
        """The ids of all actions of the order, in order."""
        return tuple(action.action_id for node in self.nodes for action in node.actions)


def order_message(order: VehicleOrder, dialect: Dialect) -> Message:
    """Return the body of an order message, without its header."""
    nodes = [
        {
            "nodeId": node.name,
            "sequenceId": 2 * index,
            "released": True,
            "nodePosition": _position(node, order.map_id, dialect),
            "actions": [action.encoded() for action in node.actions],
        }
        for index, node in enumerate(order.nodes)
    ]
    edges = [_edge(order, index, dialect) for index in range(len(order.nodes) - 1)]
    return {"orderId": order.order_id, "orderUpdateId": 0, "nodes": nodes, "edges": edges}


def _position(node: OrderNode, map_id: str, dialect: Dialect) -> Message:
    result: Message = {"x": node.x, "y": node.y, "mapId": map_id}
    if node.theta is not None:
        result["theta"] = math.remainder(node.theta, math.tau)
    if node.deviation_m > 0:
        circle = {"a": node.deviation_m, "b": node.deviation_m, "theta": 0.0}
        allowed = circle if dialect.is_deviation_elliptic else node.deviation_m
        result |= dict.fromkeys(dialect.deviation, allowed)
    return result


def _edge(order: VehicleOrder, index: int, dialect: Dialect) -> Message:
    start, end = order.nodes[index].name, order.nodes[index + 1].name
    edge: Message = {
        "edgeId": f"{start}-{end}",
        "sequenceId": 2 * index + 1,
        "released": True,
        "actions": [],
    }
    if dialect.edges_name_nodes:
        edge |= {"startNodeId": start, "endNodeId": end}
    limit = order.speed_limits[index]
    if limit is not None:
        edge[dialect.speed_limit] = limit
    return edge


def instant_message(actions: Sequence[Action], dialect: Dialect) -> Message:
    """Return the body of an instant-actions message, without its header."""
    encoded = [action.encoded() for action in actions]
    if dialect.names_instant_actions:
        encoded = [each | {"actionName": each["actionType"]} for each in encoded]
    return dict.fromkeys(dialect.instant_actions, encoded)


def cancel_order(action_id: str) -> Action:
    """Return an action that stops the running order, whichever it is."""
    return Action(action_id, CANCEL, {}, "NONE")


def state_request(action_id: str) -> Action:
    """Return an action that requests the state; vehicles send it only on changes and every 30 s."""
    return Action(action_id, "stateRequest", {}, "NONE")


def clear_instant_actions(action_id: str) -> Action:
    """Return an action that clears the list of ended instant actions; only from 3.0 on."""
    return Action(action_id, "clearInstantActions", {}, "NONE")
