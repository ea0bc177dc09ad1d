"""The channels of a recording: what a message on each of them says, as a JSON Schema."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.recording import foxglove

# Of everything here. A reader refuses recordings with another one.
FORMAT = "1"

FACTS, DROPPED, ALIVE, PLANS = "/facts", "/dropped", "/alive", "/plans"
STATUSES, ACTIONS, LIFE, ROBOTS = "/statuses", "/actions", "/life", "/robots"
ROBOT_TREES = "/robot_trees"
FAULTS, BEATS = "/faults", "/beats"
POSITIONS, SCENE, MAP = "/positions", "/scene", "/map"

_TEXT: dict[str, Any] = {"type": "string"}
_NUMBER: dict[str, Any] = {"type": "integer", "minimum": 0}
_TRUTH: dict[str, Any] = {"type": "boolean"}
_HEX: dict[str, Any] = {"type": "string", "pattern": "^([0-9a-f]{2})*$"}
_BASE64: dict[str, Any] = {"type": "string", "contentEncoding": "base64"}
_LIVES: dict[str, Any] = {"type": "object", "additionalProperties": _TEXT}
_STATUS: dict[str, Any] = {"enum": ["idle", "running", "success", "failure"]}
_NODES: dict[str, Any] = {"type": "string", "pattern": "^[-RSF]*$"}
_STATE: dict[str, Any] = {"enum": ["alive", "suspect", "dead", "left"]}


def _list(of: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": of}


def _object(fields: Mapping[str, Any], optional: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": dict(fields),
        "required": [name for name in fields if name not in optional],
        "additionalProperties": False,
    }


@dataclass(frozen=True)
class Channel:
    """`schema` is a JSON Schema of its messages, `example` one of them, without their `check`.

    `stands_for`: a message stands until the next one with the same values in these fields; None:
    it tells of a moment.
    """

    topic: str
    name: str
    purpose: str
    schema: Mapping[str, Any]
    example: Mapping[str, Any]
    stands_for: tuple[str, ...] | None = None

    @property
    def schema_text(self) -> bytes:
        """The schema as it stands in recordings."""
        return json.dumps(self.schema).encode()


def _channel(
    topic: str,
    name: str,
    purpose: str,
    fields: Mapping[str, Any],
    example: Mapping[str, Any],
    optional: tuple[str, ...] = (),
    stands_for: tuple[str, ...] | None = None,
) -> Channel:
    schema = {"title": name, **_object({**fields, "check": _HEX}, optional)}
    return Channel(topic, name, purpose, schema, example, stands_for)


def _drawn(
    topic: str,
    name: str,
    purpose: str,
    example: Mapping[str, Any],
    stands_for: tuple[str, ...] = (),
) -> Channel:
    """One by Foxglove's schema of this name: it allows `check`, as any field that it knows not."""
    schema = foxglove.read_schema(name)
    return Channel(topic, schema["title"], purpose, schema, example, stands_for)


_VERSION = _object({"counter": _NUMBER, "nonce": _TEXT, "sequence": _NUMBER})
_LINE = _object(
    {
        **dict.fromkeys(("activation", "global_task", "local_task"), _TEXT),
        "performance": {"type": "number"},
        "pinned": _TRUTH,
        "leader": {"type": ["string", "null"]},
        "round": _NUMBER,
    }
)
_WAITING = _object({"activation": _TEXT, "global_task": _TEXT, "blocked": _TRUTH, "reason": _TEXT})
_BIDDING = _object(
    {
        **dict.fromkeys(("activation", "global_task", "local_task"), _TEXT),
        "bids": {"type": "object", "additionalProperties": {"type": ["number", "null"]}},
        "silent": _list(_TEXT),
        "open": _TRUTH,
    }
)
_TASK = dict.fromkeys(("activation", "global_task", "local_task"), _TEXT)

_EXAMPLE_NS, _EXAMPLE_COLOR = 1_790_000_000_500_000_000, foxglove.color("#ff9900")

