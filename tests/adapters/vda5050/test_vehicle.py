"""The order of one vehicle, by example."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.adapters.vda5050.messages import Link
from mrbt_mesh.adapters.vda5050.vehicle import (
    ACCEPT_S,
    AGAIN_S,
    BROKER_S,
    FORGOTTEN_S,
    HOLD_S,
    LATE_S,
    MANY_INSTANT_ACTIONS,
    NO_PROGRESS_S,
    OBEY_S,
    PAUSED_S,
    SILENT_S,
    Ended,
)
from tests.support.vda5050.world import PICK, TO_A, TO_C, World, stop


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


# -- what says that a vehicle does not go on ------------------------------------------------------


def test_a_paused_vehicle_loses_its_capabilities_after_some_seconds() -> None:
    world = World().driving()
    for _ in range(int(PAUSED_S)):
        world.hear(paused=True)
        assert world.fault() == ""
        world.after(1.0)
    assert world.fault() == "the vehicle is paused"
    world.hear(paused=False)
    assert world.fault() == ""
    world.hear(paused=True)
    assert world.fault() == ""


REQUEST = {"requestId": "z1", "requestStatus": "REQUESTED"}


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({}, ""),
        ({"driving": True}, ""),
        ({"safetyState": {"eStop": "NONE", "fieldViolation": True}}, "its protective field is"),
        ({"zoneRequests": [REQUEST]}, "it waits for an answer to zone request z1, and gets none"),
        ({"edgeRequests": [REQUEST]}, "it waits for an answer to edge request z1"),
        ({"newBaseRequest": True}, "it asks for more of its base"),
        ({"action": "PAUSED"}, "its action pick is paused"),
    ],
)
def test_an_order_that_stands_still_fails_with_what_the_vehicle_says(
    changes: dict[str, Any], why: str
) -> None:
    world = World().driving()
    if status := changes.pop("action", ""):
        world.agv.statuses = dict.fromkeys(world.agv.statuses, status)
    for _ in range(int(NO_PROGRESS_S / 10)):
        assert world.ended == []
        world.hear(**{"driving": False} | changes)
        world.after(10.0)
    (end,) = world.ended
    assert end.reason.startswith(f"the order has made no progress for {NO_PROGRESS_S:g} s")
    assert why in end.reason
    assert world.fault() == ""
    world.after(1.0)
    assert world.topics()[-1] == "cancelOrder"


@pytest.mark.parametrize(
    "changes",
    [
        {"agvPosition": None, "driving": True},
        {"action": "RUNNING"},
        {"action": "INITIALIZING"},
    ],
)
def test_an_order_that_goes_on_may_take_long(changes: dict[str, Any]) -> None:
    world = World().driving()
    if status := changes.pop("action", ""):
        world.agv.statuses = dict.fromkeys(world.agv.statuses, status)
    for _ in range(int(3 * NO_PROGRESS_S / 10)):
        world.hear(**changes)
        world.after(10.0)
    assert world.ended == []
    x = 0.0
    world = World().driving()
    for _ in range(int(3 * NO_PROGRESS_S / 10)):
        world.hear(agvPosition={"x": (x := x + 0.3), "y": 0.0, "mapId": "hall"} | {"theta": 0})
        world.after(10.0)
    assert world.ended == []


@pytest.mark.parametrize("where", ["actionStates", "instantActionStates"])
@pytest.mark.parametrize("dialect", ["2.0", "3.0"])
def test_the_next_order_waits_for_the_end_of_the_cancellation(where: str, dialect: str) -> None:
    """Vehicles may empty their order at once, and report the cancellation until they stand."""
    world = World(dialect=dialect).driving()
    world.take(world.vehicle.cancel(world.now_s))
    (cancel,) = world.sent
    action_id = cancel.body["actions"][0]["actionId"]
    world.start(TO_A)
    world.deliver()
    world.agv.statuses.pop(action_id)
    stopping = [{"actionId": action_id, "actionType": "cancelOrder", "actionStatus": "RUNNING"}]
    for _ in range(8):
        world.hear(**{where: stopping, "driving": True})
        world.after(1.0)
        assert world.sent == []
        assert not world.vehicle.is_clear
    stopping[0]["actionStatus"] = "FINISHED"
    world.hear(**{where: stopping, "driving": True})
    assert world.sent == []
    world.hear(**{where: stopping, "driving": False})
    assert world.topics() == ["order"]


def test_a_vehicle_waits_for_the_cancellation_of_another_adapter() -> None:
    """The one that its robot's last will caused: it may not have ended when the robot is back."""
    world = World()
    stopping = {"actionId": "x", "actionType": "cancelOrder", "actionStatus": "RUNNING"}
    world.take(world.vehicle.linked(world.now_s))
    world.start()
    world.sent.clear()
    world.hear(actionStates=[stopping])
    world.after(1.0)
    assert world.sent == []
    world.after(OBEY_S)
    world.hear(actionStates=[stopping])
    assert "does not stop" in world.fault()
    world.hear(actionStates=[stopping | {"actionStatus": "FINISHED"}])
    assert world.topics() == ["order"]
    assert world.fault() == ""


