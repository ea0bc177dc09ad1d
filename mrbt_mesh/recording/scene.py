"""A team in space: the positions and states of its robots, and its map.

Each message about robots or the map contains all of them, so that a viewer that starts late, or
jumps to another time of a recording, needs no earlier message.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeAlias

from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_map import map_view
from mrbt_mesh.recording.channels import MAP, POSITIONS, SCENE
from mrbt_mesh.recording.foxglove import (
    WORLD,
    arrow,
    color,
    disc,
    entity,
    frame_transform,
    label,
    line,
    robot_frame,
    scene_update,
)

_Message: TypeAlias = tuple[str, Mapping[str, Any]]

# The colours of the live page, visible in dark and in bright scenes.
STATE_COLORS = {
    State.ALIVE: color("#2fa65a"),
    State.SUSPECT: color("#d9a520"),
    State.DEAD: color("#e0493e"),
}
PLACE_COLORS = {"unknown": color("#8794a3"), "good": color("#2fa65a"), "bad": color("#e0493e")}
LINE_COLORS = {"street": color("#8794a3"), "outline": color("#5f88b8")}
LINE_PIXELS = {"street": 6, "outline": 3}
# The length of the map in robots.
ROBOTS_PER_MAP = 32
SIZE_WITHOUT_MAP = 0.5


class TeamScene:
    """Call `see`, then `take` the messages that follow from changes.

    A robot is in the scene while its position is known and it has not left; a dead one stays where
    it was.
    """

    def __init__(self, mission: Mission, epoch_ns: int) -> None:
        self._epoch_ns = epoch_ns
        self._map = map_view(mission)
        self._size = _extent(self._map) / ROBOTS_PER_MAP if self._map else SIZE_WITHOUT_MAP
        self._places: Mapping[str, str] = {}
        self._positions: dict[str, Position] = {}
        # Robot -> (state, whether it reports its heading).
        self._robots: dict[str, tuple[State, bool]] = {}
        self._moved: set[str] = set()
        self._gone: set[str] = set()
        self._has_changed = False
        self._is_map_due = self._map is not None

    def see(self, robot: str, state: State, position: Position | None) -> None:
        """Note a robot's state and its last reported position."""
        if position is None or state is State.LEFT:
            if self._robots.pop(robot, None) is not None:
                del self._positions[robot]
                self._moved.discard(robot)
                self._gone.add(robot)
                self._has_changed = True
            return
        known = (state, position.heading is not None)
        if self._robots.get(robot) != known:
            self._robots[robot] = known
            self._gone.discard(robot)
            self._has_changed = True
        if self._positions.get(robot) != position:
            self._positions[robot] = position
            self._moved.add(robot)

    def see_places(self, states: Mapping[str, str]) -> None:
        """Note the states of the places of the map that conditions describe."""
        if states != self._places and self._map is not None:
            self._places = dict(states)
            self._is_map_due = True

    def take(self, at_us: int) -> Iterable[_Message]:
        """Return the messages that follow from the changes since the last call."""
        is_new = self._is_map_due or self._has_changed or self._moved
        return self._messages(at_us) if is_new else ()

    def _messages(self, at_us: int) -> Iterator[_Message]:
        at_ns = self._epoch_ns + at_us * 1_000
        if self._is_map_due and self._map is not None:
            self._is_map_due = False
            yield MAP, scene_update(list(self._map_entities(self._map, at_ns)), (), at_ns)
        if self._has_changed:
            self._has_changed = False
            there = [self._robot(robot, at_ns) for robot in sorted(self._robots)]
            gone, self._gone = sorted(self._gone), set()
            yield SCENE, scene_update(there, gone, at_ns)
        if self._moved:
            moved, self._moved = sorted(self._moved), set()
            for robot in moved:
                where = self._positions[robot]
                x, y, heading = where.x / 1_000, where.y / 1_000, (where.heading or 0) / 1_000
                yield POSITIONS, frame_transform(robot_frame(robot), x, y, heading, at_ns)

    def _robot(self, robot: str, at_ns: int) -> dict[str, Any]:
        state, has_heading = self._robots[robot]
        paint, size = STATE_COLORS[state], self._size
        body = (
            {"arrows": [arrow(size, paint)]}
            if has_heading
            else {"cylinders": [disc(0, 0, 0.7 * size, paint)]}
        )
        text = robot if state is State.ALIVE else f"{robot} {state}"
        about = {"robot": robot, "state": str(state)}
        texts = [label(0, 0, 1.2 * size, text, paint)]
        return entity(robot, robot_frame(robot), about, at_ns, **body, texts=texts)

    def _map_entities(self, seen: Mapping[str, Any], at_ns: int) -> Iterator[dict[str, Any]]:
        lines = [
            line(each["points"], each["closed"], LINE_PIXELS[kind], LINE_COLORS[kind])
            for each in seen["lines"]
            for kind in [each["kind"]]
        ]
        yield entity("lines", WORLD, {}, at_ns, lines=lines)
        for name, place in seen["places"].items():
            state = self._places.get(name, "unknown")
            (x, y), paint = place["at"], PLACE_COLORS[state]
            about = {"place": name, "state": state} if name in self._places else {"place": name}
            body = [disc(x, y, 1.4 * self._size, paint)]
            texts = [label(x, y, self._size, place["label"], paint)]
            yield entity(f"place/{name}", WORLD, about, at_ns, cylinders=body, texts=texts)


def _extent(seen: Mapping[str, Any]) -> float:
    """Return the longer side of the map; 1 if it is a single point."""
    points = [point for each in seen["lines"] for point in each["points"]]
    points += [place["at"] for place in seen["places"].values()]
    sides = [max(values) - min(values) for values in zip(*points, strict=True)]
    return max(sides) or 1.0
