"""The order of one vehicle: by example, and against a model vehicle with messages that get lost."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.vda5050.dialects import DIALECTS
from mrbt_mesh.adapters.vda5050.layout import ActionTemplate, Layout, LayoutNode, StopTemplate
from mrbt_mesh.adapters.vda5050.messages import Link
from mrbt_mesh.adapters.vda5050.vehicle import (
    ACCEPT_S,
    AGAIN_S,
    BROKER_S,
    OBEY_S,
    SILENT_S,
    Battery,
    Effect,
    Ended,
    Progress,
    Send,
    Vehicle,
)
from tests.support.vda5050.model_agv import ModelAgv

LAYOUT = Layout(
    "hall",
    {name: LayoutNode(4.0 * index, 0.0) for index, name in enumerate("ABCD")},
    {"A": {"B": None}, "B": {"A": None, "C": 1.5}, "C": {"B": None, "D": None}, "D": {"C": None}},
)
TO_C = (StopTemplate("C", (ActionTemplate("pick", {"duration": 1}, "HARD"),)),)
TO_A = (StopTemplate("A", (ActionTemplate("drop", {}, "HARD"),)),)


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
                case Progress(fraction):
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

    def fault(self) -> str:
        return self.vehicle.fault(self.now_s)


def test_an_order_is_driven_to_its_end() -> None:
    world = World().driving()
    assert [node["nodeId"] for node in (world.agv.order or {})["nodes"]] == ["A", "B", "C"]
    assert world.progress == [pytest.approx(0.25)]
    for _ in range(2):
        world.agv.step()
        world.hear()
    assert world.ended == [Ended(True)]
    world.after(1.0)
    assert world.vehicle.is_clear
    assert world.sent == []


def test_before_the_first_word_of_a_vehicle_nothing_can_be_done() -> None:
    world = World()
    assert world.fault() == "no connection to the broker"
    world.take(world.vehicle.linked(world.now_s))
    assert "connection topic: nothing" in world.fault()
    world.take(world.vehicle.connection(Link.ONLINE, world.now_s))
    assert world.fault() == "the vehicle has not said its state"
    assert world.topics() == ["stateRequest"]
    world.hear()
    assert world.fault() == ""


def test_a_retained_broken_connection_at_the_start_is_no_capability() -> None:
    world = World()
    world.take(world.vehicle.linked(world.now_s))
    world.take(world.vehicle.connection(Link.BROKEN, world.now_s))
    assert "CONNECTIONBROKEN" in world.fault()
    world.start()
    world.after(1.0)
    assert world.sent == []
    assert world.ended == []


def test_an_order_that_is_lost_is_sent_again_the_same() -> None:
    world = World().online()
    world.sent.clear()
    world.start()
    first = world.sent.pop()
    world.after(AGAIN_S)
    (again,) = world.sent
    assert again == first
    world.deliver()
    world.deliver()
    assert world.agv.begun == [first.body["orderId"]]


def test_an_order_that_nobody_takes_in_fails_in_time() -> None:
    world = World().online().start()
    world.after(ACCEPT_S)
    assert [each.success for each in world.ended] == [False]
    assert "did not take the order" in world.ended[0].reason


def test_a_refused_order_fails_with_the_vehicles_words() -> None:
    world = World().online()
    world.agv.refuses = True
    world.start().deliver()
    world.hear()
    assert world.ended == [Ended(False, "the vehicle refused the order: orderError")]
    world.after(0.5)
    assert world.vehicle.is_clear


def test_the_order_of_a_cancelled_task_is_cancelled_at_the_vehicle() -> None:
    world = World().driving()
    world.take(world.vehicle.cancel(world.now_s))
    assert world.topics() == ["cancelOrder"]
    assert not world.vehicle.is_clear
    world.deliver()
    world.hear()
    assert world.vehicle.is_clear
    assert world.ended == []
    assert not world.agv.is_active


def test_a_cancellation_that_is_lost_is_sent_again() -> None:
    world = World().driving()
    world.take(world.vehicle.cancel(world.now_s))
    world.sent.clear()
    world.after(AGAIN_S / 2)
    assert world.sent == []
    world.after(AGAIN_S / 2)
    assert world.topics() == ["cancelOrder"]
    world.after(OBEY_S)
    world.hear()
    assert "does not" in world.fault()
    world.deliver()
    world.hear()
    assert world.fault() == ""


def test_the_next_task_waits_until_the_vehicle_has_stopped() -> None:
    world = World().driving()
    world.take(world.vehicle.cancel(world.now_s))
    world.start(TO_A)
    assert world.topics() == ["cancelOrder"]
    world.deliver()
    world.hear()
    assert world.topics() == ["order"]
    world.deliver()
    world.agv.step()
    world.hear()
    assert world.ended == [Ended(True)]


def test_an_order_of_an_earlier_life_is_cancelled() -> None:
    world = World().driving()
    world.vehicle = world.born("S1-two")
    world.online()
    assert world.topics() == ["stateRequest", "cancelOrder"]
    world.deliver()
    world.hear()
    assert world.vehicle.is_clear
    assert world.fault() == ""


def test_an_order_of_somebody_else_is_left_alone() -> None:
    world = World()
    world.agv.take("order", {"orderId": "theirs", "nodes": [_node("B", 0)]})
    world.online()
    assert "somebody else (theirs)" in world.fault()
    assert world.topics() == ["stateRequest"]
    world.agv.step()
    world.hear()
    assert world.fault() == ""


def _node(name: str, sequence_id: int) -> dict[str, Any]:
    position = {"x": 4.0, "y": 0.0}
    return {"nodeId": name, "sequenceId": sequence_id, "nodePosition": position, "actions": []}


def test_a_vehicle_that_is_gone_loses_its_task_and_stops_when_it_is_back() -> None:
    world = World().driving()
    world.take(world.vehicle.connection(Link.BROKEN, world.now_s))
    assert "CONNECTIONBROKEN" in world.fault()
    # The plan gives the task to another robot.
    world.take(world.vehicle.cancel(world.now_s))
    assert world.sent == []
    world.take(world.vehicle.connection(Link.ONLINE, world.now_s))
    world.hear()
    assert "cancelOrder" in world.topics()
    world.deliver()
    world.hear()
    assert world.vehicle.is_clear
    assert world.agv.done == []


def test_a_short_outage_of_the_broker_is_no_fault_and_the_order_goes_on() -> None:
    world = World().driving()
    world.take(world.vehicle.unlinked(world.now_s))
    world.after(BROKER_S / 2)
    assert world.fault() == ""
    world.agv.step()
    world.take(world.vehicle.linked(world.now_s))
    assert world.fault() == ""
    world.take(world.vehicle.connection(Link.ONLINE, world.now_s))
    world.hear()
    world.agv.step()
    world.hear()
    assert world.ended == [Ended(True)]
    assert len(world.agv.begun) == 1


def test_a_long_outage_of_the_broker_is_a_fault() -> None:
    world = World().driving()
    world.take(world.vehicle.unlinked(world.now_s))
    world.after(BROKER_S)
    assert world.fault() == "no connection to the broker"


def test_an_order_that_the_last_will_stopped_is_begun_again() -> None:
    world = World().driving()
    world.take(world.vehicle.unlinked(world.now_s))
    world.agv.take("instantActions", {"actions": [{"actionId": "w", "actionType": "cancelOrder"}]})
    world.online()
    assert world.ended == []
    assert world.topics()[-1] == "order"
    world.deliver()
    for _ in range(3):
        world.agv.step()
        world.hear()
    assert world.ended == [Ended(True)]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"operatingMode": "MANUAL"}, "operating mode is MANUAL"),
        ({"safetyState": {"eStop": "REMOTE", "fieldViolation": False}}, "emergency stop"),
        ({"batteryState": {"batteryCharge": 14, "charging": False}}, "battery is low (14 %)"),
        ({"errors": [{"errorType": "motor", "errorLevel": "FATAL"}]}, "fatal error: motor"),
        (
            {"agvPosition": {"x": 0, "y": 0, "mapId": "yard", "positionInitialized": True}},
            "on map yard",
        ),
        (
            {"agvPosition": {"x": 0, "y": 0, "mapId": "hall", "positionInitialized": False}},
            "does not know where it is",
        ),
    ],
)
def test_what_a_vehicle_says_against_itself(changes: dict[str, Any], reason: str) -> None:
    world = World().online()
    world.hear(**changes)
    assert reason in world.fault()
    sent = len(world.sent)
    world.start()
    assert len(world.sent) == sent


def test_a_battery_is_low_until_it_has_enough() -> None:
    world = World().online()
    for charge, is_low in ((16, False), (14, True), (20, True), (30, False), (16, False)):
        world.hear(batteryState={"batteryCharge": charge, "charging": False})
        assert bool(world.fault()) is is_low


def test_a_vehicle_that_says_nothing_for_long_is_no_use() -> None:
    world = World().online()
    world.after(SILENT_S)
    assert "no state" in world.fault()
    world.hear()
    assert world.fault() == ""


@pytest.mark.parametrize("status", ["FAILED", "RETRIABLE"])
def test_an_action_that_fails_is_told_with_its_error(status: str) -> None:
    world = World().driving()
    (action_id,) = [name for name in world.agv.statuses if "/" in name]
    world.agv.statuses[action_id] = status
    error = {
        "errorType": "pickError",
        "errorLevel": "WARNING",
        "errorDescription": "no pallet",
        "errorReferences": [{"referenceKey": "actionId", "referenceValue": action_id}],
    }
    world.hear(errors=[error])
    assert world.ended == [Ended(False, "the vehicle's action pick failed: pickError: no pallet")]
    world.after(0.1)
    assert world.topics() == ["cancelOrder"]


def test_a_place_that_the_layout_has_no_way_to_fails_at_once() -> None:
    world = World().online().start((StopTemplate("Z", ()),))
    assert world.ended == [Ended(False, "the layout has no node 'Z'")]


class Story:
    """A world to which anything may happen; each method is one thing that does."""

    def __init__(self) -> None:
        self.world = World().online()
        self.wanted = False
        self.linked = True
        self.there = True
        self.lives = 0

    def deliver(self) -> None:
        if self.linked:
            self.world.deliver()

    def lose(self) -> None:
        self.world.sent.clear()

    def drive(self) -> None:
        self.world.agv.step()

    def hear(self) -> None:
        if self.linked and self.there:
            self.world.hear()

    def wait(self) -> None:
        self.world.after(AGAIN_S)

    def start(self) -> None:
        if not self.wanted:
            self.wanted = True
            self.world.start()

    def cancel(self) -> None:
        if self.wanted:
            self.wanted = False
            self.world.take(self.world.vehicle.cancel(self.world.now_s))

    def cut(self) -> None:
        self.linked = False
        self.world.take(self.world.vehicle.unlinked(self.world.now_s))

    def link(self) -> None:
        if not self.linked:
            self.linked = self.there = True
            self.world.take(self.world.vehicle.linked(self.world.now_s))
            self.world.take(self.world.vehicle.connection(Link.ONLINE, self.world.now_s))

    def die(self) -> None:
        """The robot's process dies, and a new one begins."""
        self.lives += 1
        self.world.sent.clear()
        self.world.vehicle = self.world.born(f"S1-life{self.lives}")
        self.wanted, self.linked = False, False
        self.link()

    def broken(self) -> None:
        if self.linked:
            self.there = False
            self.world.take(self.world.vehicle.connection(Link.BROKEN, self.world.now_s))

    def back(self) -> None:
        if self.linked:
            self.there = True
            self.world.take(self.world.vehicle.connection(Link.ONLINE, self.world.now_s))


THINGS = [name for name in vars(Story) if not name.startswith("_")]


@given(st.lists(st.sampled_from(THINGS), max_size=60))
def test_whatever_gets_lost_no_order_is_driven_for_nobody(things: list[str]) -> None:
    story = Story()
    for thing in things:
        story.world.now_s += 0.1
        before = len(story.world.ended)
        getattr(story, thing)()
        # A job ends once at most, and only one that is wanted.
        assert len(story.world.ended) - before <= story.wanted
        story.wanted = story.wanted and len(story.world.ended) == before
    _settle(story.world, story.wanted, story.linked)


def _settle(world: World, wanted: bool, linked: bool) -> None:
    """From here on nothing is lost: what is wanted ends, and what is not is stopped."""
    if not linked:
        world.take(world.vehicle.linked(world.now_s))
    world.take(world.vehicle.connection(Link.ONLINE, world.now_s))
    before = len(world.ended)
    for _ in range(60):
        world.deliver()
        world.hear()
        world.after(0.5)
        is_wanted = wanted and len(world.ended) == before
        if is_wanted:
            world.agv.step()
    assert len(world.ended) - before == wanted
    assert world.vehicle.is_clear
    assert not world.agv.is_active
    assert world.fault() == ""
