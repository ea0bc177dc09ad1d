"""Makes orders from local tasks, by the layout of a plant and templates of local tasks.

Pure functions. Routes are shortest by length; ties are broken by names. There is no traffic
control: two vehicles may get the same edge at the same time, even in opposite directions.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field, JsonValue

from mrbt_mesh.adapters.binding import BoundTask
from mrbt_mesh.adapters.vda5050.dialects import Action, OrderNode, VehicleOrder
from mrbt_mesh.adapters.vda5050.messages import VehicleState
from mrbt_mesh.formats.file_model import FileModel
from mrbt_mesh.formats.tree_model import CallText

# A vehicle this close to a node is on it, and needs no tolerance beyond its own.
ON_NODE_M = 0.1


class RouteError(Exception):
    """There is no route; the text says why."""


@dataclass(frozen=True)
class LayoutNode:
    """A node of the layout, in metres; `theta`: the heading required there, in radians, if any."""

    x: float
    y: float
    theta: float | None = None


class ActionTemplate(FileModel):
    """An action of a stop, with the parameters that the vehicle needs."""

    type: str
    parameters: dict[str, JsonValue] = {}
    blocking: Literal["NONE", "SOFT", "HARD"] = "HARD"


class StopTemplate(FileModel):
    """A node to drive to, which may be a parameter, and what is done there."""

    at: str
    actions: tuple[ActionTemplate, ...] = Field((), strict=False)


class TaskTemplate(BoundTask):
    """A local task as an order; texts may name its parameters, e.g. `$rack`."""

    sets: dict[CallText, bool] = {}
    stops: tuple[StopTemplate, ...] = Field(min_length=1, max_length=100, strict=False)

    def filled(self, arguments: Sequence[str]) -> TaskTemplate:
        """Fill in the arguments of a ground local task. Raises FillError."""
        known = self.known(arguments)
        stops = (StopTemplate(**known.data(stop.model_dump())) for stop in self.stops)
        sets = {known.text(name): value for name, value in self.sets.items()}
        return TaskTemplate(stops=tuple(stops), sets=sets)


@dataclass(frozen=True)
class Layout:
    """A map's nodes and its directed edges with their speed limits in m/s; None: no limit.

    A vehicle that reports no node may be up to `reach_m` away from the node where its order starts.
    """

    map_id: str
    nodes: Mapping[str, LayoutNode]
    edges: Mapping[str, Mapping[str, float | None]]
    reach_m: float = 2.0

    def way(self, start: str, end: str) -> list[str]:
        """Return the nodes of the shortest path, including both ends. Raises RouteError."""
        for name in (start, end):
            if name not in self.nodes:
                raise RouteError(f"the layout has no node {name!r}")
        open_: list[tuple[float, list[str]]] = [(0.0, [start])]
        closed: set[str] = set()
        while open_:
            length, path = heapq.heappop(open_)
            here = path[-1]
            if here == end:
                return path
            if here in closed:
                continue
            closed.add(here)
            for there in self.edges.get(here, ()):
                if there not in closed:
                    heapq.heappush(open_, (length + self._length(here, there), [*path, there]))
        raise RouteError(f"the layout has no way from {start} to {end}")

    def begin(self, state: VehicleState) -> str:
        """Return the node where a vehicle's next order starts. Raises RouteError.

        This is its last reported node, else the nearest node within reach.
        """
        if state.last_node in self.nodes:
            return state.last_node
        place = state.place
        if place is None:
            said = repr(state.last_node) if state.last_node else "no node"
            raise RouteError(f"the vehicle reports {said} and no position: the layout needs one")
        off, name = min(
            (math.hypot(node.x - place.x, node.y - place.y), name)
            for name, node in self.nodes.items()
        )
        if off > self.reach_m:
            raise RouteError(
                f"the vehicle is at ({place.x:.1f}, {place.y:.1f}), {off:.1f} m from the nearest "
                f"node ({name})"
            )
        return name

    def route(
        self, state: VehicleState, stops: Sequence[StopTemplate]
    ) -> list[tuple[str, int | None]]:
        """Return a vehicle's route as pairs of a node and the index of the stop there, if any.

        If the vehicle already is at the first stop, the route starts with that stop. Raises
        RouteError.
        """
        route: list[tuple[str, int | None]] = [(self.begin(state), None)]
        for index, stop in enumerate(stops):
            way = self.way(route[-1][0], stop.at)
            if len(way) == 1 and route[-1][1] is None:
                route[-1] = (way[0], index)
            elif len(way) == 1:
                # Two stops in a row at the same node would require a drive from it to itself.
                raise RouteError(f"two stops at {stop.at} without another between them")
            else:
                route += [(name, None) for name in way[1:-1]] + [(way[-1], index)]
        return route

    def length_m(self, state: VehicleState, stops: Sequence[StopTemplate]) -> float:
        """Return the distance in metres a vehicle would drive to these stops. Raises RouteError."""
        route = self.route(state, stops)
        gone = sum(
            self._length(route[index][0], route[index + 1][0]) for index in range(len(route) - 1)
        )
        return gone + self._off(state, route[0][0])

    def order(
        self, order_id: str, state: VehicleState, stops: Sequence[StopTemplate]
    ) -> VehicleOrder:
        """Return the order for these stops, from the vehicle's place. Raises RouteError."""
        route = self.route(state, stops)
        off = self._off(state, route[0][0])
        nodes, count = [], 0
        for position, (name, stop) in enumerate(route):
            node = self.nodes[name]
            templates = stops[stop].actions if stop is not None else ()
            actions = tuple(
                Action(f"{order_id}/{count + number}", each.type, each.parameters, each.blocking)
                for number, each in enumerate(templates, start=1)
            )
            count += len(actions)
            # The first node must tolerate the vehicle's present position and heading.
            first = position == 0
            nodes.append(
                OrderNode(
                    name,
                    node.x,
                    node.y,
                    None if first or stop is None else node.theta,
                    off + ON_NODE_M if first and off > ON_NODE_M else 0.0,
                    actions,
                )
            )
        limits = tuple(
            self.edges[route[index][0]][route[index + 1][0]] for index in range(len(route) - 1)
        )
        return VehicleOrder(order_id, self.map_id, tuple(nodes), limits)

    def _length(self, start: str, end: str) -> float:
        here, there = self.nodes[start], self.nodes[end]
        return math.hypot(here.x - there.x, here.y - there.y)

    def _off(self, state: VehicleState, name: str) -> float:
        if state.place is None:
            return 0.0
        node = self.nodes[name]
        return math.hypot(node.x - state.place.x, node.y - state.place.y)
