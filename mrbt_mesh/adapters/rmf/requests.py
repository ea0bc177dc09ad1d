"""Requests of Open-RMF's task API, carried out by a team; each is answered, also a wrong one."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import Any

import fastjsonschema

from mrbt_mesh.adapters.rmf.messages import (
    TaskHistory,
    discovered_tasks,
    failure,
    task_log,
    task_state,
)
from mrbt_mesh.core.observer.job_rows import WAITING, JobRow
from mrbt_mesh.runtime.team_client import JobRefusedError, TeamClient, user_name
from mrbt_mesh.views.web.problem import STATUS_OF_CAUSE

SCHEMAS = Path(__file__).with_name("schemas")
# A label that gives the id of a job, so that a repeated request is the same job.
ID_LABEL = "id="
MAX_SHOWN = 300


class InvalidRequestError(Exception):
    """A request is not as its schema says, or asks for what there is not."""


class TaskApi:
    """Answers requests. `histories`: what is known of each job beside its state, by its id, and
    `touched`: those of which requests have changed that.
    """

    def __init__(self, client: TeamClient, fleet: str, now_ms: Callable[[], int]) -> None:
        self.histories: dict[str, TaskHistory] = defaultdict(TaskHistory)
        self.touched: set[str] = set()
        self._client = client
        self._fleet = fleet
        self._now_ms = now_ms
        self._answers: dict[str, Callable[[Any], Awaitable[dict[str, Any]]]] = {
            "dispatch_task_request": self._dispatch,
            "robot_task_request": self._direct,
            "cancel_task_request": self._cancel,
            "kill_task_request": self._cancel,
            "interrupt_task_request": self._interrupt,
            "resume_task_request": self._resume,
            "task_discovery_request": self._discover,
            "activity_discovery_request": self._discover_activities,
            "task_log_request": self._log,
        }

    async def answer(self, text: str | bytes) -> tuple[dict[str, Any], str]:
        """The response to a request, and what is wrong with it; empty: nothing."""
        try:
            request = self._read(text)
            return await self._answers[request["type"]](request), ""
        except InvalidRequestError as error:
            return failure(422, "invalid request", str(error)), str(error)
        except JobRefusedError as error:
            code = STATUS_OF_CAUSE.get(error.cause, 422)
            return failure(code, HTTPStatus(code).phrase, str(error)), ""
        except TimeoutError as error:
            return failure(504, HTTPStatus(504).phrase, str(error)), ""

    def _read(self, text: str | bytes) -> dict[str, Any]:
        """A request that is valid by the schema of its type."""
        try:
            request = json.loads(text)
        except (ValueError, RecursionError):
            raise InvalidRequestError("it is not JSON") from None
        kind = request.get("type") if isinstance(request, dict) else None
        if not isinstance(kind, str) or kind not in self._answers:
            known = ", ".join(self._answers)
            raise InvalidRequestError(f"its type is {kind!r:.80}; answered are {known}")
        try:
            _validator(kind)(request)
        except (fastjsonschema.JsonSchemaException, RecursionError) as error:
            raise InvalidRequestError(f"{kind}: {error}"[:MAX_SHOWN]) from None
        found: dict[str, Any] = request
        return found

    async def _dispatch(self, message: Mapping[str, Any]) -> dict[str, Any]:
        request = message["request"]
        kind, values, labels = request["category"], request["description"], request.get("labels")
        if request.get("fleet_name", self._fleet) != self._fleet:
            raise InvalidRequestError(f"this is the fleet {self._fleet}")
        if not isinstance(values, dict):
            raise InvalidRequestError("the description is an object: an argument by each name")
        priority = request.get("priority", {}).get("value")
        if "priority" in request and (not isinstance(priority, int) or isinstance(priority, bool)):
            raise InvalidRequestError('a priority is {"value": a whole number}')
        not_before = _time(request.get("unix_millis_earliest_start_time"))
        arguments = self._client.arguments_of(kind, values)
        given = [each.removeprefix(ID_LABEL) for each in labels or () if each.startswith(ID_LABEL)]
        operator = request.get("requester") or user_name()
        job = await self._client.submit(
            kind,
            *arguments,
            job_id=given[0] if given else "",
            priority=priority,
            not_before=not_before,
            operator=operator,
        )
        history = self.histories[job.id]
        history.labels = labels or history.labels
        row = self._row(job.id)
        if row is None:
            # The robots have it, and this program will hear of it in a moment.
            types = self._client.watcher.observer.mission.jobs
            named = types[kind].values_of(arguments)
            usual = types[kind].priority if priority is None else priority
            row = JobRow(job.id, kind, named, WAITING, "", usual, (), operator)
        self.touched.add(job.id)
        return {"success": True, "state": task_state(asdict(row), history, self._fleet)}

    async def _direct(self, message: Mapping[str, Any]) -> dict[str, Any]:
        raise InvalidRequestError("the team decides which robot does a task: dispatch it")

    async def _cancel(self, message: Mapping[str, Any]) -> dict[str, Any]:
        name = message["task_id"]
        await self._client.change(name, "cancel")
        self.histories[name].cancelled = self._now_ms(), message.get("labels", [])
        self.touched.add(name)
        return {"success": True}

    async def _interrupt(self, message: Mapping[str, Any]) -> dict[str, Any]:
        await self._client.change(message["task_id"], "hold")
        return {"success": True, "token": message["task_id"]}

    async def _resume(self, message: Mapping[str, Any]) -> dict[str, Any]:
        # Its schema misspells "required".
        if not isinstance(message.get("for_task"), str):
            raise InvalidRequestError("for_task is missing")
        await self._client.change(message["for_task"], "release")
        return {"success": True}

    async def _discover(self, _: Mapping[str, Any]) -> dict[str, Any]:
        return discovered_tasks(self._client.watcher.observer.mission, self._fleet)

    async def _discover_activities(self, _: Mapping[str, Any]) -> dict[str, Any]:
        return {"data": [{"fleet_name": self._fleet, "activities": []}]}

    async def _log(self, message: Mapping[str, Any]) -> dict[str, Any]:
        name = message["task_id"]
        if self._row(name) is None:
            return failure(404, HTTPStatus(404).phrase, f"no job {name!r:.80} is known here")
        return {"success": True, "data": task_log(name, self.histories[name].log)}

    def _row(self, name: str) -> JobRow | None:
        return next((row for row in self._client.jobs if row.id == name), None)


def _time(unix_ms: float | None) -> datetime | None:
    if unix_ms is None:
        return None
    try:
        return datetime.fromtimestamp(unix_ms / 1_000, UTC)
    except (ValueError, OverflowError, OSError):
        raise InvalidRequestError("the earliest start time is no time in this era") from None


@cache
def _validator(kind: str) -> Callable[[Any], Any]:
    made: Callable[[Any], Any] = fastjsonschema.compile(
        _schema(kind), handlers={"https": lambda uri: _schema(uri.rpartition("/")[2])}
    )
    return made


def _schema(name: str) -> Any:
    return json.loads((SCHEMAS / f"{name.removesuffix('.json')}.json").read_text(encoding="utf-8"))