@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize("order_id", ["", None])
def test_a_vehicle_that_forgets_its_order_at_the_goal_does_not_get_it_again(
    heard: bool, order_id: str | None
) -> None:
    world = World().online().start()
    world.deliver()
    world.agv.step()
    if heard:
        world.hear()
    for _ in range(2):
        world.agv.step()
    for _ in range(14):
        world.after(1.0)
        world.hear(orderId=order_id)
    assert world.ended == [Ended(True)]
    assert "order" not in world.topics()
    assert len(world.agv.begun) == 1


@pytest.mark.parametrize("last", ["never", "WAITING", "INITIALIZING", "RUNNING", "PAUSED"])
@pytest.mark.parametrize("at", ["A", "C"])
def test_an_order_that_is_forgotten_at_its_goal_is_done_only_if_all_of_it_was_seen_done(
    last: str, at: str
) -> None:
    """Whether the vehicle drove there, or was there already."""
    world = World().online().start(TO_C if at == "C" else (stop("A", PICK),))
    world.deliver()
    (action_id,) = world.agv.statuses
    status = {"actionId": action_id, "actionStatus": last}
    world.agv.deliver_to_goal()
    if last != "never":
        world.hear(actionStates=[status])
    for _ in range(3):
        world.hear(orderId="", actionStates=[])
        world.after(1.0)
    if at == "A" and last == "never":
        assert world.ended == []  # it has not taken it in yet, as far as anybody knows
        return
    (end,) = world.ended
    assert not end.success
    assert f"last seen: pick {last}" in end.reason
    assert "order" not in world.topics()


def test_an_order_without_actions_is_done_when_its_goal_was_reached() -> None:
    world = World().online().start((stop("C"),)).deliver_all(3)
    assert world.ended == [Ended(True)]
    world = World().online().start((stop("C"),)).deliver_all(2)
    world.agv.step()
    world.hear(orderId="")
    assert world.ended == [Ended(True)]
    world = World().online().start((stop("C"),)).deliver_all(2)
    world.hear(orderId="", nodeStates=[])
    assert [each.success for each in world.ended] == [False]


def test_who_lists_no_longer_what_is_done_has_done_it() -> None:
    world = World().online().start((*TO_C, *TO_A)).deliver_all(3)
    drop = list(world.agv.statuses)[1]
    world.agv.step()
    world.agv.step()
    world.hear(actionStates=[{"actionId": drop, "actionStatus": "FINISHED"}])
    assert world.ended == [Ended(True)]


def test_who_reports_no_node_has_done_what_is_finished() -> None:
    world = World().driving()
    world.agv.step()
    world.agv.step()
    world.hear(lastNodeId=None, lastNodeSequenceId=None)
    assert world.ended == [Ended(True)]


