"""Carries out requests of Open-RMF's task API; every request is answered, even an invalid one."""

from __future__ import annotations

import json
import secrets
from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import anyio
import fastjsonschema

from mrbt_mesh.adapters.rmf.connection import MAX_REQUEST_BYTES
from mrbt_mesh.adapters.rmf.messages import (
    STATUS,
    TaskHistory,
    discovered_tasks,
    failure,
    task_log,
    task_state,
)
from mrbt_mesh.adapters.rmf.own_errors import OwnErrors
from mrbt_mesh.core.agent.operator_messages import UNKNOWN
from mrbt_mesh.core.mission.job_arguments import named_arguments
from mrbt_mesh.core.mission.mission import MAX_PRIORITY, JobType, whole
from mrbt_mesh.errors import nearest
from mrbt_mesh.observer.job_rows import WAITING, JobRow
from mrbt_mesh.runtime.job_requests import JobRefusedError
from mrbt_mesh.runtime.operator_call import CommandRefusedError
from mrbt_mesh.runtime.team_client import TeamClient, user_name
from mrbt_mesh.views.web.bodies import sent
from mrbt_mesh.views.web.problem import STATUS_OF_CAUSE

SCHEMAS = Path(__file__).with_name("schemas")
# A label that gives the id of a job, so that a repeated request is the same job.
ID_LABEL = "id="
MAX_SHOWN = 300
# The name in requests for a job's `not_before`.
EARLIEST = "unix_millis_earliest_start_time"
# Total characters of a task's labels, which are limited because each state repeats them.
MAX_LABELS = 4_096
MAX_UNIX_MS = (1 << 53) // 1_000
# Open interruptions of one task.
MAX_INTERRUPTIONS = 100
TOKEN_BYTES = 8
# The schema misspells this type; both spellings are answered.
_ACTIVITIES, _ACTIVITIES_MISSPELT = "activity_discovery_request", "activitiy_discovery_request"


class InvalidRequestError(Exception):
    """A request violates its schema, or asks for something invalid; `code`: HTTP status code."""

    def __init__(self, text: str, code: int = 422) -> None:
        super().__init__(text)
        self.code = code


