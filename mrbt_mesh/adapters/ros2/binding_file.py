"""The binding file: maps local tasks and conditions to actions, services and topics of ROS 2.

docs/how-to/ros2.md explains the keys; `mrbt new --ros2` writes one.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import Field, JsonValue, PlainValidator
from pydantic_core import PydanticCustomError

from mrbt_mesh.adapters.binding import (
    BoundFile,
    BoundTask,
    FillError,
    KnownValues,
    Problems,
    Tables,
    load_bound,
    unknown_names,
)
from mrbt_mesh.adapters.ros2.expression import MessageExpression, MessageExpressionError
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import split_call, type_name
from mrbt_mesh.errors import FileError, nearest, whole_file_error
from mrbt_mesh.formats.file_model import FileModel, Name, RobotName
from mrbt_mesh.formats.problems import SourcePath
from mrbt_mesh.formats.tree_model import TREE_EXPLAINED, CallText

# Overrides the file's Python, so that robots and tests can use the same file.
PYTHON_VARIABLE = "MRBT_ROS2_PYTHON"
# The Python for which the packages of a ROS installation are made.
DEFAULT_PYTHON = "/usr/bin/python3"
ROBOT = "robot"

_ROS_NAME = r"^[~/]?[A-Za-z_$][A-Za-z0-9_$/{}]*$"
_TOKEN = r"(?:[A-Za-z_]|\{[a-z]+\})(?:[A-Za-z0-9_]|\{[a-z]+\})*"
_FILLED_NAME = re.compile(rf"/|(~?/)?{_TOKEN}(/{_TOKEN})*|~")
_ROS_TYPE = r"^[a-z][a-z0-9_]*/(action|srv|msg)/[A-Z][A-Za-z0-9]*$"
_MESSAGE_TYPE = _ROS_TYPE.replace("(action|srv|msg)", "msg")
_EXPLAINED = TREE_EXPLAINED | {
    _ROS_NAME: "a name of ROS is expected, e.g. /$robot/navigate_to_pose",
    _ROS_TYPE: "a type of ROS is expected, e.g. nav2_msgs/action/NavigateToPose",
    _MESSAGE_TYPE: "a type of messages is expected, e.g. std_msgs/msg/Bool",
}


def _compiled(value: Any) -> MessageExpression:
    if not isinstance(value, str):
        raise PydanticCustomError("shape", "an expression")
    try:
        return MessageExpression(value)
    except MessageExpressionError as error:
        raise PydanticCustomError("expression", "{text}", {"text": str(error)}) from None


def _truth(value: Any) -> bool | MessageExpression:
    if not isinstance(value, bool | str):
        raise PydanticCustomError("shape", "true, false or an expression")
    return value if isinstance(value, bool) else _compiled(value)


Kind: TypeAlias = Literal["action", "srv", "msg"]
RosName: TypeAlias = Annotated[str, Field(pattern=_ROS_NAME)]
RosType: TypeAlias = Annotated[str, Field(pattern=_ROS_TYPE)]
MessageType: TypeAlias = Annotated[str, Field(pattern=_MESSAGE_TYPE)]
Body: TypeAlias = dict[str, JsonValue]
Expression: TypeAlias = Annotated[MessageExpression, PlainValidator(_compiled)]
Truth: TypeAlias = Annotated[bool | MessageExpression, PlainValidator(_truth)]

# For each kind of server: the key that names it, the kind of its type, the key of its message.
_SERVERS: tuple[tuple[str, Kind, str], ...] = (
    ("action", "action", "goal"),
    ("service", "srv", "request"),
    ("topic", "msg", "message"),
)


LogLevel: TypeAlias = Literal["debug", "info", "warn", "error", "fatal"]


class BridgeBinding(FileModel):
    """Which Python has rclpy, which setup file is sourced before, and what launch files set for a
    node: its namespace, remappings, parameters (also of QoS overrides), its clock, its log level.
    """

    python: str | None = None
    setup: str | None = None
    domain: Annotated[int, Field(ge=0, le=232)] | None = None
    namespace: RosName | None = None
    remap: dict[RosName, RosName] = {}
    use_sim_time: bool = False
    parameters: str | None = None
    log_level: LogLevel | None = None


class ReadTopic(FileModel):
    """A topic whose messages are read. `latched`: also the newest one before."""

    topic: RosName
    type: MessageType
    latched: bool = False

    @property
    def expressions(self) -> dict[str, MessageExpression]:
        """Key in the file -> expression over the messages."""
        return {key: value for key, value in self if isinstance(value, MessageExpression)}


class TopicBinding(ReadTopic):
    """A topic and an expression over its messages."""

    expression: Expression


class PositionBinding(ReadTopic):
    """A topic with the robot's position on the mission's map."""

    x: Expression
    y: Expression
    heading: Expression | None = None


@dataclass(frozen=True)
class FilledBinding:
    """A ground local task: its messages, and the conditions that it sets."""

    body: Any
    on_cancel: Any
    sets: Mapping[str, bool | MessageExpression]


class TaskBinding(BoundTask):
    """A local task: one of `action`, `service` and `topic`, and what its messages mean."""

    action: RosName | None = None
    service: RosName | None = None
    topic: RosName | None = None
    type: RosType
    goal: Body | None = None
    request: Body | None = None
    message: Body | None = None
    progress: Expression | None = None
    success: Expression | None = None
    reason: Expression | None = None
    sets: dict[CallText, Truth] = {}
    within_s: Annotated[float, Field(gt=0)] | None = None
    lifecycle: RosName | None = None
    until: TopicBinding | None = None
    on_cancel: Body | None = None

    @property
    def servers(self) -> list[tuple[str, Kind, str]]:
        """The entries of `_SERVERS` that are given; exactly one in a checked file."""
        return [each for each in _SERVERS if getattr(self, each[0]) is not None]

    @property
    def kind(self) -> Kind:
        """The kind of the task's type."""
        return self.servers[0][1]

    @property
    def name(self) -> str:
        """The server's ROS name, with `$name` not yet replaced."""
        return str(getattr(self, self.servers[0][0]))

    @property
    def body(self) -> Body:
        """The message sent to the server, with `$name` not yet replaced."""
        return getattr(self, self.servers[0][2]) or {}

    def filled(
        self, robot_values: Mapping[str, str], arguments: Sequence[str], tables: Tables
    ) -> FilledBinding:
        """Fill in the arguments of a ground local task. Raises FillError."""
        known = self.known(arguments, robot_values, tables)
        sets = {known.text(name): value for name, value in self.sets.items()}
        return FilledBinding(known.data(self.body), known.data(self.on_cancel), sets)

    def bodies(
        self, place: SourcePath, tables: Tables
    ) -> Iterator[tuple[SourcePath, Body | FillError]]:
        """Yield the task's possible messages, each with its place in the file.

        These are the message as written, and with each value of a table filled in; a FillError
        replaces the message if a value does not fill it.
        """
        written = {self.servers[0][2]: self.body}
        if self.on_cancel is not None:
            written["on_cancel"] = self.on_cancel
        for part, body in written.items():
            yield (*place, part), body
            for name in self.parameters:
                for argument in tables.get(name, {}):
                    where = ("values", name, argument)
                    try:
                        made = KnownValues({name: argument}, tables).data(body)
                    except FillError as error:
                        yield where, error
                    else:
                        if made != body:
                            yield where, made

    def problems(self, robot_names: set[str], tables: Tables, place: SourcePath) -> Problems:
        """Yield the problems of the task beyond the shape of its parts."""
        if len(self.servers) != 1:
            given = " and ".join(key for key, _, _ in self.servers) or "none of them"
            yield place, f"one of action, service and topic is expected, found {given}"
            return
        ((key, kind, body_key),) = self.servers
        package, found, type_name = self.type.split("/")
        if found != kind:
            text = f"{package}/{kind}/{type_name} is expected here, found {self.type}"
            yield (*place, "type"), text
        useless = {"goal", "request", "message"} - {body_key}
        useless |= {"until"} if key == "action" else {"progress"}
        useless |= {"success", "reason"} if key == "topic" else {"on_cancel"}
        article = "an" if key == "action" else "a"
        for other in sorted(useless):
            if getattr(self, other) is not None:
                yield (*place, other), f"of no use for a task that is {article} {key}"
        texts = [name for name, value in self.sets.items() if not isinstance(value, bool)]
        if key == "topic" and texts:
            yield (*place, "sets", texts[0]), "a topic answers nothing: true or false is expected"
        yield from unknown_names({key: self.name, "lifecycle": self.lifecycle}, robot_names, place)
        parts = {body_key: self.body, "on_cancel": self.on_cancel, "sets": self.sets}
        yield from unknown_names(parts, robot_names | set(self.parameters), place, tables)
        for where, body in self.bodies(place, tables):
            if isinstance(body, FillError):
                yield where, str(body)