def test_a_vehicle_that_restarts_after_an_action_does_not_get_its_order_again() -> None:
    world = World().online().start((*TO_C, *TO_A)).deliver_all(4)
    blank = {"orderId": "", "lastNodeId": "", "lastNodeSequenceId": 0, "actionStates": []}
    for _ in range(14):
        world.after(1.0)
        world.hear(**blank, nodeStates=[], driving=False)
    (end,) = world.ended
    assert end.reason == "the vehicle has dropped the order; last seen: pick FINISHED, drop WAITING"
    assert "order" not in world.topics()


def test_an_order_that_was_stopped_after_an_action_is_not_begun_again() -> None:
    world = World().online().start((*TO_C, *TO_A)).deliver_all(4)
    world.take(world.vehicle.unlinked(world.now_s))
    world.agv.take("instantActions", {"actions": [{"actionId": "w", "actionType": "cancelOrder"}]})
    world.online()
    (end,) = world.ended
    assert "the vehicle's action drop failed" in end.reason
    assert "order" not in world.topics()


@pytest.mark.parametrize("level", ["WARNING", "CRITICAL", "FATAL"])
def test_an_error_about_another_order_ends_nothing(level: str) -> None:
    error = {"errorType": "orderError", "errorLevel": level}
    error["errorReferences"] = [{"referenceKey": "orderId", "referenceValue": "last-week"}]  # type: ignore[assignment]
    world = World().online()
    world.hear(errors=[error])
    world.start().deliver()
    for _ in range(3):
        world.agv.step()
        world.hear(errors=[error])
    assert world.ended == [Ended(True)]


def test_a_refusal_without_references_is_told_in_the_vehicles_words() -> None:
    old = {"errorType": "orderError", "errorLevel": "WARNING", "errorDescription": "last week"}
    new = {"errorType": "validationError", "errorLevel": "WARNING", "errorDescription": "no floor"}
    odd = {"errorType": "grumble", "errorLevel": "WARNING", "errorDescription": "not today"}
    world = World().online()
    world.hear(errors=[old])
    world.start()
    world.hear(errors=[old, odd])
    assert world.ended == []
    world.hear(errors=[old, odd, new])
    assert world.ended == [Ended(False, "the vehicle refused the order: validationError: no floor")]
    world = World().online()
    world.hear(errors=[old])
    world.start()
    world.hear(errors=[old, odd])
    world.after(ACCEPT_S)
    (end,) = world.ended
    assert end.reason == "the vehicle did not take the order in 10 s: grumble: not today"


@pytest.mark.parametrize("link", [Link.OFFLINE, Link.HIBERNATING])
def test_who_has_said_goodbye_has_to_say_that_it_is_back(link: Link) -> None:
    world = World().driving()
    world.take(world.vehicle.connection(link, world.now_s))
    sent = len(world.sent)
    for _ in range(3):
        world.hear()
        world.after(10.0)
        assert str(link) in world.fault()
    assert len(world.sent) == sent
    world.take(world.vehicle.connection(Link.ONLINE, world.now_s))
    world.hear()
    assert world.fault() == ""


def test_a_battery_that_charges_when_it_is_first_heard_was_low() -> None:
    world = World()
    world.take(world.vehicle.linked(world.now_s))
    for charge, charging, is_low in ((20, True, True), (29, True, True), (30, True, False)):
        world.hear(batteryState={"batteryCharge": charge, "charging": charging})
        assert bool(world.fault()) is is_low
    world = World()
    world.take(world.vehicle.linked(world.now_s))
    world.hear(batteryState={"batteryCharge": 20, "charging": False})
    assert world.fault() == ""


def test_a_vehicle_of_3_0_is_told_to_clear_its_instant_actions() -> None:
    world = World(dialect="3.0").online()
    world.sent.clear()
    for count in (MANY_INSTANT_ACTIONS - 1, MANY_INSTANT_ACTIONS, MANY_INSTANT_ACTIONS):
        ended = [{"actionId": str(n), "actionStatus": "FINISHED"} for n in range(count)]
        world.hear(instantActionStates=ended)
    assert world.topics() == ["clearInstantActions"]
    old = World().online()
    old.sent.clear()
    old.hear(instantActionStates=ended)
    assert old.sent == []


