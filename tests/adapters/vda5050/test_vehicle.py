"""The order of one vehicle, by example."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.adapters.vda5050.messages import Link
from mrbt_mesh.adapters.vda5050.vehicle import (
    ACCEPT_S,
    AGAIN_S,
    BROKER_S,
    OBEY_S,
    SILENT_S,
    Ended,
)
from tests.support.vda5050.world import TO_A, World, stop


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
    assert world.fault() == "the vehicle has not sent its state"
    assert world.topics() == ["stateRequest", "stateRequest"]
    world.hear()
    assert world.fault() == ""


def test_who_says_a_state_is_there_whatever_the_connection_topic_says() -> None:
    """Not every vehicle says again that it is online when its broker was started again."""
    world = World()
    world.take(world.vehicle.linked(world.now_s))
    world.hear()
    assert world.fault() == ""
    world.take(world.vehicle.connection(Link.BROKEN, world.now_s))
    assert "CONNECTIONBROKEN" in world.fault()
    world.hear()
    assert world.fault() == ""


def test_a_retained_broken_connection_at_the_start_is_no_capability() -> None:
    world = World()
    world.take(world.vehicle.linked(world.now_s))
    world.take(world.vehicle.connection(Link.BROKEN, world.now_s))
    assert "CONNECTIONBROKEN" in world.fault()
    world.start()
    world.after(1.0)
    assert world.topics() == ["stateRequest"]
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
    assert world.topics() == ["stateRequest", "stateRequest", "cancelOrder"]
    world.deliver()
    world.hear()
    assert world.vehicle.is_clear
    assert world.fault() == ""


def test_an_order_of_somebody_else_is_left_alone() -> None:
    world = World()
    world.agv.take("order", {"orderId": "theirs", "nodes": [_node("B", 0)]})
    world.online()
    assert "foreign order (theirs)" in world.fault()
    assert "cancelOrder" not in world.topics()
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


def test_what_a_broker_has_kept_of_its_end_is_no_fault_until_the_vehicle_says_its_state() -> None:
    world = World().driving()
    world.take(world.vehicle.unlinked(world.now_s))
    world.take(world.vehicle.linked(world.now_s))
    world.take(world.vehicle.connection(Link.BROKEN, world.now_s))
    assert world.fault() == ""
    world.hear()
    assert world.fault() == ""
    world.take(world.vehicle.connection(Link.BROKEN, world.now_s))
    assert "not online" in world.fault()


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
        (
            {"batteryState": {"batteryCharge": 14, "charging": False}},
            "battery is low: below 15 %, until",
        ),
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


@pytest.mark.parametrize("key", ["resultDescription", "actionResult"])  # 1.1 to 2.1, and 3.0
def test_an_action_that_fails_is_told_with_its_result(key: str) -> None:
    world = World().driving()
    (action_id,) = [name for name in world.agv.statuses if "/" in name]
    world.hear(
        actionStates=[{"actionId": action_id, "actionStatus": "FAILED", key: "fork blocked"}]
    )
    assert world.ended == [Ended(False, "the vehicle's action pick failed: fork blocked")]


def test_a_place_that_the_layout_has_no_way_to_fails_at_once() -> None:
    world = World().online().start((stop("Z"),))
    assert world.ended == [Ended(False, "the layout has no node 'Z'")]
