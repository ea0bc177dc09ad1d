"""Decodes messages of vehicles, of any version, into one form; refuses invalid ones."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from mrbt_mesh.adapters.vda5050.dialects import CANCEL

MAX_MESSAGE_BYTES = 1_000_000
FINISHED, FAILED, RETRIABLE = "FINISHED", "FAILED", "RETRIABLE"
INITIALIZING, RUNNING, PAUSED = "INITIALIZING", "RUNNING", "PAUSED"
# Error levels with which a vehicle cannot continue its order; with FATAL it can execute no order.
STOPPING = frozenset({"FATAL", "CRITICAL"})
FATAL = "FATAL"
# The level of an error that has none.
WARNING = "WARNING"
# Errors by which a vehicle refuses an order: the names in all versions, in lower case without "_".
REFUSALS = frozenset(
    {
        "insufficientmemory",
        "invalidorder",
        "invalidorderaction",
        "mobilerobotnotavailable",
        "norouteerror",
        "noroutetotarget",
        "ordererror",
        "orderupdateerror",
        "otherorderactive",
        "outdatedorderupdate",
        "startnodeoutofrange",
        "unknownmapid",
        "unsupportedparameter",
        "validationerror",
        "validationfailure",
    }
)
# Modes in which a vehicle follows the orders of its fleet control.
FOLLOWING = frozenset({"AUTOMATIC", "SEMIAUTOMATIC"})


class MessageError(Exception):
    """The payload is not a VDA 5050 message; the text is the reason."""


class Link(StrEnum):
    """The state of a vehicle's connection to the broker."""

    UNKNOWN = "UNKNOWN"
    ONLINE = "ONLINE"
    OFFLINE = "OFFLINE"
    BROKEN = "CONNECTIONBROKEN"
    HIBERNATING = "HIBERNATING"


@dataclass(frozen=True)
class VehicleError:
    """An error that a vehicle reports. `references` are (key, value) pairs."""

    type: str
    level: str
    description: str
    references: tuple[tuple[str, str], ...]

    def is_of(self, key: str, value: str) -> bool:
        """Return whether the error refers to this value, e.g. to an order's id."""
        return (key, value) in self.references

    def is_of_another(self, key: str, value: str) -> bool:
        """Return whether the error refers to other values of this key, and not to this one."""
        named = {found for name, found in self.references if name == key}
        return bool(named) and value not in named

    @property
    def kind(self) -> str:
        """The error's type, normalised for all versions: in lower case without `_`."""
        return self.type.replace("_", "").lower()

    @property
    def is_refusal(self) -> bool:
        """True if the vehicle refuses an order by this error."""
        return self.kind in REFUSALS

    def __str__(self) -> str:
        return f"{self.type}: {self.description}" if self.description else self.type


@dataclass(frozen=True)
class VehiclePlace:
    """A vehicle's position on a map in metres, and its heading in radians."""

    x: float
    y: float
    theta: float
    map_id: str
    is_localized: bool


@dataclass(frozen=True)
class VehicleState:
    """A vehicle's state. `charge_percent`: None if it is not reported.

    `nodes_left` and `edges_left` count the rest of its order. `actions` maps ids to statuses,
    `results` ids to descriptions of results, if there are any. `stops`: ids of the cancellations
    that it is carrying out. `requests`: its requests that wait for an answer.
    """

    order_id: str
    last_node: str
    last_sequence_id: int
    nodes_left: int
    edges_left: int
    actions: Mapping[str, str]
    results: Mapping[str, str]
    instant_actions: Mapping[str, str]
    stops: frozenset[str]
    requests: tuple[str, ...]
    errors: tuple[VehicleError, ...]
    mode: str
    is_driving: bool
    is_paused: bool
    wants_base: bool
    emergency_stop: str
    is_field_violated: bool
    charge_percent: float | None
    is_charging: bool
    place: VehiclePlace | None
    # The number and the time (Unix seconds) of the message; None unless it has both.
    header: tuple[int, float] | None = None

    @property
    def has_active_order(self) -> bool:
        """True if the vehicle still has nodes, edges or actions of its order left.

        Up to 2.1, instant actions are listed among the order's actions; `vehicle.py` recognises the
        adapter's by their ids. A cancellation does not count.
        """
        return bool(self.nodes_left or self.edges_left) or any(
            status not in (FINISHED, FAILED) and name not in self.stops
            for name, status in self.actions.items()
        )

    def status_of(self, action_id: str) -> str | None:
        """Return the status of an instant or order action; None if it is not in the state."""
        return self.actions.get(action_id) or self.instant_actions.get(action_id)


def decode(payload: bytes | bytearray) -> Mapping[str, Any]:
    """Decode a JSON message. Raises MessageError."""
    if len(payload) > MAX_MESSAGE_BYTES:
        raise MessageError(f"larger than {MAX_MESSAGE_BYTES} bytes")
    try:
        message = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"not JSON: {error}") from None
    if not isinstance(message, dict):
        raise MessageError("not a JSON object")
    return message


def read_link(message: Mapping[str, Any]) -> Link:
    """Return the connection state; 3.0 writes it with an underscore. Raises MessageError."""
    said = message.get("connectionState")
    text = said.replace("_", "") if isinstance(said, str) else ""
    try:
        return Link(text)
    except ValueError:
        raise MessageError(f"connectionState {said!r:.60} is not known") from None