# -- what counts until the vehicle takes it back ---------------------------------------------------


def error(kind: str, level: str | None, order_id: str) -> dict[str, Any]:
    references = [{"referenceKey": "orderId", "referenceValue": order_id}]
    return {"errorType": kind, "errorLevel": level, "errorReferences": references}


def test_a_fatal_error_counts_until_it_is_taken_back_also_when_its_order_has_ended() -> None:
    world = World().driving()
    fatal = error("motorError", "FATAL", (world.agv.order or {})["orderId"])
    world.hear(errors=[fatal])
    assert "fatal error: motorError" in world.fault()
    world.take(world.vehicle.cancel(world.now_s))
    world.deliver()
    for _ in range(5):
        world.hear(errors=[fatal])
        world.after(1.0)
        assert "fatal error: motorError" in world.fault()
    world.sent.clear()
    world.start(TO_A)
    assert world.sent == []
    world.hear(errors=[])
    assert (world.fault(), world.topics()) == ("", ["order"])


def test_an_order_that_was_refused_with_a_fatal_error_does_not_stop_the_next_one() -> None:
    world = World().online().start()
    world.hear(errors=[error("validationError", "FATAL", world.sent[-1].body["orderId"])])
    assert "refused the order" in world.ended[0].reason
    world.hear(errors=[error("validationError", "FATAL", world.sent[-1].body["orderId"])])
    world.after(OBEY_S)
    assert world.fault() == ""


def test_an_error_without_a_level_is_a_warning() -> None:
    world = World().driving()
    world.hear(errors=[error("odd", None, "x")])
    assert (world.fault(), world.ended) == ("", [])


@pytest.mark.parametrize("mode", ["MANUAL", "SERVICE", "INTERVENED"])
def test_an_order_that_somebody_ends_in_another_mode_has_not_failed(mode: str) -> None:
    world = World().driving()
    failed = [{"actionId": name, "actionStatus": "FAILED"} for name in world.agv.statuses]
    world.hear(operatingMode=mode, actionStates=failed, nodeStates=[])
    world.hear(operatingMode=mode, orderId="", actionStates=[], nodeStates=[])
    assert world.ended == []
    assert world.fault() == f"the vehicle's operating mode is {mode}"


# -- messages that come late -----------------------------------------------------------------------


def at(number: int, second: float) -> dict[str, Any]:
    return {"headerId": number, "timestamp": f"2026-11-29T10:00:{second:06.3f}Z"}


def test_a_state_that_was_overtaken_says_nothing() -> None:
    world = World().driving()
    world.hear(**at(7, 10))
    world.hear(**at(5, 6), orderId="the-one-before", nodeStates=[], actionStates=[])
    assert world.ended == []
    # A restart counts anew, a clock may be set back.
    world.hear(**at(0, 11), operatingMode="MANUAL")
    assert "MANUAL" in world.fault()
    world.hear(**at(1, 2))
    assert world.fault() == ""


def test_a_vehicle_that_counts_anew_with_an_older_clock_is_believed_in_time() -> None:
    world = World().driving()
    world.hear(**at(7, 10))
    world.hear(**at(0, 1), operatingMode="MANUAL")
    assert world.fault() == ""
    world.after(LATE_S)
    world.hear(**at(1, 2), operatingMode="MANUAL")
    assert "MANUAL" in world.fault()
    world = World().driving()
    world.hear(**at(7, 10))
    world.take(world.vehicle.connection(Link.BROKEN, world.now_s))
    world.take(world.vehicle.connection(Link.ONLINE, world.now_s))
    world.hear(**at(0, 1), operatingMode="MANUAL")
    assert "MANUAL" in world.fault()


@pytest.mark.parametrize("kind", ["SAME_ORDER_UPDATE_ID", "orderUpdateError"])
def test_the_answer_to_an_order_that_was_sent_again_is_no_refusal(kind: str) -> None:
    world = World().online().start()
    order = world.sent[-1]
    world.after(AGAIN_S)
    known = error(kind, "WARNING", order.body["orderId"])
    world.hear(errors=[known])
    assert world.ended == []
    world.agv.take("order", order.body)
    for _ in range(3):
        world.agv.step()
        world.hear(errors=[known])
    assert world.ended == [Ended(True)]


