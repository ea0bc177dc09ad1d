"""The binding file: which actions, services and topics of ROS 2 local tasks and conditions are.

docs/how-to/ros2.md explains the keys; `mrbt new --ros2` writes one. `$name` in a text is a robot's
value or a parameter of the local task. A text that is nothing else becomes the value itself: the
value in `values` where the parameter has a table, and `$place.x` a part of it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, JsonValue, PlainValidator, PrivateAttr
from pydantic_core import PydanticCustomError

from mrbt_mesh.adapters.mission_fit import note_misfits, note_missing_robots
from mrbt_mesh.adapters.ros2.expression import MessageExpression, MessageExpressionError
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import FileError, nearest, read_limited, whole_file_error
from mrbt_mesh.formats.file_model import EXPLAINED, FileModel, Name, RobotName, read_model
from mrbt_mesh.formats.mission_file import MAX_YAML_BYTES
from mrbt_mesh.formats.problems import Report, SourcePath
from mrbt_mesh.formats.tree_model import CallText
from mrbt_mesh.formats.yaml_source import decode, read_yaml

# In place of the file's Python, so that one file serves robots and a test.
PYTHON_VARIABLE = "MRBT_ROS2_PYTHON"
# The Python for which the packages of a ROS installation are made.
DEFAULT_PYTHON = "/usr/bin/python3"
ROBOT = "robot"

_ROS_NAME = r"^[~/]?[A-Za-z_$][A-Za-z0-9_$/{}]*$"
_ROS_TYPE = r"^[a-z][a-z0-9_]*/(action|srv|msg)/[A-Z][A-Za-z0-9]*$"
_MESSAGE_TYPE = _ROS_TYPE.replace("(action|srv|msg)", "msg")
_EXPLAINED = EXPLAINED | {
    _ROS_NAME: "a name of ROS is expected, e.g. /$robot/navigate_to_pose",
    _ROS_TYPE: "a type of ROS is expected, e.g. nav2_msgs/action/NavigateToPose",
    _MESSAGE_TYPE: "a type of messages is expected, e.g. std_msgs/msg/Bool",
}
_WHOLE = re.compile(r"\$([A-Za-z_]\w*)((?:\.\w+)*)")


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
Tables: TypeAlias = Mapping[str, Mapping[str, Any]]
RosName: TypeAlias = Annotated[str, Field(pattern=_ROS_NAME)]
RosType: TypeAlias = Annotated[str, Field(pattern=_ROS_TYPE)]
MessageType: TypeAlias = Annotated[str, Field(pattern=_MESSAGE_TYPE)]
Body: TypeAlias = dict[str, JsonValue]
Expression: TypeAlias = Annotated[MessageExpression, PlainValidator(_compiled)]
Truth: TypeAlias = Annotated[bool | MessageExpression, PlainValidator(_truth)]

# The key of a local task that names its server, the kind of its type, the key of its message.
_SERVERS: tuple[tuple[str, Kind, str], ...] = (
    ("action", "action", "goal"),
    ("service", "srv", "request"),
    ("topic", "msg", "message"),
)


class BridgeBinding(FileModel):
    """Which Python has rclpy, and which setup file is sourced before."""

    python: str | None = None
    setup: str | None = None
    domain: Annotated[int, Field(ge=0, le=232)] | None = None


class TopicBinding(FileModel):
    """A topic and an expression over its messages. `latched`: also the newest one before."""

    topic: RosName
    type: MessageType
    expression: Expression
    latched: bool = False

    @property
    def expressions(self) -> Mapping[str, MessageExpression]:
        """Key in the file -> expression."""
        return {"expression": self.expression}


class PositionBinding(FileModel):
    """A topic with the robot's position on the mission's map."""

    topic: RosName
    type: MessageType
    x: Expression
    y: Expression
    heading: Expression | None = None
    latched: bool = False

    @property
    def expressions(self) -> Mapping[str, MessageExpression]:
        """Key in the file -> expression."""
        found = {"x": self.x, "y": self.y}
        return found if self.heading is None else {**found, "heading": self.heading}


class TaskBinding(FileModel):
    """A local task: one of `action`, `service` and `topic`, and what its messages mean."""

    parameters: list[Name] = []
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
        """Of `_SERVERS` those that are given; exactly one once the file is checked."""
        return [each for each in _SERVERS if getattr(self, each[0]) is not None]

    @property
    def kind(self) -> Kind:
        """The kind of its type."""
        return self.servers[0][1]

    @property
    def name(self) -> str:
        """The server's name in ROS, with `$name`."""
        return str(getattr(self, self.servers[0][0]))

    @property
    def body(self) -> Body:
        """The message that is sent to it, with `$name`."""
        return getattr(self, self.servers[0][2]) or {}