class TaskApi:
    """Answers requests.

    `histories`: what is known about each job besides its state, by id. `touched`: the jobs whose
    history was changed by requests.
    """

    def __init__(
        self, client: TeamClient, fleet: str, now_ms: Callable[[], int], own_errors: OwnErrors
    ) -> None:
        self.histories: dict[str, TaskHistory] = defaultdict(TaskHistory)
        self.touched: set[str] = set()
        self._client = client
        self._fleet = fleet
        self._now_ms = now_ms
        self._own_errors = own_errors
        # Requests about the same task are carried out one at a time.
        self._turns: WeakValueDictionary[str, anyio.Lock] = WeakValueDictionary()
        self._answers: dict[str, Callable[[Any], Awaitable[dict[str, Any]]]] = {
            "dispatch_task_request": self._dispatch,
            "robot_task_request": self._direct,
            "cancel_task_request": self._cancel,
            "kill_task_request": self._cancel,
            "interrupt_task_request": self._interrupt,
            "resume_task_request": self._resume,
            "task_discovery_request": self._discover,
            _ACTIVITIES: self._discover_activities,
            _ACTIVITIES_MISSPELT: self._discover_activities,
            "task_log_request": self._log,
        }

    async def answer(self, text: str | bytes) -> tuple[dict[str, Any], str]:
        """Return the response to a request, and what is wrong with the request, or "".

        An error ends only this request.
        """
        try:
            request = self._read(text)
            async with self._turn(request):
                return await self._answers[request["type"]](request), ""
        except InvalidRequestError as error:
            return failure(error.code, str(error)), str(error)
        except CommandRefusedError as error:
            return failure(STATUS_OF_CAUSE.get(error.cause, 422), str(error)), ""
        except TimeoutError as error:
            return failure(504, str(error)), ""
        except Exception as error:  # an error of this program: other requests continue
            self._own_errors.report(error)
            detail = "an error of mrbt serve, of which its stderr has more"
            return failure(500, detail), f"{type(error).__name__}: {error}"

    def _turn(self, request: Mapping[str, Any]) -> anyio.Lock:
        """Return the lock of the task that a request names; without a task, a new lock."""
        asked = request.get("request")
        named = _ids(asked.get("labels", [])) if isinstance(asked, dict) else []
        name = next(iter(named), request.get("task_id", request.get("for_task")))
        lock = anyio.Lock()
        return self._turns.setdefault(name, lock) if isinstance(name, str) else lock

    def _read(self, text: str | bytes) -> dict[str, Any]:
        """Parse a request and check it by the schema of its type. Raises InvalidRequestError."""
        size = len(text) if isinstance(text, bytes) else len(text.encode(errors="surrogatepass"))
        if size > MAX_REQUEST_BYTES:
            raise InvalidRequestError(
                f"a request has at most {MAX_REQUEST_BYTES} bytes, and this one {size}", 413
            )
        try:
            request = json.loads(text, parse_constant=_refuse_constant)
        except (ValueError, RecursionError):
            raise InvalidRequestError("it is not JSON") from None
        if not isinstance(request, dict):
            raise InvalidRequestError(f"a request is an object, {sent(request)} was sent")
        kind = request.get("type")
        if not isinstance(kind, str) or kind not in self._answers:
            is_there = "type" in request
            given = f"its type is {kind!r:.80}" if is_there else "it has no field `type`"
            raise InvalidRequestError(f"{given}; answered are {', '.join(self._answers)}")
        try:
            if kind == _ACTIVITIES:  # as its schema spells it
                request = {**request, "type": _ACTIVITIES_MISSPELT}
            elif kind == _ACTIVITIES_MISSPELT:
                kind = _ACTIVITIES
            _validator(kind)(request)
        except (fastjsonschema.JsonSchemaException, RecursionError) as error:
            raise InvalidRequestError(f"{kind}: {error}"[:MAX_SHOWN]) from None
        return request

    async def _dispatch(self, message: Mapping[str, Any]) -> dict[str, Any]:
        request = message["request"]
        kind, values, labels = request["category"], request["description"], _labels(request)
        self._require_own("fleet_name", request.get("fleet_name", self._fleet))
        if not isinstance(values, dict):
            raise InvalidRequestError("the description is an object: an argument by each name")
        name = _id(labels)
        not_before = _time(EARLIEST, request)
        requested = _time("unix_millis_request_time", request)
        arguments = self._client.arguments_of(kind, values)
        priority = self._priority(request.get("priority"))
        operator, types = request.get("requester") or user_name(), self._types
        self._client.require_robots()
        try:
            job = await self._client.submit(
                kind,
                *arguments,
                job_id=name,
                priority=priority,
                not_before=not_before,
                operator=operator,
            )
        except JobRefusedError as refusal:
            text = str(refusal).replace("not_before", EARLIEST)
            raise JobRefusedError(text, refusal.cause) from None
        history = self.histories[job.id]
        history.labels = labels or history.labels
        history.priority = request.get("priority", history.priority)
        if requested is not None:
            history.requested_ms = round(1_000 * requested.timestamp())
        row = self._client.job(job.id)
        if row is None or row.state not in STATUS:
            # The robots have the job, but this program has not received it yet.
            named = named_arguments(types, kind, arguments)
            usual = types[kind].priority if priority is None else priority
            row = JobRow(job.id, kind, named, WAITING, "", usual, (), operator)
        self.touched.add(job.id)
        return {"success": True, "state": task_state(asdict(row), history, self._fleet)}

    async def _direct(self, message: Mapping[str, Any]) -> dict[str, Any]:
        self._require_own("fleet", message["fleet"])
        robots = self._client.watcher.observer.robots()
        if message["robot"] not in robots:
            text = f"no robot {message['robot']!r:.80}" + nearest(message["robot"], robots)
            raise JobRefusedError(text, UNKNOWN)
        raise InvalidRequestError(
            "the team decides which robot does a task: send a dispatch_task_request"
        )

    async def _cancel(self, message: Mapping[str, Any]) -> dict[str, Any]:
        name, labels = message["task_id"], _labels(message)
        self._client.require_robots()
        await self._client.change(name, "cancel")
        self.histories[name].cancelled = self._now_ms(), labels
        self.touched.add(name)
        return {"success": True}

    async def _interrupt(self, message: Mapping[str, Any]) -> dict[str, Any]:
        name = message["task_id"]
        if len(self._interruptions(name)) >= MAX_INTERRUPTIONS:
            raise InvalidRequestError(
                f"{name:.80} has {MAX_INTERRUPTIONS} interruptions: resume some of them first", 503
            )
        self._client.require_robots()
        await self._client.change(name, "hold")
        token = secrets.token_hex(TOKEN_BYTES)
        self.histories[name].interruptions.add(token)
        return {"success": True, "token": token}

    async def _resume(self, message: Mapping[str, Any]) -> dict[str, Any]:
        for field in ("for_task", "for_tokens"):  # Its schema misspells "required".
            if field not in message:
                text = "send the id of the task, and the tokens of the interruptions to discard"
                raise InvalidRequestError(f"{field} is missing: {text}")
        name, tokens = message["for_task"], message["for_tokens"]
        known = self._interruptions(name)
        for token in tokens:
            if token not in known:
                text = f"for_tokens: {token!r:.80} is not an interruption of {name!r:.80}"
                raise JobRefusedError(f"{text} that this process knows, or is discarded", UNKNOWN)
        left = known.difference(tokens)
        if not left:
            self._client.require_robots()
            await self._client.change(name, "release")
        self.histories[name].interruptions = left
        return {"success": True}

    def _interruptions(self, name: str) -> set[str]:
        """Return the tokens of a task's open interruptions."""
        return self.histories[name].interruptions if name in self.histories else set()

    async def _discover(self, _: Mapping[str, Any]) -> dict[str, Any]:
        return discovered_tasks(self._client.watcher.observer.mission, self._fleet)

    async def _discover_activities(self, _: Mapping[str, Any]) -> dict[str, Any]:
        return {"data": [{"fleet_name": self._fleet, "activities": []}]}

    async def _log(self, message: Mapping[str, Any]) -> dict[str, Any]:
        name = message["task_id"]
        if self._client.job(name) is None:
            return failure(404, f"no job {name!r:.80} is known here")
        return {"success": True, "data": task_log(name, self.histories[name].log)}

    def _require_own(self, field: str, fleet: Any) -> None:
        if fleet != self._fleet:
            raise InvalidRequestError(f"{field} {fleet!r:.80}: this is the fleet {self._fleet!r}")

    @property
    def _types(self) -> Mapping[str, JobType]:
        return self._client.watcher.observer.mission.jobs

    def _priority(self, given: Mapping[str, Any] | None) -> int | None:
        """Return the priority of a job; None: that of its type.

        rmf-web sends a `binary` priority: 0 is the usual one, 1 is above those of all job types.
        """
        if given is None:
            return None
        value = whole(given.get("value"))
        if not isinstance(value, int) or isinstance(value, bool):
            raise InvalidRequestError(
                'a priority is {"type": "value", "value": a whole number} or {"type": "binary", '
                '"value": 0 or 1}'
            )
        if given.get("type") != "binary":
            return value
        if value not in (0, 1):
            raise InvalidRequestError("a binary priority has the value 0 or 1")
        highest = max(each.priority for each in self._types.values())
        return min(highest + 1, MAX_PRIORITY) if value else None