class BindingFile(BoundFile):
    """A whole file. `robots`: for each robot, the values of `$name`."""

    ROBOTS: ClassVar[str] = "robots"
    bridge: BridgeBinding = BridgeBinding()
    detection_s: Annotated[float, Field(ge=0.2, le=60)] = 1.0
    # The time allowed for servers to be found: DDS and Nav2 need a while.
    start_up_s: Annotated[float, Field(ge=0, le=3_600)] = 20.0
    robots: dict[RobotName, dict[Name, str]] = {}
    values: dict[Name, dict[str, JsonValue]] = {}
    local_tasks: Annotated[dict[Name, TaskBinding], Field(min_length=1)]
    conditions: dict[CallText, TopicBinding] = {}
    entries: dict[Name, TopicBinding] = {}
    position: PositionBinding | None = None

    @property
    def python(self) -> str:
        """The Python that runs the bridge."""
        return self._located(
            os.environ.get(PYTHON_VARIABLE) or self.bridge.python or DEFAULT_PYTHON
        )

    @property
    def setup(self) -> str | None:
        """The setup file that is sourced before the bridge starts."""
        return None if self.bridge.setup is None else str(self._path(self.bridge.setup))

    @property
    def parameters(self) -> str | None:
        """The parameter file of the bridge's node."""
        given = self.bridge.parameters
        return None if given is None else str(self._path(given))

    def ros_arguments(self, robot_values: Mapping[str, str]) -> list[str]:
        """Return the bridge node's arguments after `--ros-args`. Raises FillError."""
        known, bridge = KnownValues(robot_values), self.bridge
        words = [] if bridge.namespace is None else ["-r", f"__ns:={known.text(bridge.namespace)}"]
        for name, other in bridge.remap.items():
            words += ["-r", f"{known.text(name)}:={known.text(other)}"]
        if self.parameters is not None:
            words += ["--params-file", self.parameters]
        if bridge.use_sim_time:
            words += ["-p", "use_sim_time:=true"]
        return words + ([] if bridge.log_level is None else ["--log-level", bridge.log_level])

    def _located(self, text: str) -> str:
        """Return a bare program name unchanged, a path relative to the file's folder."""
        return text if Path(text).parts == (text,) else str(self._path(text))

    def _path(self, text: str) -> Path:
        """Resolve a path relative to the file's folder. Without a home folder, ~ is kept."""
        return Path(self.file).absolute().parent / os.path.expanduser(text)

    def place(self, *path: str) -> str:
        """Return a key's place in the file, for messages."""
        return f"{self.file}:{self._report.line(path)}: {'/'.join(path)}"

    def robot_values(self, robot: str) -> Mapping[str, str]:
        """Return the values of `$name` on this robot. Raises FileError if the robot is missing."""
        if self.robots and robot not in self.robots:
            text = f"robots has no {robot}{nearest(robot, self.robots)}"
            raise whole_file_error(self.file, text)
        return {ROBOT: robot, **self.robots.get(robot, {})}

    def topics(self) -> Iterator[tuple[str, ReadTopic, SourcePath]]:
        """Yield (id, topic, place in the file) for all topics that are read."""
        for name, task in self.local_tasks.items():
            if task.until is not None:
                yield f"until/{name}", task.until, ("local_tasks", name, "until")
        for name, topic in self.conditions.items():
            yield f"condition/{name}", topic, ("conditions", name)
        for name, topic in self.entries.items():
            yield f"entry/{name}", topic, ("entries", name)
        if self.position is not None:
            yield "position", self.position, ("position",)

    def condition_places(self) -> Problems:
        """Yield the place in the file and the name of each condition that is set."""
        yield from ((("conditions", c), c) for c in self.conditions)
        yield from super().condition_places()

    def problems(self) -> Problems:
        """Yield the problems of the file beyond the shape of single parts."""
        names = {ROBOT, *next(iter(self.robots.values()), {})}
        for robot, values in self.robots.items():
            if {ROBOT, *values} != names:
                text = f"all robots have the same keys: {', '.join(sorted(names))}"
                yield ("robots", robot), text
        for name, task in self.local_tasks.items():
            yield from task.problems(names, self.values, ("local_tasks", name))
        yield from self._other_types()
        yield from unknown_names(self.bridge.remap, names, ("bridge", "remap"))
        yield from unknown_names({"namespace": self.bridge.namespace}, names, ("bridge",))
        for key in ("conditions", "entries"):
            for name in getattr(self, key):
                yield from unknown_names(name, names, (key, name))
        for _, topic, place in self.topics():
            yield from unknown_names(topic.topic, names, (*place, "topic"))
        parameters = {p for task in self.local_tasks.values() for p in task.parameters}
        for name, table in self.values.items():
            if name not in parameters:
                text = f"no local task has a parameter {name!r}{nearest(name, parameters)}"
                yield ("values", name), text
            for argument, value in table.items():
                yield from unknown_names(value, names | {name}, ("values", name, argument))

    def ros_names(self) -> Iterator[tuple[SourcePath, str]]:
        """Yield all ROS names, with `$name` not yet replaced, each with its place."""
        for name, task in self.local_tasks.items():
            yield ("local_tasks", name, task.servers[0][0]), task.name
            if task.lifecycle is not None:
                yield ("local_tasks", name, "lifecycle"), task.lifecycle
        for _, topic, place in self.topics():
            yield (*place, "topic"), topic.topic
        if self.bridge.namespace is not None:
            yield ("bridge", "namespace"), self.bridge.namespace
        for name, other in self.bridge.remap.items():
            yield from ((("bridge", "remap", name), each) for each in (name, other))

    def mission_problems(self, mission: Mission, robots: Iterable[str]) -> Problems:
        """Yield what does not fit a mission.

        These are ROS names that are invalid with the names of its robots, arguments without values,
        and time limits of calls that cannot be stopped.
        """
        known = [robot for robot in sorted(robots) if not self.robots or robot in self.robots]
        for place, text in self.ros_names():
            for robot in known:
                name = KnownValues(self.robot_values(robot)).text(text)
                if not _FILLED_NAME.fullmatch(name):
                    yield place, f"{name!r}, for robot {robot}, is not a name of ROS"
                    break
        values = self.robot_values(known[0]) if known else {}
        said = set()
        for ground in mission.local_task_types:
            task = self.local_tasks.get(type_name(ground))
            # Arguments from jobs and the blackboard are not known yet.
            if task is None or "{" in ground or "$" in ground:
                continue
            arguments = split_call(ground)[1]
            if len(task.parameters) != len(arguments):
                continue
            try:
                task.filled(values, arguments, self.values)
            except FillError as error:
                if str(error) not in said:
                    said.add(str(error))
                    yield ("local_tasks", type_name(ground)), f"{ground}: {error}"
        exclusive = {
            type_name(need.local_task)
            for task in mission.all_tasks()
            if task.at_most_once
            for need in task.needs
        }
        for name in sorted(exclusive & self.local_tasks.keys()):
            if self.local_tasks[name].kind != "action" and self.local_tasks[name].within_s:
                text = "an exclusive task needs it, and it goes on after this: leave it out"
                yield ("local_tasks", name, "within_s"), text

    def _other_types(self) -> Problems:
        """Yield names used with two types, which no ROS client can have."""
        used: list[tuple[tuple[str, str], str, SourcePath]] = [
            ((task.kind, task.name), task.type, ("local_tasks", name))
            for name, task in self.local_tasks.items()
            if len(task.servers) == 1
        ]
        used += [(("msg", topic.topic), topic.type, place) for _, topic, place in self.topics()]
        first: dict[tuple[str, str], tuple[str, SourcePath]] = {}
        for key, kind, place in used:
            known, other = first.setdefault(key, (kind, place))
            if known != kind:
                where = "/".join(map(str, other))
                yield (*place, "type"), f"{key[1]} has the type {known} in {where}"

    def unfit(self, problems: list[dict[str, Any]]) -> FileError:
        """Return the problems that the bridge found in the file as a FileError, with lines."""
        report = self.new_report()
        for problem in problems:
            report.add(tuple(problem["place"]), problem["text"])
        try:
            report.raise_if_any()
        except FileError as error:
            return error
        raise ValueError("no problems")