class BindingFile(FileModel):
    """A whole file. `robots`: for each robot, the values of `$name`."""

    bridge: BridgeBinding = BridgeBinding()
    detection_s: Annotated[float, Field(ge=0.2, le=60)] = 1.0
    # By then a server has to be found: DDS and Nav2 take a while.
    start_up_s: Annotated[float, Field(ge=0, le=3_600)] = 20.0
    robots: dict[RobotName, dict[Name, str]] = {}
    values: dict[Name, dict[str, JsonValue]] = {}
    local_tasks: Annotated[dict[Name, TaskBinding], Field(min_length=1)]
    conditions: dict[CallText, TopicBinding] = {}
    entries: dict[Name, TopicBinding] = {}
    position: PositionBinding | None = None
    _report: Report = PrivateAttr()

    @property
    def file(self) -> str:
        """The file's path as it was given."""
        return self._report.file

    @property
    def python(self) -> str:
        """The Python that runs the bridge."""
        return self._located(
            os.environ.get(PYTHON_VARIABLE) or self.bridge.python or DEFAULT_PYTHON
        )

    @property
    def setup(self) -> str | None:
        """The file that is sourced before."""
        return None if self.bridge.setup is None else self._located(self.bridge.setup)

    def _located(self, text: str) -> str:
        """A program of the search path as it is; a path, from the file's folder."""
        path = Path(text).expanduser()
        return text if path.parts == (text,) else str(Path(self.file).absolute().parent / path)

    def place(self, *path: str) -> str:
        """A key's place in the file, for messages."""
        return f"{self.file}:{self._report.line(path)}: {'/'.join(path)}"

    def robot_values(self, robot: str) -> Mapping[str, str]:
        """The values of `$name` on this robot. Raises FileError if the file lacks it."""
        if self.robots and robot not in self.robots:
            text = f"robots has no {robot}{nearest(robot, self.robots)}"
            raise whole_file_error(self.file, text)
        return {ROBOT: robot, **self.robots.get(robot, {})}

    def check_mission(self, mission: Mission, robots: Collection[str]) -> None:
        """Raise FileError if it does not fit a mission and the robots that take part."""
        report = Report(self.file, self._report.lines)
        tasks = {name: task.parameters for name, task in self.local_tasks.items()}
        set_: list[tuple[SourcePath, str]] = [(("conditions", c), c) for c in self.conditions]
        for name, task in self.local_tasks.items():
            set_ += [(("local_tasks", name, "sets", c), c) for c in task.sets]
        note_misfits(report, mission, tasks, set_)
        if self.robots:
            note_missing_robots(report, "robots", self.robots, robots)
        report.raise_if_any()

    def unfit(self, problems: list[dict[str, Any]]) -> FileError:
        """The problems that the bridge has found in the file, with their lines."""
        report = Report(self.file, self._report.lines)
        for problem in problems:
            report.add(tuple(problem["place"]), problem["text"])
        try:
            report.raise_if_any()
        except FileError as error:
            return error
        raise ValueError("no problems")


def load_bindings(path: Path) -> BindingFile:
    """Read a binding file. Raises FileError with all problems that could be found."""
    file = str(path)
    data, report = read_yaml(decode(read_limited(path, MAX_YAML_BYTES), file), file)
    if not isinstance(data, dict):
        raise whole_file_error(file, "bindings are expected (local_tasks: ..., conditions: ...)")
    found = read_model(BindingFile, data, report, _EXPLAINED)
    for place, text in _problems(found):
        report.add(place, text)
    report.raise_if_any()
    found._report = report
    return found


