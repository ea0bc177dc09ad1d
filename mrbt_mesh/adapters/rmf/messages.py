"""A team in the messages of rmf_api_msgs: pure functions from what is known to plain data.

A job is a task, its type the task's category, and its arguments the description.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import problem_text
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.observer.job_rows import HELD, RUNNING, WAITING
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.views.model.job_types import ParameterView, job_types

# `expired` has no counterpart: the log says it.
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
MOST_LINES = 100


@dataclass
class TaskHistory:
    """What this program has seen and done of one job; times are Unix times in ms.

    `labels`: those it was dispatched with. `cancelled`: when a client asked for its cancellation,
    and its labels. `log`: the newest entries.
    """

    labels: list[str] = field(default_factory=list)
    started_ms: int | None = None
    finished_ms: int | None = None
    cancelled: tuple[int, list[str]] | None = None
    log: list[dict[str, Any]] = field(default_factory=list)
    count: int = 0
    state: str = WAITING

    def follow(self, row: Mapping[str, Any], now_ms: int, is_older: bool = False) -> None:
        """Note a change of the job. `is_older`: it was there before this program, so it is not
        known since when it is in its state.
        """
        state = row["state"]
        if not is_older and self.state != state:
            if state == RUNNING and self.started_ms is None:
                self.started_ms = now_ms
            if state not in OPEN:
                self.finished_ms = now_ms
        self.state = state
        text = ": ".join(filter(None, (state, row["why"] or ", ".join(row["robots"]))))
        if not self.log or self.log[-1]["text"] != text:
            tier = "error" if state in ("failed", "expired") else "info"
            entry = {"seq": self.count, "tier": tier, "unix_millis_time": now_ms, "text": text}
            self.count += 1
            self.log = [*self.log, entry][-MOST_LINES:]


def task_state(row: Mapping[str, Any], history: TaskHistory, fleet: str) -> dict[str, Any]:
    """A `task_state` of a row, a JobRow as a mapping. RMF assigns a task to one robot: the first
    of those that work on it.
    """
    is_dispatched = bool(row["robots"]) or row["state"] not in OPEN
    state: dict[str, Any] = {
        "booking": {
            "id": row["id"],
            "priority": {"type": "value", "value": row["priority"]},
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
    if row["not_before_us"]:
        state["booking"]["unix_millis_earliest_start_time"] = row["not_before_us"] // 1_000
    if row["robots"]:
        state["assigned_to"] = {"group": fleet, "name": row["robots"][0]}
        state["dispatch"]["assignment"]["expected_robot_name"] = row["robots"][0]
    if history.started_ms is not None:
        state["unix_millis_start_time"] = history.started_ms
    if history.finished_ms is not None:
        state["unix_millis_finish_time"] = history.finished_ms
    if history.cancelled is not None:
        at_ms, labels = history.cancelled
        state["cancellation"] = {"unix_millis_request_time": at_ms, "labels": labels}
    return state


def task_log(name: str, entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A `task_log` of a job."""
    return {"task_id": name, "log": list(entries)}


def fleet_state(observer: Observer, fleet: str, now_ms: int) -> dict[str, Any]:
    """A `fleet_state`: the team is one fleet, its mission's name that of its map."""
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
    if peer is not None and peer.position is not None:
        where = peer.position.in_units()
        place = {"x": where["x"], "y": where["y"], "yaw": where["heading"] or 0.0}
        found["location"] = {"map": observer.mission.name, **place}
    return found


def discovered_tasks(mission: Mission, fleet: str) -> dict[str, Any]:
    """The answer to a `task_discovery_request`: a task for each type of jobs.

    The published schema has `description_schema` and requires `schema`: both are given.
    """
    tasks = []
    for kind in job_types(mission):
        schema = {
            "type": "object",
            "properties": {each.name: _schema(each) for each in kind.parameters},
            "required": [each.name for each in kind.parameters],
            "additionalProperties": False,
        }
        detail = f"a job of type {kind.name}"
        both = {"description_schema": schema, "schema": schema}
        tasks.append({"category": kind.name, "detail": detail, **both})
    data = {"fleet_name": fleet, "tasks": tasks}
    return {"type": "task_discovery_update", "data": data}


def _schema(parameter: ParameterView) -> dict[str, Any]:
    if parameter.choices:
        return {"enum": list(parameter.choices)}
    return {"type": "integer", "minimum": parameter.min, "maximum": parameter.max}


def failure(code: int, category: str, *details: str) -> dict[str, Any]:
    """The answer to a request that was not carried out; `code`: as of HTTP."""
    errors = [{"code": code, "category": category, "detail": detail} for detail in details]
    return {"success": False, "errors": errors}
