"""The layout file: a plant's nodes and edges, the vehicles, and what local tasks are for them.

docs/how-to/vda5050.md explains the keys, examples/warehouse/agvs.yaml is one.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from mrbt_mesh.adapters.mission_fit import note_misfits, note_missing_robots
from mrbt_mesh.adapters.vda5050.dialects import DIALECTS, VehicleAddress
from mrbt_mesh.adapters.vda5050.layout import Layout, LayoutNode, TaskTemplate
from mrbt_mesh.adapters.vda5050.vehicle import Battery
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError, nearest, read_limited, whole_file_error
from mrbt_mesh.formats.file_model import EXPLAINED, FileModel, Name, RobotName, read_model
from mrbt_mesh.formats.mission_file import MAX_YAML_BYTES
from mrbt_mesh.formats.problems import Report, SourcePath
from mrbt_mesh.formats.yaml_source import decode, read_yaml

# `host:port` in place of the file's broker, so that one file serves a plant and a test.
BROKER_VARIABLE = "MRBT_VDA5050_BROKER"

_LEVEL = r"^[^/+#\s][^/+#]{0,63}$"
_EXPLAINED = EXPLAINED | {
    _LEVEL: "a part of an MQTT topic is expected: 1 to 64 characters without /, + and #"
}

Level: TypeAlias = Annotated[str, Field(pattern=_LEVEL)]
NodeName: TypeAlias = Annotated[str, Field(min_length=1, max_length=64)]
DialectName: TypeAlias = Literal["1.1", "2.0", "2.1", "3.0"]
Coordinates: TypeAlias = Annotated[list[float], Field(min_length=2, max_length=3)]


class BrokerModel(FileModel):
    """Where the vehicles' broker is. The password comes from an environment variable."""

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535)] = 1883
    tls: bool = False
    username: str | None = None
    password_variable: str | None = None
    keepalive_s: Annotated[int, Field(ge=1, le=600)] = 5


class EdgeModel(FileModel):
    """A way between two nodes; `max_speed` in m/s."""

    start: NodeName = Field(alias="from")
    end: NodeName = Field(alias="to")
    both_ways: bool = True
    max_speed: Annotated[float, Field(gt=0)] | None = None


class VehicleModel(FileModel):
    """A robot's vehicle. Without a serial number it is the robot's name."""

    manufacturer: Level
    serial_number: Level | None = None
    dialect: DialectName | None = None


class LayoutFileModel(FileModel):
    """The whole file."""

    broker: BrokerModel = BrokerModel()
    interface: Level = "uagv"
    dialect: DialectName = "2.0"
    map: str
    nodes: Annotated[dict[NodeName, Coordinates], Field(min_length=1, max_length=10_000)]
    edges: list[EdgeModel] = []
    reach_m: Annotated[float, Field(gt=0)] = 2.0
    vehicles: Annotated[dict[RobotName, VehicleModel], Field(min_length=1)]
    local_tasks: Annotated[dict[Name, TaskTemplate], Field(min_length=1)]
    battery: Battery = Battery()
    errors: dict[str, list[Name]] = {}


@dataclass(frozen=True)
class Broker:
    """How the broker is reached. `keepalive_s`: how soon it notices a lost client."""

    host: str
    port: int
    tls: bool
    username: str | None
    password: str | None
    keepalive_s: int


@dataclass(frozen=True)
class LayoutFile:
    """A layout file that has been read. `errors`: which local tasks an error type prevents."""

    file: str
    broker: Broker
    layout: Layout
    vehicles: Mapping[str, VehicleAddress]
    tasks: Mapping[str, TaskTemplate]
    battery: Battery
    errors: Mapping[str, list[str]]
    report: Report

    def check_mission(self, mission: Mission, robots: Collection[str]) -> None:
        """Raise FileError if it does not fit a mission and the robots that take part."""
        report = Report(self.file, self.report.lines)
        tasks = {name: task.parameters for name, task in self.tasks.items()}
        sets: list[tuple[SourcePath, str]] = [
            (("local_tasks", name, "sets", c), c) for name, t in self.tasks.items() for c in t.sets
        ]
        note_misfits(report, mission, tasks, sets)
        note_missing_robots(report, "vehicles", self.vehicles, robots)
        report.raise_if_any()


