"""The binding file: which actions, services and topics of ROS 2 local tasks and conditions are.

docs/ros2.md explains the keys; `mrbt new --ros2` writes one.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Annotated, Any, TypeAlias

from pydantic import Field, JsonValue

from mrbt_mesh.adapters.mission_fit import note_misfits, note_missing_robots
from mrbt_mesh.adapters.ros2.bindings import (
    Kind,
    TaskBinding,
    TopicBinding,
    bodies_to_check,
    lacking_parts,
)
from mrbt_mesh.adapters.ros2.expression import MessageExpression, MessageExpressionError
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import FileError, nearest, read_limited, whole_file_error
from mrbt_mesh.formats.file_model import EXPLAINED, FileModel, Name, RobotName, one_of, read_model
from mrbt_mesh.formats.mission_file import MAX_YAML_BYTES
from mrbt_mesh.formats.problems import Report, SourcePath
from mrbt_mesh.formats.tree_model import CallText
from mrbt_mesh.formats.yaml_source import decode, read_yaml

# So long, if the file says nothing else, a server is not there yet: DDS and Nav2 take a while.
START_UP_S = 20.0

# In place of the file's Python, so that one file serves robots and a test.
PYTHON_VARIABLE = "MRBT_ROS2_PYTHON"
# Where the packages of a ROS installation are for.
DEFAULT_PYTHON = "/usr/bin/python3"
ROBOT = "robot"

_ROS_NAME = r"^[~/]?[A-Za-z_$][A-Za-z0-9_$/{}]*$"
_ROS_TYPE = r"^[a-z][a-z0-9_]*/(action|srv|msg)/[A-Z][A-Za-z0-9]*$"
_EXPLAINED = EXPLAINED | {
    _ROS_NAME: "a name of ROS is expected, e.g. /$robot/navigate_to_pose",
    _ROS_TYPE: "a type of ROS is expected, e.g. nav2_msgs/action/NavigateToPose",
}

RosName: TypeAlias = Annotated[str, Field(pattern=_ROS_NAME)]
RosType: TypeAlias = Annotated[str, Field(pattern=_ROS_TYPE)]
Seconds: TypeAlias = Annotated[float, Field(gt=0)]
Body: TypeAlias = dict[str, JsonValue]
Truth: TypeAlias = Annotated[
    Any, one_of("true, false or an expression", lambda value: isinstance(value, bool | str))
]
Bindings: TypeAlias = dict[str, Any]


class BridgeModel(FileModel):
    """Which Python has rclpy, and which setup files are sourced before."""

    python: str | None = None
    setup: str | None = None
    domain: Annotated[int, Field(ge=0, le=232)] | None = None


class ReadTopicModel(FileModel):
    """A topic and an expression over its messages."""

    topic: RosName
    type: RosType
    expression: str
    latched: bool = False


class PositionModel(FileModel):
    """A topic that says where the robot is, on the mission's map."""

    topic: RosName
    type: RosType
    x: str
    y: str
    heading: str | None = None
    latched: bool = False


class Ros2TaskModel(FileModel):
    """A local task: one of `action`, `service` and `topic`, and what belongs to it."""

    parameters: list[Name] = []
    action: RosName | None = None
    service: RosName | None = None
    topic: RosName | None = None
    type: RosType
    goal: Body | None = None
    request: Body | None = None
    message: Body | None = None
    progress: str | None = None
    success: str | None = None
    reason: str | None = None
    sets: dict[CallText, Truth] = {}
    within_s: Seconds | None = None
    lifecycle: RosName | None = None
    until: ReadTopicModel | None = None
    on_cancel: Body | None = None


class BindingFileModel(FileModel):
    """The whole file."""

    bridge: BridgeModel = BridgeModel()
    detection_s: Annotated[float, Field(ge=0.2, le=60)] = 1.0
    start_up_s: Annotated[float, Field(ge=0, le=3_600)] = START_UP_S
    robots: dict[RobotName, dict[Name, str]] = {}
    values: dict[Name, dict[str, JsonValue]] = {}
    local_tasks: Annotated[dict[Name, Ros2TaskModel], Field(min_length=1)]
    conditions: dict[CallText, ReadTopicModel] = {}
    entries: dict[Name, ReadTopicModel] = {}
    position: PositionModel | None = None


