"""Describes a team in messages of rmf_api_msgs: pure functions that return plain data.

A job is a task; its type is the task's category, and its arguments are the description.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import problem_text
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import robot_condition
from mrbt_mesh.features.values.traits import traits_of
from mrbt_mesh.observer.job_rows import HELD, RUNNING, WAITING
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.job_types import arguments_schema, job_types

# `expired` has no counterpart: the log tells it.
STATUS = {
    WAITING: "queued",
    HELD: "standby",
    RUNNING: "underway",
    "succeeded": "completed",
    "failed": "failed",
    "cancelled": "canceled",
    "expired": "failed",
}
OPEN = (WAITING, HELD, RUNNING)
# The `per: robot` entry of the blackboard that holds the charge of a robot's battery.
BATTERY = "battery"
MOST_LINES = 100


@dataclass
class TaskHistory:
    """What this program knows about one job besides its state; times are Unix times in ms.

    `labels`, `priority`, `requested_ms`: given when the job was dispatched. `cancelled`: when a
    client requested its cancellation, and the labels of that request. `interruptions`: tokens of
    interruptions that are not resumed. `log`: the newest entries.
    """

    labels: list[str] = field(default_factory=list)
    priority: dict[str, Any] | None = None
    requested_ms: int | None = None
    cancelled: tuple[int, list[str]] | None = None
    interruptions: set[str] = field(default_factory=set)
    log: list[dict[str, Any]] = field(default_factory=list)
    count: int = 0

    def follow(self, row: Mapping[str, Any], now_ms: int) -> None:
        """Add a log entry for a change of the job."""
        state = row["state"]
        text = ": ".join(filter(None, (state, row["why"] or ", ".join(row["robots"]))))
        if not self.log or self.log[-1]["text"] != text:
            tier = "error" if state in ("failed", "expired") else "info"
            entry = {"seq": self.count, "tier": tier, "unix_millis_time": now_ms, "text": text}
            self.count += 1
            self.log = [*self.log, entry][-MOST_LINES:]


def task_state(row: Mapping[str, Any], history: TaskHistory, fleet: str) -> dict[str, Any]:
    """Return the `task_state` of a row, a JobRow as a mapping.

    RMF assigns a task to one robot: this is the first robot that works on it.
    """
    priority = history.priority
    if priority is None and row["priority"] is not None:
        priority = {"type": "value", "value": row["priority"]}
    is_dispatched = bool(row["robots"]) or row["state"] not in OPEN
    state: dict[str, Any] = {
        "booking": {
            "id": row["id"],
            **({"priority": priority} if priority is not None else {}),
            "labels": history.labels,
            "requester": row["operator"],
        },
        "category": row["type"],
        "detail": row["arguments"],
        "status": STATUS[row["state"]],
        "dispatch": {
            "status": "dispatched" if is_dispatched else "queued",
            "assignment": {"fleet_name": fleet},
        },
    }
    requested_ms = history.requested_ms
    if requested_ms is None and row["submitted_us"] is not None:
        requested_ms = row["submitted_us"] // 1_000
    if requested_ms is not None:
        state["booking"]["unix_millis_request_time"] = requested_ms
    if row["not_before_us"]:
        state["booking"]["unix_millis_earliest_start_time"] = row["not_before_us"] // 1_000
    if row["robots"]:
        state["assigned_to"] = {"group": fleet, "name": row["robots"][0]}
        state["dispatch"]["assignment"]["expected_robot_name"] = row["robots"][0]
    for name, at_us in (("start", row["begun_us"]), ("finish", row["ended_us"])):
        if at_us is not None:
            state[f"unix_millis_{name}_time"] = at_us // 1_000
    if history.cancelled is not None:
        at_ms, labels = history.cancelled
        state["cancellation"] = {"unix_millis_request_time": at_ms, "labels": labels}
    return state


def last_state(told: Mapping[str, Any], state: str) -> dict[str, Any]:
    """Return the last state of a task that ended so long ago that robots keep little about it.

    `told`: its state as sent before. `state`: how it ended. If no robot has kept that, the task has
    the status `error`, because calling it completed would be a guess.
    """
    return {**told, "status": STATUS.get(state, "error")}


def task_log(name: str, entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the `task_log` of a job."""
    return {"task_id": name, "log": list(entries)}


def fleet_state(observer: Observer, fleet: str, now_ms: int) -> dict[str, Any]:
    """Return the `fleet_state`: the team is one fleet; its map is named after the mission."""
    robots = {robot: _robot(observer, robot, now_ms) for robot in observer.robots()}
    return {"name": fleet, "robots": robots}


def _robot(observer: Observer, robot: str, now_ms: int) -> dict[str, Any]:
    state, claim = observer.robot_state(robot), observer.claim(robot)
    known, peer = observer.facts.members.get(robot), observer.membership.peers.get(robot)
    if state in (State.SUSPECT, State.DEAD):
        status = "offline"
    else:
        status = "shutdown" if state is State.LEFT else "idle" if claim is None else "working"
    lost = known.member.lost if known is not None else {}
    problems = observer.facts.problems.get(robot, {})
    issues = [{"category": "lost capability", "detail": f"{n}: {why}"} for n, why in lost.items()]
    for subject, text in problems.items():
        issues.append({"category": "problem", "detail": problem_text(subject, text)})
    found: dict[str, Any] = {
        "name": robot,
        "status": status,
        "task_id": parse_activation(claim.activation).job if claim is not None else "",
        "unix_millis_time": now_ms,
        "issues": issues,
    }
    share = charge(observer, robot)
    if share is not None:
        found["battery"] = share
    if peer is not None and peer.position is not None:
        where = peer.position.in_units()
        place = {"x": where["x"], "y": where["y"], "yaw": where["heading"] or 0.0}
        found["location"] = {"map": observer.mission.name, **place}
    return found


def charge(observer: Observer, robot: str) -> float | None:
    """Return the robot's blackboard entry `battery` as a fraction of its maximum, or None."""
    mission = observer.mission
    is_own = mission.entries.is_own(BATTERY)
    kind = traits_of(mission.conditions[BATTERY]).values if is_own else None
    if kind is None or not kind.is_number or kind.high <= 0:
        return None
    value = observer.facts.conditions.entry(robot_condition(BATTERY, robot))
    return min(1.0, max(0.0, value / kind.high)) if isinstance(value, int) else None


def discovered_tasks(mission: Mission, fleet: str) -> dict[str, Any]:
    """Return the answer to a `task_discovery_request`: one task for each job type.

    The published schema defines `description_schema` but requires `schema`: both are given.
    """
    tasks = []
    for kind in job_types(mission):
        schema = arguments_schema(kind)
        detail = f"a job of type {kind.name}"
        both = {"description_schema": schema, "schema": schema}
        tasks.append({"category": kind.name, "detail": detail, **both})
    data = {"fleet_name": fleet, "tasks": tasks}
    return {"type": "task_discovery_update", "data": data}


def failure(code: int, detail: str) -> dict[str, Any]:
    """Return the answer to a request that was not carried out; `code` is an HTTP status code."""
    error = {"code": code, "category": HTTPStatus(code).phrase, "detail": detail}
    return {"success": False, "errors": [error]}
