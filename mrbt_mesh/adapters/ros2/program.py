"""A robot program whose local tasks are actions, services and topics of ROS 2.

rclpy runs in a process of its own, the bridge. This module runs the tasks, judges their outcomes,
and reports conditions, positions and missing servers to the team.
"""

from __future__ import annotations

import re
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import anyio

from mrbt_mesh.adapters.binding import FillError, KnownValues, News
from mrbt_mesh.adapters.ros2.binding_file import (
    BindingFile,
    FilledBinding,
    TaskBinding,
    bind_message,
    load_bindings,
)
from mrbt_mesh.adapters.ros2.bridge.watch import LifeWatch
from mrbt_mesh.adapters.ros2.bridge_process import (
    BridgePipe,
    bridge_command,
    bridge_environment,
    bridge_process,
    check_bindings,
)
from mrbt_mesh.adapters.ros2.expression import MessageExpressionError
from mrbt_mesh.adapters.ros2.servers import Servers
from mrbt_mesh.errors import TaskFailedError
from mrbt_mesh.runtime.context import RobotContext, TaskContext
from mrbt_mesh.runtime.log import robot_logger
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.user_code import running_call

RESTART_S = 1.0
# Time to read the rest of the bridge's standard error after it has ended.
LAST_WORDS_S = 1.0
# The pause before a restart grows up to this while the bridge does not start.
MAX_RESTART_S = 30.0
# Number of messages to the bridge within the detection time.
BEATS = 5

_BRIDGE_ENDED = "the bridge to ROS had ended"
_FAILURES = {
    "aborted": "the server aborted the goal",
    "cancelled": "the goal was cancelled by somebody else",
    "rejected": "the server rejected the goal",
    "absent": "the server was not there for 30 s",
    "lost": "nothing is known of it any more",
}


def robot_program(binding_file: str | Path, *, record_work: bool = False) -> RobotProgram:
    """A program for robots whose local tasks are bound to ROS 2 by a file.

    `record_work` is passed to RobotProgram. More local tasks, bids and sensors may be added to the
    returned program. Raises InputError for a file that cannot be used. Whether the file fits the
    ROS types is checked before a robot starts.
    """
    file = load_bindings(Path(binding_file))
    program = bound_program(file, bridge_command(file), record_work)
    program.for_mission(file.check_mission)
    program.before_start(lambda: check_bindings(file))
    return program


def bound_program(file: BindingFile, command: list[str], record_work: bool = False) -> RobotProgram:
    """Return a program for a checked file; `command` starts the bridge."""
    program = RobotProgram(record_work=record_work)

    @cache
    def member(robot: str) -> ConnectedRobot:
        return ConnectedRobot(file, robot, command)

    @program.background(costs=list(file.local_tasks))
    async def connect(context: RobotContext) -> None:
        await member(context.robot).run(context)

    def serve(name: str) -> None:
        @program.local_task(name)
        async def perform(task: TaskContext, *arguments: str) -> None:
            await member(task.robot).perform(task, name, arguments)

    def provide(name: str) -> None:
        @program.entry(name)
        def entry(context: RobotContext) -> float | str | None:
            return member(context.robot).entries.get(name)

    for name in file.local_tasks:
        serve(name)
    for name in file.entries:
        provide(name)
    if file.position is not None:

        @program.source("robot_pose")
        def pose(context: RobotContext) -> tuple[float, float]:
            return member(context.robot).pose

    return program


@dataclass
class _Run:
    """A running task. `end`: the bridge's message that it has ended."""

    number: int
    task: TaskContext
    name: str
    binding: TaskBinding
    goal_id: bytes
    body: Any
    is_sent: bool = False
    is_cancelled: bool = False
    # True if a bridge that has ended sent it: the next bridge cancels it.
    is_orphaned: bool = False
    end: dict[str, Any] | None = None
    # The newest message on the topic of its `until`; cleared when the task ends at its server.
    until: Mapping[str, Any] | None = None
    news: News = field(default_factory=News)