def read_state(message: Mapping[str, Any]) -> VehicleState:
    """Read a state of any version. Raises MessageError if a required part is missing."""
    safety = _mapping(message, "safetyState", {})
    power = _mapping(message, "powerSupply", None) or _mapping(message, "batteryState", {})
    charge = power.get("stateOfCharge", power.get("batteryCharge"))
    stop = safety.get("activeEmergencyStop", safety.get("eStop", "NONE"))
    actions, instant = _listed(message, "actionStates"), _listed(message, "instantActionStates")
    return VehicleState(
        order_id=_text(message, "orderId"),
        last_node=_text(message, "lastNodeId"),
        last_sequence_id=_whole(message, "lastNodeSequenceId"),
        nodes_left=len(_listed(message, "nodeStates")),
        edges_left=len(_listed(message, "edgeStates")),
        actions=_statuses(actions),
        results=_results(actions),
        instant_actions=_statuses(instant),
        stops=frozenset(_stops([*actions, *instant])),
        requests=tuple(_requests(message)),
        errors=tuple(_error(each) for each in _listed(message, "errors")),
        mode=_required(message, "operatingMode", str),
        is_driving=message.get("driving") is True,
        is_paused=message.get("paused") is True,
        wants_base=message.get("newBaseRequest") is True,
        emergency_stop=stop if isinstance(stop, str) else "",
        is_field_violated=safety.get("fieldViolation") is True,
        charge_percent=_number(charge),
        is_charging=power.get("charging") is True,
        place=read_place(message),
        header=_header(message),
    )


def read_place(message: Mapping[str, Any]) -> VehiclePlace | None:
    """Return a vehicle's position from its state or visualization; None if it has none."""
    said = _mapping(message, "mobileRobotPosition", None) or _mapping(message, "agvPosition", {})
    x, y = _number(said.get("x")), _number(said.get("y"))
    if x is None or y is None:
        return None
    theta, map_id = _number(said.get("theta")) or 0.0, said.get("mapId")
    # In a visualization this field is optional.
    localized = said.get("localized", said.get("positionInitialized", True))
    return VehiclePlace(x, y, theta, map_id if isinstance(map_id, str) else "", localized is True)


def _header(message: Mapping[str, Any]) -> tuple[int, float] | None:
    number, said = message.get("headerId"), message.get("timestamp")
    if not isinstance(number, int) or isinstance(number, bool) or not isinstance(said, str):
        return None
    try:
        moment = datetime.fromisoformat(said)
        return number, moment.replace(tzinfo=moment.tzinfo or UTC).timestamp()
    except (ValueError, OverflowError):
        return None


def _statuses(states: list[Any]) -> dict[str, str]:
    found = {}
    for each in states:
        if not isinstance(each, dict):
            raise MessageError("an action state is not an object")
        found[_required(each, "actionId", str)] = _required(each, "actionStatus", str)
    return found


def _stops(states: list[Any]) -> Iterator[str]:
    """Yield the ids of actions that cancel an order and have not ended."""
    for each in states:
        if each.get("actionType") == CANCEL and each["actionStatus"] not in (FINISHED, FAILED):
            yield each["actionId"]


def _requests(message: Mapping[str, Any]) -> Iterator[str]:
    """Yield the open requests of a 3.0 vehicle to its fleet control."""
    for kind in ("zoneRequests", "edgeRequests"):
        for each in _listed(message, kind):
            if isinstance(each, dict) and each.get("requestStatus") in ("REQUESTED", "QUEUED"):
                yield f"{kind[:4]} request {each.get('requestId', '')!s:.60}"


def _results(states: list[Any]) -> dict[str, str]:
    """Return the descriptions of results by action, if any; 3.0 calls them actionResult."""
    found = ((s["actionId"], s.get("resultDescription", s.get("actionResult"))) for s in states)
    return {action: text for action, text in found if isinstance(text, str) and text}


def _error(said: Any) -> VehicleError:
    if not isinstance(said, dict):
        raise MessageError("an error is not an object")
    references = []
    for each in _listed(said, "errorReferences"):
        if isinstance(each, dict):
            references.append((str(each.get("referenceKey")), str(each.get("referenceValue"))))
    description = said.get("errorDescription")
    return VehicleError(
        _required(said, "errorType", str),
        WARNING if said.get("errorLevel") is None else _required(said, "errorLevel", str),
        description if isinstance(description, str) else "",
        tuple(references),
    )


# A state message must have these.
_NEEDED = frozenset({"nodeStates", "edgeStates", "actionStates"})
_KINDS = {str: "text", int: "a whole number", list: "a list"}


def _required(message: Mapping[str, Any], key: str, kind: type) -> Any:
    value = message.get(key)
    if not isinstance(value, kind) or isinstance(value, bool):
        raise MessageError(f"{key} is not {_KINDS[kind]}: {value!r:.60}")
    return value


def _text(message: Mapping[str, Any], key: str) -> str:
    """Return a required text; null, which some vehicles write, counts as empty."""
    return "" if key in message and message[key] is None else str(_required(message, key, str))


def _whole(message: Mapping[str, Any], key: str) -> int:
    """Return a required integer; null counts as 0, and some vehicles write 4.0."""
    value = message.get(key)
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return 0 if key in message and value is None else int(_required(message, key, int))


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _listed(message: Mapping[str, Any], key: str) -> list[Any]:
    """Return a list; null, which some vehicles write, is empty. Keys of `_NEEDED` are required."""
    if message.get(key) is None and (key in message or key not in _NEEDED):
        return []
    found: list[Any] = _required(message, key, list)
    return found


def _mapping(message: Mapping[str, Any], key: str, default: Any) -> Any:
    value = message.get(key)
    return value if isinstance(value, dict) else default