def _labels(message: Mapping[str, Any]) -> list[str]:
    labels: list[str] = message.get("labels", [])
    if sum(map(len, labels)) > MAX_LABELS:
        raise InvalidRequestError(f"labels: at most {MAX_LABELS} characters in all")
    return labels


def _ids(labels: Iterable[Any]) -> list[str]:
    """Return the ids that labels contain."""
    texts = (each for each in labels if isinstance(each, str))
    return [each.removeprefix(ID_LABEL) for each in texts if each.startswith(ID_LABEL)]


def _id(labels: list[str]) -> str:
    """Return the id that labels give a task, or "". Raises InvalidRequestError."""
    named = sorted({*_ids(labels)})
    if "" in named:
        raise InvalidRequestError(f"labels: no id stands behind {ID_LABEL!r}")
    if len(named) > 1:
        shown = " and ".join(f"{ID_LABEL}{each}"[:80] for each in named[:2])
        raise InvalidRequestError(f"labels: {shown} are two ids, a task has one")
    return named[0] if named else ""


def _time(name: str, request: Mapping[str, Any]) -> datetime | None:
    """Return a time of a request; None if it is missing or 0. Raises InvalidRequestError."""
    unix_ms = request.get(name)
    if not unix_ms:
        return None
    if not 0 < unix_ms <= MAX_UNIX_MS:
        raise InvalidRequestError(f"{name} is not a time in this era")
    return datetime.fromtimestamp(unix_ms / 1_000, UTC)


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


@cache
def _validator(kind: str) -> Callable[[Any], Any]:
    made: Callable[[Any], Any] = fastjsonschema.compile(
        _schema(kind), handlers={"https": lambda uri: _schema(uri.rpartition("/")[2])}
    )
    return made


def _schema(name: str) -> Any:
    return json.loads((SCHEMAS / f"{name.removesuffix('.json')}.json").read_text(encoding="utf-8"))