class ConnectedRobot:
    """One robot, its bridge, and its running tasks.

    The `entries` of trees, and `pose` (x and y in metres), come from the newest messages on topics.
    """

    def __init__(self, file: BindingFile, robot: str, command: list[str]) -> None:
        self._file = file
        self._robot = robot
        self._command = command
        self._log = robot_logger(robot)
        self._values = file.robot_values(robot)
        self._background: RobotContext | None = None
        self._pipe: BridgePipe | None = None
        self._runs: dict[int, _Run] = {}
        self._count = 0
        self._was_ready = False
        self._servers = Servers(file, robot, self._values)
        self._bridge_failure = ""
        # The present bridge's last line on standard error, and whether standard error has ended.
        self._last_words = ""
        self._all_is_said = anyio.Event()
        # Goals that have not ended: if the bridge dies, the next one cancels them.
        self._at_servers: dict[int, tuple[str, bytes]] = {}
        self._conditions: dict[str, bool] = {}
        self._refused: set[str] = set()
        self.entries: dict[str, float | str] = {}
        self.pose = (0.0, 0.0)

    # -- what the robot's runtime asks for -----------------------------------------------------

    async def perform(self, task: TaskContext, name: str, arguments: tuple[str, ...]) -> None:
        """Perform a local task; when cancelled, cancel it at its server. Raises TaskFailedError."""
        binding = self._file.local_tasks[name]
        try:
            wanted = binding.filled(self._values, arguments, self._file.values)
        except FillError as error:
            raise TaskFailedError(str(error)) from None
        run = self._start(task, name, binding, wanted.body)
        try:
            with anyio.move_on_after(binding.within_s) as limit:
                await self._finished(run)
            if limit.cancelled_caught:
                self._cancel(run, wanted)
                await self._stopped(run)
                if run.end is None or run.end["how"] != "succeeded" or binding.until is not None:
                    raise TaskFailedError(f"not done within {binding.within_s:g} s")
        except BaseException:
            with anyio.CancelScope(shield=True):
                self._cancel(run, wanted)
                await self._stopped_or_lost(run)
            raise
        finally:
            del self._runs[run.number]
        self._judge(run, wanted)

    def _start(self, task: TaskContext, name: str, binding: TaskBinding, body: Any) -> _Run:
        self._count += 1
        run = _Run(self._count, task, name, binding, uuid.uuid4().bytes, body)
        self._runs[run.number] = run
        self._send(run)
        return run

    def _send(self, run: _Run) -> None:
        """Have the bridge start a run; if it is not ready yet, the run is sent later."""
        if self._pipe is None:
            return
        run.is_sent = True
        if run.binding.kind == "action":
            self._at_servers[run.number] = (run.name, run.goal_id)
        start = {"task": run.name, "run": run.number, "goal_id": run.goal_id, "body": run.body}
        self._pipe.say({"op": "start", **start})

    async def _finished(self, run: _Run) -> None:
        """Wait until the run has ended and its `until` holds."""
        while run.end is None:
            await run.news.wait()
        until = run.binding.until
        if until is None or run.end["how"] != "succeeded":
            return
        try:
            while run.until is None or not until.expression.truth(run.until):
                await run.news.wait()
        except MessageExpressionError as error:
            raise TaskFailedError(f"until: {error}") from None

    def _cancel(self, run: _Run, wanted: FilledBinding) -> None:
        """Have the bridge stop a run that is no longer needed."""
        if run.is_cancelled:
            return
        run.is_cancelled = True
        if wanted.on_cancel is not None:
            stop = self._start(run.task, run.name, run.binding, wanted.on_cancel)
            del self._runs[stop.number]
        if run.end is None and self._pipe is not None:
            self._pipe.say({"op": "cancel", "run": run.number})
        call = running_call.get()
        if call is not None:
            call.waits_for = f"{self._servers.called(run.name)} has not stopped its cancelled goal"

    async def _stopped(self, run: _Run) -> None:
        """Wait until a cancelled task has ended at its server, however long that takes.

        A failure lets another robot start the task, so it must not be reported while the server may
        still be working.
        """
        while run.is_sent and run.end is None:
            await run.news.wait()

    async def _stopped_or_lost(self, run: _Run) -> None:
        """Wait until a cancelled task has ended at its server, or the server cannot be used.

        In the second case the team knows that the robot has lost this capability.
        """
        while (
            run.is_sent
            and run.end is None
            and self._pipe is not None
            and self._servers.is_there(run.name)
        ):
            await run.news.wait()

    def _judge(self, run: _Run, wanted: FilledBinding) -> None:
        """Set the task's conditions. Raises TaskFailedError unless the server reports a success."""
        assert run.end is not None
        how, text, fields = (run.end[key] for key in ("how", "text", "fields"))
        binding = run.binding
        try:
            if binding.reason is not None and how in ("succeeded", "aborted"):
                text = str(binding.reason.value(fields))
            if how == "unfit":
                raise TaskFailedError(text)
            if how == "silenced":
                limit = f"{self._file.detection_s:g} s"
                reason = f"this robot's process stood still for {limit}: its goal was cancelled"
                raise TaskFailedError(reason)
            if how != "succeeded":
                raise TaskFailedError(_FAILURES[how] + (f": {text}" if text else ""))
            success = binding.success
            if success is not None and not success.truth(fields):
                raise TaskFailedError(text or f"the result says otherwise: {success.text}")
            if success is None and fields.get("success") is False and binding.kind == "srv":
                raise TaskFailedError(text or "the service answered: success is false")
            for name, value in wanted.sets.items():
                found = value if isinstance(value, bool) else value.truth(fields)
                run.task.set_condition(name, found)
        except MessageExpressionError as error:
            raise TaskFailedError(str(error)) from None

    # -- the bridge ----------------------------------------------------------------------------

    async def run(self, context: RobotContext) -> None:
        """Keep a bridge running as long as the robot lives."""
        self._background = context
        self._servers.begin(context)
        async with anyio.create_task_group() as group:
            group.start_soon(self._servers.end_start_up)
            await self._keep_bridge()

    async def _keep_bridge(self) -> None:
        node = "mrbt_" + re.sub(r"\W", "_", self._robot)
        bind = bind_message(self._file, self._robot, node)
        pause_s = RESTART_S
        while True:
            self._was_ready = False
            try:
                async with bridge_process(self._command, bridge_environment(self._file)) as pipe:
                    await self._serve_bridge(pipe, bind)
                    self._bridge_ended()
            except OSError as error:
                self._log.error("bridge_not_started", error=str(error))
                self._servers.all_lost(f"the bridge to ROS cannot be started: {error}")
            self._log.warning("bridge_ended")
            pause_s = RESTART_S if self._was_ready else min(2 * pause_s, MAX_RESTART_S)
            await anyio.sleep(pause_s)

    async def _serve_bridge(self, pipe: BridgePipe, bind: dict[str, Any]) -> None:
        """Serve a bridge until it has ended, or has been silent for the detection time."""
        self._last_words, self._all_is_said = "", anyio.Event()
        pipe.say(bind)
        watch = LifeWatch(self._file.detection_s, time.monotonic())
        async with anyio.create_task_group() as group:
            group.start_soon(pipe.send_on)
            group.start_soon(self._beat, pipe, watch, group.cancel_scope)
            group.start_soon(self._log_complaints, pipe)
            async for message in pipe.heard():
                self._take(pipe, message)
                if self._was_ready:
                    watch.heard(time.monotonic())
            with anyio.move_on_after(LAST_WORDS_S):
                await self._all_is_said.wait()
            self._bridge_failure = self._bridge_failure or self._last_words
            group.cancel_scope.cancel()

    async def _beat(self, pipe: BridgePipe, watch: LifeWatch, scope: anyio.CancelScope) -> None:
        """Send a regular message that the bridge answers; stop if the bridge is silent."""
        while True:
            was_there = watch.is_there
            watch.tick(time.monotonic())
            if was_there and not watch.is_there:
                self._log.warning("bridge_silent")
                scope.cancel()
            pipe.say({"op": "beat"})
            await anyio.sleep(self._file.detection_s / BEATS)

    async def _log_complaints(self, pipe: BridgePipe) -> None:
        async for line in pipe.complaints():
            self._log.warning("bridge_said", text=line)
            self._last_words = line.strip() or self._last_words
        self._all_is_said.set()

    def _bridge_ended(self) -> None:
        """Report all servers as lost: no task can be started, and running ones are unreachable."""
        self._pipe = None
        why = f": {self._bridge_failure}" if self._bridge_failure else ""
        self._bridge_failure = ""
        self._servers.all_lost(f"the bridge to ROS has ended{why}")
        self._wake()

    def _ready(self, pipe: BridgePipe) -> None:
        self._log.info("bridge_ready")
        self._was_ready = True
        for number, (name, goal_id) in self._at_servers.items():
            pipe.say({"op": "forget", "task": name, "run": number, "goal_id": goal_id})
        self._pipe = pipe
        for name in self._file.local_tasks:
            self._servers.lost(name, "has not been found")
        for run in self._runs.values():
            if not run.is_sent:
                self._send(run)
            elif run.number in self._at_servers:
                run.is_orphaned = True
            elif run.end is None:
                run.end = {"how": "lost", "text": _BRIDGE_ENDED, "fields": {}}
                run.news.tell()

    def _take(self, pipe: BridgePipe, message: dict[str, Any]) -> None:
        """Process a message of the bridge."""
        match message["op"]:
            case "ready":
                self._ready(pipe)
            case "server":
                if message["is_up"]:
                    self._servers.found(message["task"])
                else:
                    self._servers.lost(message["task"], message["why"])
                self._wake()
            case "feedback":
                self._feedback(message["run"], message["fields"])
            case "ended":
                self._ended(message)
            case "waits":
                self._waits(message["run"], message["text"])
            case "heard":
                self._heard(message["topic"], message["fields"])
            case "failed":
                self._bridge_failure = message["text"]
                self._log.error("bridge_failed", error=message["text"])
            case "checked":
                self._log.error(
                    "bindings_refused", error=str(self._file.unfit(message["problems"]))
                )

    # -- what follows --------------------------------------------------------------------------

    def _wake(self) -> None:
        for run in self._runs.values():
            run.news.tell()

    def _ended(self, message: dict[str, Any]) -> None:
        self._at_servers.pop(message["run"], None)
        run = self._runs.get(message["run"])
        if run is not None:
            # Only messages from now on count for its `until`.
            run.end, run.until = message, None
            if run.is_orphaned and message["how"] == "cancelled":
                run.end = message | {"how": "lost", "text": _BRIDGE_ENDED}
            run.news.tell()

    def _waits(self, number: int, text: str) -> None:
        run = self._runs.get(number)
        if run is not None:
            name = KnownValues(self._values).text(run.binding.name)
            self._log.warning("call_waits", local_task=run.name, service=name, text=text)

    def _feedback(self, number: int, fields: Mapping[str, Any]) -> None:
        run = self._runs.get(number)
        if run is None or run.binding.progress is None:
            return
        try:
            run.task.report_progress(run.binding.progress.number(fields))
        except MessageExpressionError as error:
            self._complain(f"{run.name}/progress", str(error))

    def _heard(self, topic: str, fields: Mapping[str, Any]) -> None:
        kind, _, name = topic.partition("/")
        if kind == "until":
            for run in self._runs.values():
                if run.name == name:
                    run.until = fields
                    run.news.tell()
            return
        assert self._background is not None
        try:
            if kind == "position":
                self._place(fields)
            elif kind == "entry":
                self.entries[name] = self._file.entries[name].expression.entry(fields)
            else:
                found = self._file.conditions[name].expression.truth(fields)
                if self._conditions.get(name) is not found:
                    self._conditions[name] = found
                    ground = KnownValues(self._values).text(name)
                    self._background.set_condition(ground, found)
        except (MessageExpressionError, ValueError) as error:
            self._complain(topic, str(error))

    def _place(self, fields: Mapping[str, Any]) -> None:
        assert self._file.position is not None
        assert self._background is not None
        found = {k: e.number(fields) for k, e in self._file.position.expressions.items()}
        self._background.report_position(found["x"], found["y"], found.get("heading"))
        self.pose = (found["x"], found["y"])

    def _complain(self, place: str, error: str) -> None:
        """Log a value that cannot be used, once per place."""
        if place not in self._refused:
            self._refused.add(place)
            self._log.warning("message_refused", place=place, error=error)