# -- what a vehicle has done alone -----------------------------------------------------------------


@pytest.mark.parametrize("how", ["link", "vehicle", "cancelled"])
def test_an_order_that_a_vehicle_has_done_alone_is_done(how: str) -> None:
    world = World().online()
    world.take(world.vehicle.start(TO_C, world.now_s, "work"))
    world.deliver_all(1)
    if how == "link":
        world.take(world.vehicle.unlinked(world.now_s))
    elif how == "vehicle":
        world.take(world.vehicle.connection(Link.BROKEN, world.now_s))
    world.take(world.vehicle.cancel(world.now_s))
    world.sent.clear()
    world.agv.step()
    world.agv.step()
    world.after(12.0)
    world.sent.clear()
    world.online()
    world.take(world.vehicle.start(TO_C, world.now_s, "work"))
    world.deliver()
    world.hear()
    world.after(1.0)
    world.hear()
    assert world.ended == [Ended(True)]
    assert len(world.agv.begun) == 1
    # The next attempt is another work.
    world.take(world.vehicle.start(TO_C, world.now_s, "work, again"))
    world.deliver()
    assert len(world.agv.begun) == 2


def test_what_a_vehicle_has_not_done_to_its_end_is_begun_again() -> None:
    world = World().online()
    world.take(world.vehicle.start(TO_C, world.now_s, "work"))
    world.deliver_all(1)
    world.take(world.vehicle.cancel(world.now_s))
    world.deliver()
    world.hear()
    world.take(world.vehicle.start(TO_C, world.now_s, "work"))
    world.deliver()
    assert (world.ended, len(world.agv.begun)) == ([], 2)


# -- standstills -----------------------------------------------------------------------------------


def test_a_vehicle_that_keeps_the_name_of_its_order_alone_has_forgotten_it() -> None:
    world = World().driving()
    for _ in range(int(FORGOTTEN_S) + 1):
        world.hear(nodeStates=[], edgeStates=[], actionStates=[])
        world.after(1.0)
    (end,) = world.ended
    assert "has forgotten what it is; last seen: pick WAITING" in end.reason


@pytest.mark.parametrize("says", [{}, {"orderId": ""}])
@pytest.mark.parametrize("answers", [True, False])
def test_an_order_that_was_lost_from_sight_is_cancelled_and_waited_for(
    says: dict[str, str], answers: bool
) -> None:
    """The vehicle may go on with it: nobody else gets the work before it has answered."""
    world = World().driving()
    listed = {"nodeStates": [], "edgeStates": [], "actionStates": []}
    nothing: dict[str, Any] = {**listed, "driving": False, **says}
    while not world.ended:
        world.hear(**nothing)
        world.after(1.0)
    world.hear(**nothing)
    assert "cancelOrder" in world.topics()
    for _ in range(int(HOLD_S) - 5):
        assert not world.vehicle.is_clear
        world.hear(**nothing)
        world.after(1.0)
    if answers:
        world.deliver()
        world.agv.step()
        world.hear(nodeStates=[], edgeStates=[], **says)
    else:
        for _ in range(6):
            world.after(1.0)
            world.hear(**nothing)
    assert world.vehicle.is_clear


def test_a_silence_and_an_action_that_does_not_begin_are_named_when_an_order_stands_still() -> None:
    world = World().driving()
    world.agv.node = "C"
    for _ in range(int(NO_PROGRESS_S / 10)):
        world.hear(nodeStates=[])
        world.after(10.0)
    world.hear(nodeStates=[])
    assert "its action pick has not begun, at C" in world.ended[0].reason
    vehicle = World().driving()
    vehicle.vehicle._no_progress_s = 20.0
    vehicle.after(20.0)
    assert "it has said nothing for 20 s" in vehicle.ended[0].reason