_ALL = (
    _channel(
        FACTS,
        "mrbt.Fact",
        "a fact was taken in, from others or as this robot's own",
        {
            "number": _NUMBER,
            "author": _TEXT,
            "name": _TEXT,
            "version": _VERSION,
            "value": {},
            "packed": _BASE64,
            "hash": _HEX,
            "proof": _object({"hashes": _BASE64, "signature": _BASE64}),
        },
        {
            "number": 3,
            "author": "A1",
            "name": "outcome/explore.north/scan",
            "version": {"counter": 1, "nonce": "5e0c12aa", "sequence": 4},
            "value": [True, None],
            "packed": "ksPA",
            "hash": "6f0a8c3b52d1f0e79a4dbe1c0d2e3f40",
        },
        ("proof",),
        stands_for=("author", "name"),
    ),
    _channel(
        DROPPED,
        "mrbt.Dropped",
        "a fact was dropped: nothing can ask for it any more",
        {"number": _NUMBER, "author": _TEXT, "name": _TEXT},
        {"number": 9, "author": "A1", "name": "outcome/explore.north/scan"},
    ),
    _channel(
        ALIVE,
        "mrbt.Alive",
        "the robots that plans count on are others now, with their incarnations",
        {"robots": _LIVES},
        {"robots": {"A1": "1.5e0c12aa", "B1": "2.77ab0c1d"}},
        stands_for=(),
    ),
    _channel(
        PLANS,
        "mrbt.Plan",
        "a plan was made, from all facts before it and this alive set",
        {
            "number": _NUMBER,
            "facts": _NUMBER,
            "facts_digest": _HEX,
            "alive": _LIVES,
            "digest": _HEX,
            "hash": _HEX,
            "result": _STATUS,
            "order": {"enum": ["resume", "pause", "abort"]},
            "feasible": _TRUTH,
            "requests": _list(_list(_TEXT)),
            "lines": {"type": "object", "additionalProperties": _LINE},
            "idle": _LIVES,
            "waiting": _list(_WAITING),
            "bids": _list(_BIDDING),
            "pending_verdicts": _list(_TEXT),
            "pending_losses": _list(_TEXT),
        },
        {
            "number": 2,
            "facts": 6,
            "facts_digest": "1b5a90cc1e2f3041",
            "alive": {"A1": "1.5e0c12aa"},
            "digest": "90aa12ffee010203",
            "hash": "0c2b5e2f8f5c4a3e9d1f1b2a3c4d5e6f",
            "result": "running",
            "order": "resume",
            "feasible": True,
            "requests": [["explore", "explore.north"]],
            "lines": {
                "A1": {
                    "activation": "explore.north",
                    "global_task": "explore",
                    "local_task": "scan",
                    "performance": 1.0,
                    "pinned": False,
                    "leader": None,
                    "round": 0,
                }
            },
            "idle": {},
            "waiting": [],
            "bids": [],
            "pending_verdicts": [],
            "pending_losses": [],
        },
        stands_for=(),
    ),
    _channel(
        STATUSES,
        "mrbt.Statuses",
        "nodes have other statuses: of T_G by the plan of this number, of T_i as it was ticked",
        {
            "plan": _NUMBER,
            "nodes": _NODES,
            **dict.fromkeys(("T_i", "T_A", "T_G", "T_Li"), _STATUS),
        },
        {
            "plan": 2,
            "nodes": "RSR-",
            "T_i": "running",
            "T_A": "success",
            "T_G": "running",
            "T_Li": "running",
        },
        ("T_i", "T_A", "T_G", "T_Li"),
        stands_for=(),
    ),
    _channel(
        ACTIONS,
        "mrbt.Action",
        "this robot's own action started, came so far (percent), ended, was cancelled or stopped",
        {
            "event": {"enum": ["started", "progress", "finished", "cancelled", "stopped"]},
            "ticket": _NUMBER,
            **_TASK,
            "coalition": _TEXT,
            "partners": _list(_TEXT),
            "performance": {"type": "number"},
            "percent": _NUMBER,
            "success": _TRUTH,
            "error": _TEXT,
        },
        {
            "event": "started",
            "ticket": 1,
            "activation": "explore.north",
            "global_task": "explore",
            "local_task": "scan",
            "coalition": "",
            "partners": [],
            "performance": 1.0,
        },
        ("coalition", "partners", "performance", "percent", "success", "error"),
    ),
    _channel(
        LIFE,
        "mrbt.Life",
        "this robot joined, was fenced off, catches up or has caught up, found a later life of its "
        "own, leaves or stopped",
        {
            "event": {
                "enum": [
                    *("joined", "fenced", "catches_up", "caught_up"),
                    *("later_life_found", "leaving", "stopped"),
                ]
            },
            "incarnation": _TEXT,
            "code": {"type": "integer"},
            "reason": _TEXT,
        },
        {"event": "joined", "incarnation": "1.5e0c12aa"},
        ("code", "reason"),
    ),
    _channel(
        ROBOTS,
        "mrbt.Robot",
        "what is known of another robot has changed; observers also note what it reports",
        {
            "robot": _TEXT,
            "incarnation": _TEXT,
            "state": _STATE,
            "joined": _TRUTH,
            "plan": _HEX,
            "statuses": _list(_STATUS),
            "percent": _NUMBER,
        },
        {
            "robot": "B1",
            "incarnation": "2.77ab0c1d",
            "state": "suspect",
            "joined": True,
        },
        ("plan", "statuses", "percent"),
        stands_for=("robot",),
    ),
    _channel(
        ROBOT_TREES,
        "mrbt.RobotTree",
        "nodes have other statuses in the tree that carries out a robot's local task",
        {"robot": _TEXT, "nodes": _NODES},
        {"robot": "B1", "nodes": "RSR-"},
        stands_for=("robot",),
    ),
    _channel(
        FAULTS,
        "mrbt.Fault",
        "a fault, or its end: a robot suspect, dead or heard again, its token, its capabilities",
        {
            "event": {
                "enum": [
                    *("suspect", "dead", "alive", "left", "token_lost", "token_shown"),
                    *("capabilities_lost", "capabilities_restored", "grants_ran_out"),
                ]
            },
            "robot": _TEXT,
            "incarnation": _TEXT,
            "capabilities": _list(_TEXT),
        },
        {"event": "dead", "robot": "B1", "incarnation": "2.77ab0c1d"},
        ("capabilities",),
    ),
    _channel(
        BEATS,
        "mrbt.Beat",
        "a heartbeat, as its bytes; only with --record-beats",
        {"source": _TEXT, "sent": _TRUTH, "data": _BASE64},
        {"source": "B1", "sent": False, "data": "lwGk"},
    ),
    _drawn(
        POSITIONS,
        "FrameTransform",
        "a robot, this one or one that it hears, has said that it is somewhere else",
        foxglove.frame_transform(foxglove.robot_frame("B1"), 2.5, 4.0, 0.0, _EXAMPLE_NS),
        ("child_frame_id",),
    ),
    _drawn(
        SCENE,
        "SceneUpdate",
        "robots that say where they are have other states, or have gone: all that are there now",
        foxglove.scene_update(
            [
                foxglove.entity(
                    "B1",
                    foxglove.robot_frame("B1"),
                    {"robot": "B1", "state": "suspect"},
                    _EXAMPLE_NS,
                    arrows=[foxglove.arrow(0.5, _EXAMPLE_COLOR)],
                    texts=[foxglove.label(0, 0, 0.5, "B1 suspect", _EXAMPLE_COLOR)],
                )
            ],
            ["A1"],
            _EXAMPLE_NS,
        ),
    ),
    _drawn(
        MAP,
        "SceneUpdate",
        "the mission's map, whole, at the beginning and when its places have other states",
        foxglove.scene_update(
            [
                foxglove.entity(
                    "place/engine",
                    foxglove.WORLD,
                    {"place": "engine", "state": "bad"},
                    _EXAMPLE_NS,
                    cylinders=[foxglove.disc(2, 2, 0.5, _EXAMPLE_COLOR)],
                )
            ],
            (),
            _EXAMPLE_NS,
        ),
    ),
)

CHANNELS: Mapping[str, Channel] = {channel.topic: channel for channel in _ALL}