def _problems(file: BindingFile) -> Iterator[tuple[SourcePath, str]]:
    """What is wrong beyond the shape of single parts."""
    names = {ROBOT, *next(iter(file.robots.values()), {})}
    for robot, values in file.robots.items():
        if {ROBOT, *values} != names:
            yield ("robots", robot), f"all robots have the same keys: {', '.join(sorted(names))}"
    for name, task in file.local_tasks.items():
        yield from _task_problems(task, names, file.values, ("local_tasks", name))
    for key, topics in (("conditions", file.conditions), ("entries", file.entries)):
        for name, topic in topics.items():
            yield from _unknown_names(name, names, (key, name))
            yield from _unknown_names(topic.topic, names, (key, name, "topic"))
    if file.position is not None:
        yield from _unknown_names(file.position.topic, names, ("position", "topic"))
    parameters = {p for task in file.local_tasks.values() for p in task.parameters}
    for name in file.values:
        if name not in parameters:
            text = f"no local task has a parameter {name!r}{nearest(name, parameters)}"
            yield ("values", name), text


def _task_problems(
    task: TaskBinding, robot_names: set[str], tables: Tables, place: SourcePath
) -> Iterator[tuple[SourcePath, str]]:
    if len(task.servers) != 1:
        given = " and ".join(key for key, _, _ in task.servers) or "none of them"
        yield place, f"one of action, service and topic is expected, found {given}"
        return
    ((key, kind, body_key),) = task.servers
    package, found, type_name = task.type.split("/")
    if found != kind:
        text = f"{package}/{kind}/{type_name} is expected here, found {task.type}"
        yield (*place, "type"), text
    useless = {"goal", "request", "message"} - {body_key}
    useless |= {"until"} if key == "action" else {"progress"}
    useless |= {"success", "reason"} if key == "topic" else {"on_cancel"}
    article = "an" if key == "action" else "a"
    for other in sorted(useless):
        if getattr(task, other) is not None:
            yield (*place, other), f"of no use for a task that is {article} {key}"
    texts = [name for name, value in task.sets.items() if not isinstance(value, bool)]
    if key == "topic" and texts:
        yield (*place, "sets", texts[0]), "a topic answers nothing: true or false is expected"
    yield from _unknown_names(task.name, robot_names, (*place, key))
    yield from _unknown_names(task.lifecycle, robot_names, (*place, "lifecycle"))
    if task.until is not None:
        yield from _unknown_names(task.until.topic, robot_names, (*place, "until", "topic"))
    names = robot_names | set(task.parameters)
    for part, data in ((body_key, task.body), ("on_cancel", task.on_cancel), ("sets", task.sets)):
        yield from _unknown_names(data, names, (*place, part))
    yield from lacking_parts(task, tables)


def _unknown_names(
    data: Any, names: set[str], place: SourcePath
) -> Iterator[tuple[SourcePath, str]]:
    """Each `$name` in it without a value."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from _unknown_names(key, names, (*place, key))
            yield from _unknown_names(value, names, (*place, key))
    elif isinstance(data, list):
        for index, value in enumerate(data):
            yield from _unknown_names(value, names, (*place, index))
    elif isinstance(data, str):
        for name in Template(data).get_identifiers():
            if name not in names:
                yield place, f"unknown ${name}{nearest(name, names)}"


# -- a ground local task ----------------------------------------------------------------------


class FillError(Exception):
    """A task's arguments do not make a message; the text has the reason."""


@dataclass(frozen=True)
class KnownValues:
    """The values of `$name`: robots' values, arguments, and the tables of their meanings."""

    values: Mapping[str, str]
    tables: Tables

    def text(self, text: str) -> str:
        """A text with values in it."""
        return Template(text).safe_substitute(self.values)

    def data(self, data: Any) -> Any:
        """Plain data with values in it; what is not known keeps its `$`. Raises FillError."""
        if isinstance(data, str):
            whole = _WHOLE.fullmatch(data)
            return self._whole(whole[1], whole[2], data) if whole else self.text(data)
        if isinstance(data, Mapping):
            return {key: self.data(value) for key, value in data.items()}
        if isinstance(data, list):
            return [self.data(value) for value in data]
        return data

    def _whole(self, name: str, path: str, text: str) -> Any:
        if name not in self.values:
            return text
        argument = self.values[name]
        table = self.tables.get(name)
        if table is None:
            if path:
                raise FillError(f"{text}: values has no table for {name}")
            return argument
        if argument not in table:
            raise FillError(f"values/{name} has no {argument!r}{nearest(argument, table)}")
        value = table[argument]
        for key in path.split(".")[1:]:
            if not isinstance(value, Mapping) or key not in value:
                known = value if isinstance(value, Mapping) else ()
                raise FillError(f"{text}: {argument} has no {key!r}{nearest(key, known)}")
            value = value[key]
        return value


