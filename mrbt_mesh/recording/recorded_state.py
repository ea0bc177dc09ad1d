"""The state of a robot at a point of its recording: facts, alive set, plan, action."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.validation import refusal_reason
from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.foxglove import heading_of, robot_of
from mrbt_mesh.recording.messages import (
    pack_alive,
    pack_fact,
    pack_statuses,
    read_incarnation,
    unpack_fact,
    unpack_statuses,
)
from mrbt_mesh.recording.reader import RecordedMessage


class NothingNewError(ValueError):
    """A recorded fact changes nothing that was known before."""


class RecordedState:
    """The state of a recording's owner, after the records applied so far.

    `plan`, `statuses`, `action` and `robots` are the last messages of their channels; `action` is
    None once it has ended, `robots` are by name. `changes` counts the changes of facts. `positions`
    are those of the robots that are present and report them. `is_skipping`: only records still
    valid at the next one are applied, the scene first, as at the beginning of a later part.
    """

    def __init__(self, facts: TeamFacts, part: int = 1) -> None:
        """`facts` must be empty, and of the recording's mission and run.

        `part` is its first part.
        """
        self.facts = facts
        self.changes = 0
        self.is_skipping = part > 1
        self.alive: dict[str, Incarnation] = {}
        self.plan: Mapping[str, Any] | None = None
        self.statuses: Mapping[str, Any] | None = None
        self.action: Mapping[str, Any] | None = None
        self.robots: dict[str, Mapping[str, Any]] = {}
        # Robot -> the statuses of the tree that carries out its local task.
        self.trees: dict[str, bytes] = {}
        self.percent = 0
        self.positions: dict[str, Position] = {}
        # Robot -> whether it reports its heading.
        self._drawn: dict[str, bool] = {}

    def apply(self, record: RecordedMessage) -> Entry | None:
        """Apply a record and return its fact, if any.

        Raises ValueError if it cannot follow the previous ones.
        """
        data = record.data
        match record.topic:
            case channels.FACTS:
                return self._fact(data)
            case channels.DROPPED:
                self._number(data)
                if self.facts.map.get(data["author"], data["name"]) is None:
                    raise ValueError(f"{data['author']}'s {data['name']} is dropped, but not there")
                self.facts.map.drop(data["author"], data["name"])
            case channels.ALIVE | channels.REVOKED:
                self._members(record.topic, data)
            case channels.PLANS:
                self.plan = data
            case channels.STATUSES:
                self.statuses = data
            case channels.ROBOTS | channels.ROBOT_TREES:
                self._robot(record.topic, data)
            case channels.PARTS:
                self.is_skipping, self.changes = False, data["changes"]
            case channels.ACTIONS:
                self._action(data)
            case channels.SCENE:
                self._scene(data)
            case channels.POSITIONS:
                self._moved(data)
        return None

    def _members(self, topic: str, data: Mapping[str, Any]) -> None:
        """Apply a change of the robots that count for plans, or of the revoked ones."""
        if topic == channels.ALIVE:
            alive = data["robots"].items()
            self.alive = {robot: read_incarnation(text) for robot, text in alive}
        else:
            self.facts.set_revoked(frozenset(data["robots"]))

    def _robot(self, topic: str, data: Mapping[str, Any]) -> None:
        if topic == channels.ROBOTS:
            self.robots[data["robot"]] = data
        else:
            self.trees[data["robot"]] = unpack_statuses(data["nodes"])

    def _scene(self, data: Mapping[str, Any]) -> None:
        self._drawn = {each["id"]: bool(each["arrows"]) for each in data["entities"]}
        for robot in self.positions.keys() - self._drawn.keys():
            del self.positions[robot]

    def _moved(self, data: Mapping[str, Any]) -> None:
        robot, there = robot_of(data["child_frame_id"]), data["translation"]
        if robot not in self._drawn:
            if self.is_skipping:
                return  # the robot has gone since
            raise ValueError(f"{robot} is somewhere, but was not there before")
        turn = heading_of(data["rotation"])
        self.positions[robot] = Position(
            round(there["x"] * 1_000),
            round(there["y"] * 1_000),
            round(turn * 1_000) if self._drawn[robot] else None,
        )

    def _fact(self, data: Mapping[str, Any]) -> Entry:
        entry = unpack_fact(data)
        self._number(data)
        refused = refusal_reason(entry, self.facts.in_force, self.facts.run)
        if refused is not None:
            raise ValueError(f"no robot takes this fact: {refused}")
        if self.facts.map.merge([entry]) != [entry]:
            raise NothingNewError(f"{entry.author}'s {entry.name} changes nothing that was known")
        return entry

    def _number(self, data: Mapping[str, Any]) -> None:
        expected, self.changes = self.changes + 1, data["number"]
        if data["number"] != expected and not self.is_skipping:
            raise ValueError(f"change {data['number']} of facts where {expected} is due")

    def _action(self, data: Mapping[str, Any]) -> None:
        if data["event"] in ("finished", "stopped"):
            self.action, self.percent = None, 0
        elif data["event"] == "started":
            self.action, self.percent = data, 0
        elif data["event"] == "progress":
            self.percent = data["percent"]

    def to_json(self) -> dict[str, Any]:
        """Return the whole state as plain data."""
        return {
            **team_state(self.facts, self.alive, self.plan),
            "revoked": sorted(self.facts.revoked),
            "statuses": self.statuses,
            "action": None if self.action is None else {**self.action, "percent": self.percent},
            "robots": {robot: self.robots[robot] for robot in sorted(self.robots)},
            "robot_trees": {
                robot: pack_statuses(self.trees[robot]) for robot in sorted(self.trees)
            },
            "positions": {
                robot: self.positions[robot].in_units() for robot in sorted(self.positions)
            },
        }


def team_state(
    facts: TeamFacts, alive: Mapping[str, Incarnation], plan: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return facts, alive set and plan as recorded; equal states give equal results."""
    rows = [{k: v for k, v in pack_fact(e, 0).items() if k != "number"} for e in facts.map]
    return {
        "facts": rows,
        "facts_digest": facts.map.digest().hex(),
        "alive": pack_alive(alive),
        "plan": plan,
    }