def load_bindings(path: Path) -> BindingFile:
    """Read a binding file. Raises FileError with all problems found."""
    expected = "bindings are expected (local_tasks: ..., conditions: ...)"
    return load_bound(BindingFile, path, expected, _EXPLAINED)


# -- the first message to the bridge ----------------------------------------------------------


def bind_message(file: BindingFile, robot: str | None, node: str = "mrbt") -> dict[str, Any]:
    """Return the first message to the bridge; without a robot, it requests a check only."""
    values = KnownValues({} if robot is None else file.robot_values(robot))
    tasks = []
    for name, task in file.local_tasks.items():
        place: SourcePath = ("local_tasks", name)
        results = {"success": task.success, "reason": task.reason}
        results |= {f"sets/{k}": v for k, v in task.sets.items() if not isinstance(v, bool)}
        bodies = task.bodies(place, file.values) if robot is None else ()
        tasks.append(
            {
                "id": name,
                "kind": task.kind,
                "name": values.text(task.name),
                "type": task.type,
                "type_place": [*place, "type"],
                "lifecycle": task.lifecycle and values.text(task.lifecycle),
                "bodies": [
                    {"place": list(where), "body": body, "is_written": where[0] != "values"}
                    for where, body in bodies
                ],
                "feedback": _fields(place, {"progress": task.progress}),
                "result": _fields(place, results),
            }
        )
    topics = [
        {
            "id": topic_id,
            "name": values.text(topic.topic),
            "type": topic.type,
            "type_place": [*place, "type"],
            "latched": topic.latched,
            # For a condition, changes are enough; an `until` has to hold after the start.
            "always": topic_id.startswith("until/"),
            "fields": _fields(place, topic.expressions),
        }
        for topic_id, topic, place in file.topics()
    ]
    return {
        "detection_s": file.detection_s,
        "node": node,
        "arguments": [] if robot is None else file.ros_arguments(file.robot_values(robot)),
        "check": robot is None,
        "tasks": tasks,
        "topics": topics,
    }


def _fields(place: SourcePath, found: Mapping[str, MessageExpression | None]) -> list[Any]:
    """List each field that the expressions read, with the place of its expression."""
    return [
        [path, [*place, *key.split("/", 1)], *_compared(expression, path)]
        for key, expression in found.items()
        if expression is not None
        for path in expression.fields
    ]


def _compared(expression: MessageExpression, path: str) -> list[str]:
    return [expression.compared[path]] if path in expression.compared else []
