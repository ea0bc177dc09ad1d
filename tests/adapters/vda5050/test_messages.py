"""Messages of vehicles: the same state in the words of every version, and anything at all."""

from __future__ import annotations

import contextlib
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.vda5050.messages import (
    Link,
    MessageError,
    VehicleError,
    VehiclePlace,
    decode,
    read_link,
    read_place,
    read_state,
)

ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
)
TWO: dict[str, Any] = {
    "orderId": "o1",
    "orderUpdateId": 0,
    "lastNodeId": "A",
    "lastNodeSequenceId": 2,
    "nodeStates": [{"nodeId": "B", "sequenceId": 4, "released": True}],
    "edgeStates": [{"edgeId": "A-B", "sequenceId": 3, "released": True}],
    "actionStates": [{"actionId": "a1", "actionStatus": "RUNNING"}],
    "driving": True,
    "operatingMode": "AUTOMATIC",
    "errors": [
        {
            "errorType": "orderError",
            "errorLevel": "WARNING",
            "errorReferences": [{"referenceKey": "orderId", "referenceValue": "o0"}],
        }
    ],
    "agvPosition": {"x": 1, "y": 2.5, "theta": 0.5, "mapId": "m", "positionInitialized": True},
    "batteryState": {"batteryCharge": 70, "charging": True},
    "safetyState": {"eStop": "AUTOACK", "fieldViolation": False},
}
# The same in 3.0: other names for position, power and emergency stop.
THREE = {
    **{k: v for k, v in TWO.items() if k not in ("agvPosition", "batteryState", "safetyState")},
    "mobileRobotPosition": {"x": 1, "y": 2.5, "theta": 0.5, "mapId": "m", "localized": True},
    "powerSupply": {"stateOfCharge": 70, "charging": True},
    "safetyState": {"activeEmergencyStop": "AUTOACK", "fieldViolation": False},
    "instantActionStates": [],
}


def test_a_state_says_the_same_in_all_versions() -> None:
    state = read_state(TWO)
    assert read_state(THREE) == state
    assert state.place == VehiclePlace(1.0, 2.5, 0.5, "m", True)
    assert (state.nodes_left, state.edges_left, state.last_sequence_id) == (1, 1, 2)
    assert (state.charge_percent, state.is_charging, state.emergency_stop) == (70, True, "AUTOACK")
    assert state.errors == (VehicleError("orderError", "WARNING", "", (("orderId", "o0"),)),)
    assert state.status_of("a1") == "RUNNING"
    assert state.status_of("a2") is None


def test_careless_vehicles_write_null_and_fractions() -> None:
    nulls = dict.fromkeys(("orderId", "lastNodeId", "nodeStates", "edgeStates", "actionStates"))
    state = read_state(TWO | nulls | {"lastNodeSequenceId": 4.0, "errors": None})
    assert (state.order_id, state.last_node, state.last_sequence_id) == ("", "", 4)
    assert (state.nodes_left, state.edges_left, state.actions, state.errors) == (0, 0, {}, ())
    assert read_state(TWO | {"lastNodeSequenceId": None}).last_sequence_id == 0
    for key, value in (
        ("lastNodeSequenceId", 4.5),
        ("lastNodeSequenceId", True),
        ("lastNodeSequenceId", float("inf")),
        ("orderId", 7),
        ("edgeStates", {}),
    ):
        with pytest.raises(MessageError, match=f"{key} is not"):
            read_state(TWO | {key: value})
    for key in ("orderId", "lastNodeId", "lastNodeSequenceId", *list(nulls)[2:]):
        with pytest.raises(MessageError, match=f"{key} is not"):
            read_state({name: value for name, value in TWO.items() if name != key})


def test_what_a_vehicle_waits_for_and_stops() -> None:
    requests = [
        {"requestId": "z1", "requestStatus": "REQUESTED"},
        {"requestId": "z2", "requestStatus": "GRANTED"},
    ]
    stop = {"actionId": "c", "actionType": "cancelOrder", "actionStatus": "RUNNING"}
    state = read_state(
        THREE
        | {"zoneRequests": requests, "edgeRequests": requests[:1], "paused": True}
        | {"instantActionStates": [stop, stop | {"actionId": "d", "actionStatus": "FINISHED"}]}
    )
    assert state.requests == ("zone request z1", "edge request z1")
    assert state.stops == {"c"}
    assert state.is_paused


def test_instant_actions_of_their_own_are_no_part_of_the_order() -> None:
    idle = THREE | {"nodeStates": [], "edgeStates": [], "actionStates": []}
    instant = [{"actionId": "c1", "actionStatus": "RUNNING"}]
    state = read_state(idle | {"instantActionStates": instant})
    assert not state.has_active_order
    assert state.status_of("c1") == "RUNNING"


@pytest.mark.parametrize(
    ("said", "link"),
    [
        ("ONLINE", Link.ONLINE),
        ("OFFLINE", Link.OFFLINE),
        ("CONNECTIONBROKEN", Link.BROKEN),
        ("CONNECTION_BROKEN", Link.BROKEN),
        ("HIBERNATING", Link.HIBERNATING),
    ],
)
def test_the_states_of_a_connection(said: str, link: Link) -> None:
    assert read_link({"connectionState": said}) is link


@pytest.mark.parametrize("key", ["orderId", "lastNodeSequenceId", "nodeStates", "operatingMode"])
def test_what_is_missing_is_named(key: str) -> None:
    with pytest.raises(MessageError, match=key):
        read_state({k: v for k, v in TWO.items() if k != key})


@given(st.binary(max_size=200) | ANYTHING.map(lambda value: json.dumps(value).encode()))
def test_any_bytes_are_decoded_or_refused(payload: bytes) -> None:
    try:
        message = decode(payload)
    except MessageError:
        return
    assert isinstance(message, dict)


@given(st.dictionaries(st.sampled_from(sorted({*TWO, *THREE, "connectionState"})), ANYTHING))
def test_any_message_is_read_or_refused(changes: dict[str, Any]) -> None:
    for message in (TWO | changes, THREE | changes, changes):
        for read in (read_state, read_link, read_place):
            with contextlib.suppress(MessageError):
                read(message)


def test_what_is_too_large_is_refused() -> None:
    with pytest.raises(MessageError, match="larger than"):
        decode(b" " * 1_000_001)
