"""The layout file: a plant's nodes and edges, its vehicles, and their orders for local tasks.

docs/how-to/vda5050.md explains the keys; examples/warehouse/agvs.yaml is an example.
"""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field, PrivateAttr

from mrbt_mesh.adapters.binding import BoundFile, Problems, load_bound, unknown_names
from mrbt_mesh.adapters.vda5050.dialects import DIALECTS, VehicleAddress
from mrbt_mesh.adapters.vda5050.layout import Layout, LayoutNode, TaskTemplate
from mrbt_mesh.adapters.vda5050.vehicle import NO_PROGRESS_S, Battery
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.formats.file_model import FileModel, Name, RobotName
from mrbt_mesh.formats.problems import SourcePath
from mrbt_mesh.formats.tree_model import TREE_EXPLAINED

# `host:port` that overrides the file's broker, so that a plant and tests can use the same file.
BROKER_VARIABLE = "MRBT_VDA5050_BROKER"

_LEVEL = r"^[^/+#\s][^/+#]{0,63}$"
_EXPLAINED = TREE_EXPLAINED | {
    _LEVEL: "a part of an MQTT topic is expected: 1 to 64 characters without /, + and #"
}

Level: TypeAlias = Annotated[str, Field(pattern=_LEVEL)]
NodeName: TypeAlias = Annotated[str, Field(min_length=1, max_length=64)]
DialectName: TypeAlias = Literal["1.1", "2.0", "2.1", "3.0"]
Coordinates: TypeAlias = Annotated[list[float], Field(min_length=2, max_length=3)]


class Broker(FileModel):
    """How the vehicles' broker is reached. The password comes from an environment variable.

    `keepalive_s`: how soon it notices a lost client.
    """

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=1, le=65535)] = 1883
    tls: bool = False
    username: str | None = None
    password_variable: str | None = None
    keepalive_s: Annotated[int, Field(ge=1, le=600)] = 5
    _password: str | None = PrivateAttr(None)

    @property
    def password(self) -> str | None:
        """The password, if one is needed."""
        return self._password

    def with_environment(self, file: str) -> Broker:
        """Return the broker with its password and an overriding address. Raises InputError."""
        found, given = self, os.environ.get(BROKER_VARIABLE)
        if given:
            host, _, text = given.rpartition(":")
            if not host or not text.isdecimal() or not 1 <= int(text) <= 65535:
                raise InputError(f"{BROKER_VARIABLE}={given}: expected host:port, e.g. broker:1883")
            found = self.model_copy(update={"host": host, "port": int(text)})
        if self.password_variable is not None:
            found._password = os.environ.get(self.password_variable)
            if found._password is None:
                raise InputError(f"{file}: {self.password_variable} has to hold the password")
        return found


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


class LayoutFile(BoundFile):
    """A whole file. `errors`: the local tasks that an error type prevents; `no_progress_s`: how
    long an order may stand still before it has failed.
    """

    ROBOTS: ClassVar[str] = "vehicles"
    broker: Broker = Broker()
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
    no_progress_s: Annotated[float, Field(ge=1, le=86_400)] = NO_PROGRESS_S

    @cached_property
    def addresses(self) -> dict[str, VehicleAddress]:
        """The address of each robot's vehicle, by robot."""
        return {
            robot: VehicleAddress(
                self.interface,
                vehicle.manufacturer,
                vehicle.serial_number or robot,
                DIALECTS[vehicle.dialect or self.dialect],
            )
            for robot, vehicle in self.vehicles.items()
        }

    @cached_property
    def layout(self) -> Layout:
        """The layout: the file's nodes and edges."""
        nodes = {name: LayoutNode(*place) for name, place in self.nodes.items()}
        edges: dict[str, dict[str, float | None]] = {name: {} for name in nodes}
        for edge in self.edges:
            edges[edge.start][edge.end] = edge.max_speed
            if edge.both_ways:
                edges[edge.end][edge.start] = edge.max_speed
        return Layout(self.map, nodes, edges, self.reach_m)

    def problems(self) -> Problems:
        """Yield the problems of the file beyond the shape of single parts."""
        for index, edge in enumerate(self.edges):
            for key, name in (("from", edge.start), ("to", edge.end)):
                yield from self._unknown_node(name, ("edges", index, key))
            if edge.start == edge.end:
                text = f"an edge leads to another node, not back to {edge.end}"
                yield ("edges", index), text
        seen: dict[tuple[str, str], str] = {}
        for robot, address in self.addresses.items():
            other = seen.setdefault((address.manufacturer, address.serial_number), robot)
            if other != robot:
                yield ("vehicles", robot), f"is the same vehicle as {other}"
        for name, task in self.local_tasks.items():
            yield from self._task_problems(task, ("local_tasks", name))
        for kind, names in self.errors.items():
            for index, name in enumerate(names):
                if name not in self.local_tasks:
                    text = f"unknown local task {name!r}{nearest(name, self.local_tasks)}"
                    yield ("errors", kind, index), text
        if self.battery.enough_percent < self.battery.low_percent:
            yield ("battery",), "enough_percent is less than low_percent"

    def _task_problems(self, task: TaskTemplate, place: SourcePath) -> Problems:
        for index, stop in enumerate(task.stops):
            if "$" not in stop.at:
                yield from self._unknown_node(stop.at, (*place, "stops", index, "at"))
        texts = task.model_dump(include={"stops", "sets"})
        yield from unknown_names(texts, task.parameters, place)

    def _unknown_node(self, name: str, place: SourcePath) -> Problems:
        if name not in self.nodes:
            yield place, f"unknown node {name!r}{nearest(name, self.nodes)}"


def load_layout(path: Path) -> LayoutFile:
    """Read a layout file. Raises FileError with all problems found."""
    expected = "a layout is expected (nodes: ..., vehicles: ...)"
    found = load_bound(LayoutFile, path, expected, _EXPLAINED)
    return found.model_copy(update={"broker": found.broker.with_environment(found.file)})