@dataclass(frozen=True)
class FilledBinding:
    """A ground local task: the message, and the conditions that it sets."""

    body: Any
    on_cancel: Any
    sets: Mapping[str, bool | MessageExpression]


def filled(
    binding: TaskBinding, robot_values: Mapping[str, str], arguments: Sequence[str], tables: Tables
) -> FilledBinding:
    """What a ground local task is in ROS. Raises FillError."""
    if len(arguments) != len(binding.parameters):
        wanted = ", ".join(binding.parameters) or "none"
        raise FillError(f"the binding has other parameters: {wanted}")
    values = {**robot_values, **dict(zip(binding.parameters, arguments, strict=True))}
    known = KnownValues(values, tables)
    sets = {known.text(name): value for name, value in binding.sets.items()}
    return FilledBinding(known.data(binding.body), known.data(binding.on_cancel), sets)


def bodies_to_check(
    binding: TaskBinding, place: SourcePath, tables: Tables
) -> list[tuple[SourcePath, Any]]:
    """The messages that a binding may become, each with its place in the file.

    As written, and with each value of a table in turn; `lacking_parts` has found nothing.
    """
    written = {binding.servers[0][2]: binding.body}
    if binding.on_cancel is not None:
        written["on_cancel"] = binding.on_cancel
    found: list[tuple[SourcePath, Any]] = []
    for part, body in written.items():
        found.append(((*place, part), body))
        for name in binding.parameters:
            for argument in tables.get(name, {}):
                made = KnownValues({name: argument}, tables).data(body)
                if made != body:
                    found.append((("values", name, argument), made))
    return found


def lacking_parts(binding: TaskBinding, tables: Tables) -> list[tuple[SourcePath, str]]:
    """What the message asks of tables that they do not have: where, and a message."""
    found: list[tuple[SourcePath, str]] = []
    for name in binding.parameters:
        for argument in tables.get(name, {}):
            try:
                KnownValues({name: argument}, tables).data([binding.body, binding.on_cancel])
            except FillError as error:
                found.append((("values", name, argument), str(error)))
    return found


# -- what the bridge gets ---------------------------------------------------------------------


def bind_message(file: BindingFile, robot: str | None, node: str = "mrbt") -> dict[str, Any]:
    """The first message to the bridge; without a robot, for a check only."""
    values = KnownValues({} if robot is None else file.robot_values(robot), {})
    tasks: list[dict[str, Any]] = []
    topics: list[dict[str, Any]] = []

    def listen(
        topic_id: str, topic: TopicBinding | PositionBinding, place: SourcePath, always: bool
    ) -> None:
        topics.append(
            {
                "id": topic_id,
                "name": values.text(topic.topic),
                "type": topic.type,
                "type_place": [*place, "type"],
                "latched": topic.latched,
                # Of a condition changes are enough; what is waited for has to come after the start.
                "always": always,
                "fields": _fields(place, topic.expressions),
            }
        )

    for name, task in file.local_tasks.items():
        place: SourcePath = ("local_tasks", name)
        results = {"success": task.success, "reason": task.reason}
        results |= {f"sets/{k}": v for k, v in task.sets.items() if not isinstance(v, bool)}
        bodies = bodies_to_check(task, place, file.values) if robot is None else []
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
        if task.until is not None:
            listen(f"until/{name}", task.until, (*place, "until"), True)
    for name, topic in file.conditions.items():
        listen(f"condition/{name}", topic, ("conditions", name), False)
    for name, topic in file.entries.items():
        listen(f"entry/{name}", topic, ("entries", name), False)
    if file.position is not None:
        listen("position", file.position, ("position",), False)
    return {
        "detection_s": file.detection_s,
        "node": node,
        "check": robot is None,
        "tasks": tasks,
        "topics": topics,
    }


def _fields(place: SourcePath, found: Mapping[str, MessageExpression | None]) -> list[Any]:
    """Each field that the expressions read, with the place of its expression."""
    return [
        [path, [*place, *key.split("/", 1)]]
        for key, expression in found.items()
        if expression is not None
        for path in expression.fields
    ]