@dataclass(frozen=True)
class BindingFile:
    """A binding file that has been read. `robots`: per robot, what `$name` stands for."""

    file: str
    report: Report
    python: str
    setup: str | None
    domain: int | None
    detection_s: float
    start_up_s: float
    robots: Mapping[str, Mapping[str, str]]
    values: Mapping[str, Mapping[str, Any]]
    tasks: Mapping[str, TaskBinding]
    conditions: Mapping[str, TopicBinding]
    entries: Mapping[str, TopicBinding]
    position: TopicBinding | None

    def robot_values(self, robot: str) -> Mapping[str, str]:
        """What `$name` stands for on this robot. Raises FileError if the file lacks it."""
        if self.robots and robot not in self.robots:
            text = f"robots has no {robot}{nearest(robot, self.robots)}"
            raise whole_file_error(self.file, text)
        return {ROBOT: robot, **self.robots.get(robot, {})}

    def check_mission(self, mission: Mission, robots: Collection[str]) -> None:
        """Raise FileError if it does not fit a mission and the robots that take part."""
        report = Report(self.file, self.report.lines)
        tasks = {name: task.parameters for name, task in self.tasks.items()}
        told: list[tuple[SourcePath, str]] = [(("conditions", c), c) for c in self.conditions]
        for name, task in self.tasks.items():
            told += [(("local_tasks", name, "sets", c), c) for c in task.sets]
        note_misfits(report, mission, tasks, told)
        if self.robots:
            note_missing_robots(report, "robots", self.robots, robots)
        report.raise_if_any()

    def told(self, problems: list[dict[str, Any]]) -> FileError:
        """What the bridge has found in the file, with the lines."""
        report = Report(self.file, self.report.lines)
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
    model = read_model(BindingFileModel, data, report, _EXPLAINED)
    return _Reader(model, path, report).file()


