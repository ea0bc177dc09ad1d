"""The order's state machine with a model vehicle, and what was sent between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.adapters.vda5050.dialects import DIALECTS
from mrbt_mesh.adapters.vda5050.layout import ActionTemplate, Layout, LayoutNode, StopTemplate
from mrbt_mesh.adapters.vda5050.messages import Link
from mrbt_mesh.adapters.vda5050.vehicle import Battery, Effect, Ended, OrderProgress, Send, Vehicle
from tests.support.vda5050.model_agv import ModelAgv

LAYOUT = Layout(
    "hall",
    {name: LayoutNode(4.0 * index, 0.0) for index, name in enumerate("ABCD")},
    {"A": {"B": None}, "B": {"A": None, "C": 1.5}, "C": {"B": None, "D": None}, "D": {"C": None}},
)
PICK = ActionTemplate(type="pick", parameters={"duration": 1})


def stop(at: str, *actions: ActionTemplate) -> StopTemplate:
    return StopTemplate(at=at, actions=actions)


TO_C = (stop("C", PICK),)
TO_A = (stop("A", ActionTemplate(type="drop")),)


@dataclass
class World:
    """The machine under test, a model vehicle, and what was sent between them."""

    agv: ModelAgv = field(default_factory=ModelAgv)
    session: str = "S1-one"
    dialect: str = "2.0"
    now_s: float = 100.0
    sent: list[Send] = field(default_factory=list)
    ended: list[Ended] = field(default_factory=list)
    progress: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.vehicle = self.born(self.session)

    def born(self, session: str) -> Vehicle:
        return Vehicle(session, LAYOUT, DIALECTS[self.dialect], Battery(), self.now_s)

    def online(self) -> World:
        self.take(self.vehicle.linked(self.now_s))
        self.take(self.vehicle.connection(Link.ONLINE, self.now_s))
        self.hear()
        return self

    def take(self, effects: list[Effect]) -> None:
        for effect in effects:
            match effect:
                case Send():
                    self.sent.append(effect)
                case Ended():
                    self.ended.append(effect)
                case OrderProgress(fraction):
                    self.progress.append(fraction)

    def deliver(self) -> None:
        """All that was sent reaches the vehicle."""
        sent, self.sent = self.sent, []
        for each in sent:
            self.agv.take(each.topic, each.body)

    def hear(self, **changes: Any) -> None:
        self.take(self.vehicle.said(self.agv.state(**changes), self.now_s))

    def after(self, seconds: float) -> None:
        self.now_s += seconds
        self.take(self.vehicle.tick(self.now_s))

    def topics(self) -> list[str]:
        return [
            each.topic if each.topic == "order" else each.body["actions"][0]["actionType"]
            for each in self.sent
        ]

    def start(self, stops: tuple[StopTemplate, ...] = TO_C) -> World:
        self.take(self.vehicle.start(stops, self.now_s))
        return self

    def driving(self) -> World:
        """A vehicle that has taken in an order and is under way."""
        self.online().start().deliver()
        self.agv.step()
        self.hear()
        return self

    def deliver_all(self, steps: int) -> World:
        """What was sent reaches the vehicle; it drives to so many nodes and reports each."""
        self.deliver()
        for _ in range(steps):
            self.agv.step()
            self.hear()
        return self

    def fault(self) -> str:
        return self.vehicle.fault(self.now_s)