def load_layout(path: Path) -> LayoutFile:
    """Read a layout file. Raises FileError with all problems that could be found."""
    file = str(path)
    data, report = read_yaml(decode(read_limited(path, MAX_YAML_BYTES), file), file)
    if not isinstance(data, dict):
        raise whole_file_error(file, "a layout is expected (nodes: ..., vehicles: ...)")
    model = read_model(LayoutFileModel, data, report, _EXPLAINED)
    _check(model, report)
    report.raise_if_any()
    return LayoutFile(
        file,
        _broker(model.broker, file),
        _layout(model),
        {robot: _address(model, robot) for robot in model.vehicles},
        model.local_tasks,
        model.battery,
        model.errors,
        report,
    )


def _check(model: LayoutFileModel, report: Report) -> None:
    for index, edge in enumerate(model.edges):
        for key, name in (("from", edge.start), ("to", edge.end)):
            _known_node(model, name, ("edges", index, key), report)
        if edge.start == edge.end:
            report.add(("edges", index), f"an edge leads to another node, not back to {edge.end}")
    seen: dict[tuple[str, str], str] = {}
    for robot in model.vehicles:
        address = _address(model, robot)
        other = seen.setdefault((address.manufacturer, address.serial_number), robot)
        if other != robot:
            report.add(("vehicles", robot), f"is the same vehicle as {other}")
    for name, task in model.local_tasks.items():
        _check_task(model, name, task, report)
    for kind, names in model.errors.items():
        for index, name in enumerate(names):
            if name not in model.local_tasks:
                hint = nearest(name, model.local_tasks)
                report.add(("errors", kind, index), f"unknown local task {name!r}{hint}")
    if model.battery.enough_percent < model.battery.low_percent:
        report.add(("battery",), "enough_percent is less than low_percent")


def _check_task(model: LayoutFileModel, name: str, task: TaskTemplate, report: Report) -> None:
    for index, stop in enumerate(task.stops):
        place = ("local_tasks", name, "stops", index)
        if "$" not in stop.at:
            _known_node(model, stop.at, (*place, "at"), report)
        texts = [stop.at]
        for action in stop.actions:
            texts += [action.type, *(v for v in action.parameters.values() if type(v) is str)]
        for text in texts:
            _known_parameters(task, text, place, report)
    for text in task.sets:
        _known_parameters(task, text, ("local_tasks", name, "sets", text), report)


def _known_parameters(
    task: TaskTemplate, text: str, place: tuple[str | int, ...], report: Report
) -> None:
    for parameter in Template(text).get_identifiers():
        if parameter not in task.parameters:
            message = f"unknown parameter ${parameter}{nearest(parameter, task.parameters)}"
            report.add(place, message)


def _known_node(
    model: LayoutFileModel, name: str, place: tuple[str | int, ...], report: Report
) -> None:
    if name not in model.nodes:
        report.add(place, f"unknown node {name!r}{nearest(name, model.nodes)}")


def _broker(model: BrokerModel, file: str) -> Broker:
    host, port = model.host, model.port
    given = os.environ.get(BROKER_VARIABLE)
    if given:
        host, _, text = given.rpartition(":")
        if not host or not text.isdecimal() or not 1 <= int(text) <= 65535:
            raise InputError(f"{BROKER_VARIABLE}={given}: expected host:port, e.g. broker:1883")
        port = int(text)
    password = None
    if model.password_variable is not None:
        password = os.environ.get(model.password_variable)
        if password is None:
            raise InputError(f"{file}: the broker's password is to be in {model.password_variable}")
    return Broker(host, port, model.tls, model.username, password, model.keepalive_s)


def _layout(model: LayoutFileModel) -> Layout:
    nodes = {
        name: LayoutNode(place[0], place[1], place[2] if len(place) > 2 else None)
        for name, place in model.nodes.items()
    }
    edges: dict[str, dict[str, float | None]] = {name: {} for name in nodes}
    for edge in model.edges:
        edges[edge.start][edge.end] = edge.max_speed
        if edge.both_ways:
            edges[edge.end][edge.start] = edge.max_speed
    return Layout(model.map, nodes, edges, model.reach_m)


def _address(model: LayoutFileModel, robot: str) -> VehicleAddress:
    vehicle = model.vehicles[robot]
    dialect = DIALECTS[vehicle.dialect or model.dialect]
    serial_number = vehicle.serial_number or robot
    return VehicleAddress(model.interface, vehicle.manufacturer, serial_number, dialect)