class _Reader:
    def __init__(self, model: BindingFileModel, path: Path, report: Report) -> None:
        self.model, self.path, self.report = model, path, report
        first: Mapping[str, str] = next(iter(model.robots.values()), {})
        self.robot_names = {ROBOT, *first}

    def file(self) -> BindingFile:
        model = self.model
        for robot, values in model.robots.items():
            if {ROBOT, *values} != self.robot_names:
                text = f"all robots have the same keys: {', '.join(sorted(self.robot_names))}"
                self.report.add(("robots", robot), text)
        tasks = {name: self.task(name, task) for name, task in model.local_tasks.items()}
        conditions = {
            name: self.topic(each, {"": each.expression}, ("conditions", name))
            for name, each in model.conditions.items()
        }
        entries = {
            name: self.topic(each, {"": each.expression}, ("entries", name))
            for name, each in model.entries.items()
        }
        for name in model.conditions:
            self.known_names(name, self.robot_names, ("conditions", name))
        position = model.position
        bound = None if position is None else self.position(position)
        for task in tasks.values():
            for place, text in lacking_parts(task, model.values) if task is not None else ():
                self.report.add(place, text)
        parameters = {p for each in model.local_tasks.values() for p in each.parameters}
        for name in model.values:
            if name not in parameters:
                text = f"no local task has a parameter {name!r}{nearest(name, parameters)}"
                self.report.add(("values", name), text)
        self.report.raise_if_any()
        return BindingFile(
            str(self.path),
            self.report,
            self.python(),
            None if model.bridge.setup is None else self.located(model.bridge.setup),
            model.bridge.domain,
            model.detection_s,
            model.start_up_s,
            model.robots,
            model.values,
            {name: task for name, task in tasks.items() if task is not None},
            conditions,
            entries,
            bound,
        )

    def python(self) -> str:
        return self.located(
            os.environ.get(PYTHON_VARIABLE) or self.model.bridge.python or DEFAULT_PYTHON
        )

    def located(self, text: str) -> str:
        """A program of the search path as it is; a path, from the file's folder."""
        path = Path(text).expanduser()
        return text if path.parts == (text,) else str(self.path.absolute().parent / path)

    def task(self, name: str, task: Ros2TaskModel) -> TaskBinding | None:
        place: SourcePath = ("local_tasks", name)
        bodies: dict[str, tuple[str, Kind, Body | None]] = {
            "action": ("goal", "action", task.goal),
            "service": ("request", "srv", task.request),
            "topic": ("message", "msg", task.message),
        }
        given = [key for key in bodies if getattr(task, key) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none of them"
            self.report.add(place, f"one of action, service and topic is expected, found {found}")
            return None
        body_key, kind, body = bodies[given[0]]
        self.only_its_own(task, given[0], body_key, place)
        self.kind_fits(task.type, kind, (*place, "type"))
        ros_name = getattr(task, given[0])
        self.known_names(ros_name, self.robot_names, (*place, given[0]))
        self.known_names(task.lifecycle, self.robot_names, (*place, "lifecycle"))
        names = self.robot_names | set(task.parameters)
        for key, data in ((body_key, body), ("on_cancel", task.on_cancel), ("sets", task.sets)):
            self.known_names(data, names, (*place, key))
        sets = {
            condition: value
            if isinstance(value, bool)
            else self.expression(value, (*place, "sets", condition))
            for condition, value in task.sets.items()
        }
        until = task.until
        return TaskBinding(
            kind,
            ros_name,
            task.type,
            tuple(task.parameters),
            body or {},
            self.expression(task.progress, (*place, "progress")),
            self.expression(task.success, (*place, "success")),
            self.expression(task.reason, (*place, "reason")),
            {key: value for key, value in sets.items() if value is not None},
            task.within_s,
            task.lifecycle,
            None if until is None else self.topic(until, {"": until.expression}, (*place, "until")),
            task.on_cancel,
        )

    def only_its_own(self, task: Ros2TaskModel, key: str, body_key: str, place: SourcePath) -> None:
        """What says nothing about this kind of task is a mistake."""
        others = {"goal", "request", "message"} - {body_key}
        if key != "action":
            others.add("progress")
        else:
            others.add("until")
        if key != "topic":
            others.add("on_cancel")
        else:
            others |= {"success", "reason"}
        for other in sorted(others):
            if getattr(task, other) is not None:
                self.report.add((*place, other), f"of no use for a task that is {_a(key)}")
        texts = [name for name, value in task.sets.items() if isinstance(value, str)]
        if key == "topic" and texts:
            text = "a topic answers nothing: true or false is expected"
            self.report.add((*place, "sets", texts[0]), text)

    def topic(
        self, model: ReadTopicModel | PositionModel, texts: Mapping[str, str], place: SourcePath
    ) -> TopicBinding:
        self.kind_fits(model.type, "msg", (*place, "type"))
        self.known_names(model.topic, self.robot_names, (*place, "topic"))
        made = {k: self.expression(t, (*place, k or "expression")) for k, t in texts.items()}
        expressions = {key: value for key, value in made.items() if value is not None}
        return TopicBinding(model.topic, model.type, expressions, model.latched)

    def position(self, model: PositionModel) -> TopicBinding:
        texts = {"x": model.x, "y": model.y}
        if model.heading is not None:
            texts["heading"] = model.heading
        return self.topic(model, texts, ("position",))

    def expression(self, text: str | None, place: SourcePath) -> MessageExpression | None:
        if text is None:
            return None
        try:
            return MessageExpression(text)
        except MessageExpressionError as error:
            self.report.add(place, str(error))
            return None

    def kind_fits(self, type_name: str, kind: Kind, place: SourcePath) -> None:
        package, found, name = type_name.split("/")
        if found != kind:
            self.report.add(place, f"{package}/{kind}/{name} is expected here, found {type_name}")

    def known_names(self, data: Any, names: set[str], place: SourcePath) -> None:
        """Whether all `$name` in it are there."""
        if isinstance(data, Mapping):
            for key, value in data.items():
                self.known_names(key, names, (*place, key))
                self.known_names(value, names, (*place, key))
        elif isinstance(data, list):
            for index, value in enumerate(data):
                self.known_names(value, names, (*place, index))
        elif isinstance(data, str):
            for name in Template(data).get_identifiers():
                if name not in names:
                    self.report.add(place, f"unknown ${name}{nearest(name, names)}")


def bind_message(file: BindingFile, robot: str | None, node: str = "mrbt") -> Bindings:
    """What the bridge is told first; without a robot, to be checked only."""
    values = {} if robot is None else file.robot_values(robot)

    def named(text: str | None) -> str | None:
        return text and Template(text).safe_substitute(values)

    tasks, topics = [], []
    for name, task in file.tasks.items():
        place: SourcePath = ("local_tasks", name)
        results = {"success": task.success, "reason": task.reason}
        results |= {f"sets/{k}": v for k, v in task.sets.items() if not isinstance(v, bool)}
        bodies = bodies_to_check(task, place, file.values) if robot is None else []
        tasks.append(
            {
                "id": name,
                "kind": task.kind,
                "name": named(task.name),
                "type": task.type,
                "type_place": [*place, "type"],
                "lifecycle": named(task.lifecycle),
                "bodies": [
                    {"place": list(where), "body": body, "is_written": where[0] != "values"}
                    for where, body in bodies
                ],
                "feedback": _fields(place, {"progress": task.progress}),
                "result": _fields(place, results),
            }
        )
        if task.until is not None:
            topics.append(_topic(f"until/{name}", task.until, (*place, "until"), named))
    for name, topic in file.conditions.items():
        topics.append(_topic(f"condition/{name}", topic, ("conditions", name), named))
    for name, topic in file.entries.items():
        topics.append(_topic(f"entry/{name}", topic, ("entries", name), named))
    if file.position is not None:
        topics.append(_topic("position", file.position, ("position",), named))
    return {
        "detection_s": file.detection_s,
        "node": node,
        "check": robot is None,
        "tasks": tasks,
        "topics": topics,
    }


def _topic(name: str, topic: TopicBinding, place: SourcePath, named: Any) -> dict[str, Any]:
    texts = {key or "expression": each for key, each in topic.expressions.items()}
    return {
        "id": name,
        "name": named(topic.topic),
        "type": topic.type,
        "type_place": [*place, "type"],
        "latched": topic.latched,
        # Of a condition what has changed is enough; what is waited for has to come after the start.
        "always": name.startswith("until/"),
        "fields": _fields(place, texts),
    }


def _fields(place: SourcePath, found: Mapping[str, MessageExpression | None]) -> list[Any]:
    return [
        [path, [*place, *key.split("/", 1)]]
        for key, expression in found.items()
        if expression is not None
        for path in expression.fields
    ]


def _a(key: str) -> str:
    return f"an {key}" if key == "action" else f"a {key}"
