"""A vehicle of VDA 5050 in a few lines, for properties: takes messages as they are sent, and says
its state as the standard has it. Each `step` is one of its order.
"""

from __future__ import annotations

from typing import Any

from mrbt_mesh.adapters.vda5050.messages import VehicleState, read_state


class ModelAgv:
    """One vehicle. `done` are the ids of orders that were driven to their ends."""

    def __init__(self, node: str = "A", x: float = 0.0, y: float = 0.0) -> None:
        self.node, self.x, self.y = node, x, y
        self.order: dict[str, Any] | None = None
        self.left: list[dict[str, Any]] = []
        self.statuses: dict[str, str] = {}
        self.sequence_id = 0
        self.begun: list[str] = []
        self.done: list[str] = []
        self.errors: list[dict[str, Any]] = []
        self.refuses = False

    @property
    def is_active(self) -> bool:
        """Whether it has something to do for its order."""
        return bool(self.left)

    def take(self, topic: str, body: dict[str, Any]) -> None:
        """A message that reached it."""
        if topic == "order":
            self._take_order(body)
            return
        for action in body.get("actions", body.get("instantActions")):
            if action["actionType"] == "cancelOrder":
                self._cancel(action["actionId"])

    def _take_order(self, body: dict[str, Any]) -> None:
        known = self.order is not None and self.order["orderId"] == body["orderId"]
        if known:
            return
        if self.is_active or self.refuses:
            self._error("orderError", "orderId", body["orderId"])
            return
        self.order, self.left = body, list(body["nodes"])
        self.errors = []
        self.statuses = {a["actionId"]: "WAITING" for n in body["nodes"] for a in n["actions"]}
        self.begun.append(body["orderId"])

    def _cancel(self, action_id: str) -> None:
        if not self.is_active:
            self._error("noOrderToCancel", "actionId", action_id)
            return
        self.left = []
        for name, status in self.statuses.items():
            if status == "WAITING":
                self.statuses[name] = "FAILED"
        self.statuses[action_id] = "FINISHED"

    def _error(self, kind: str, key: str, value: str) -> None:
        references = [{"referenceKey": key, "referenceValue": value}]
        self.errors.append(
            {"errorType": kind, "errorLevel": "WARNING", "errorReferences": references}
        )

    def step(self) -> None:
        """Reach the next node and do all that is to be done there."""
        if not self.left or self.order is None:
            return
        node = self.left.pop(0)
        self.node, self.sequence_id = node["nodeId"], node["sequenceId"]
        self.x, self.y = node["nodePosition"]["x"], node["nodePosition"]["y"]
        for action in node["actions"]:
            self.statuses[action["actionId"]] = "FINISHED"
        if not self.left:
            self.done.append(self.order["orderId"])

    def deliver_to_goal(self) -> None:
        """Be at the order's last node, without having done anything there."""
        assert self.order is not None
        node = self.order["nodes"][-1]
        self.left, self.node, self.sequence_id = [], node["nodeId"], node["sequenceId"]

    def message(self, **changes: Any) -> dict[str, Any]:
        """Its state as 2.0 writes it."""
        return {
            "orderId": self.order["orderId"] if self.order else "",
            "orderUpdateId": 0,
            "lastNodeId": self.node,
            "lastNodeSequenceId": self.sequence_id,
            "nodeStates": [
                {"nodeId": n["nodeId"], "sequenceId": n["sequenceId"], "released": True}
                for n in self.left
            ],
            "edgeStates": [],
            "actionStates": [
                {"actionId": name, "actionStatus": status} for name, status in self.statuses.items()
            ],
            "driving": self.is_active,
            "batteryState": {"batteryCharge": 80.0, "charging": False},
            "operatingMode": "AUTOMATIC",
            "errors": list(self.errors),
            "safetyState": {"eStop": "NONE", "fieldViolation": False},
            "agvPosition": {
                "x": self.x,
                "y": self.y,
                "theta": 0.0,
                "mapId": "hall",
                "positionInitialized": True,
            },
        } | changes

    def state(self, **changes: Any) -> VehicleState:
        """Its state, decoded."""
        return read_state(self.message(**changes))
