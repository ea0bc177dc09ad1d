"""What is drawn of a team is what was told of it, for whoever looks from the beginning or later."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import fastjsonschema
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.recording.channels import CHANNELS, MAP, POSITIONS, SCENE
from mrbt_mesh.recording.foxglove import heading_of, robot_frame
from mrbt_mesh.recording.scene import TeamScene
from tests.support.build import action, make_mission

PLAIN = make_mission(action("weld"))
GIVEN = {
    "lines": [{"kind": "street", "points": [[0, 0], [64, 8]], "closed": True}],
    "places": {"p": {"at": [3, 4], "bad": "b"}, "q": {"at": [5, 6], "label": "Q"}},
}
MAPPED = replace(PLAIN, parameters={"map": GIVEN})

FITS = {
    CHANNELS[topic].name: fastjsonschema.compile(dict(CHANNELS[topic].schema))
    for topic in (POSITIONS, SCENE)
}

places = st.builds(Position, st.integers(-9, 9), st.integers(-9, 9), st.none() | st.integers(-3, 3))
seen = st.tuples(st.sampled_from("ABC"), st.sampled_from(list(State)), st.none() | places)


class Viewer:
    """What a 3D panel shows that follows the schemas' own descriptions."""

    def __init__(self) -> None:
        self.entities: dict[str, dict[str, Any]] = {}
        self.frames: dict[str, dict[str, Any]] = {}

    def take(self, messages: Iterable[tuple[str, Mapping[str, Any]]]) -> None:
        for topic, data in messages:
            FITS[CHANNELS[topic].name](data)
            if topic == POSITIONS:
                self.frames[data["child_frame_id"]] = dict(data)
                continue
            for gone in data["deletions"]:
                self.entities.pop(gone["id"], None)
            self.entities.update({each["id"]: each for each in data["entities"]})

    def robots(self) -> dict[str, tuple[str, int, int, int | None]]:
        """Robot -> (state, x, y, heading), in thousandths."""
        found = {}
        for robot, drawn in self.entities.items():
            assert drawn["frame_id"] == robot_frame(robot)
            frame = self.frames[drawn["frame_id"]]
            x, y = (round(frame["translation"][axis] * 1_000) for axis in "xy")
            turn = round(heading_of(frame["rotation"]) * 1_000)
            state = {each["key"]: each["value"] for each in drawn["metadata"]}["state"]
            found[robot] = state, x, y, turn if drawn["arrows"] else None
        return found


@given(st.lists(st.lists(seen, max_size=4), max_size=12))
def test_whoever_looks_sees_each_robot_that_is_there(steps: list[list[Any]]) -> None:
    scene, known, early = TeamScene(PLAIN, 1_000), {}, Viewer()
    newest: dict[tuple[str, str], Mapping[str, Any]] = {}
    for at_us, step in enumerate(steps):
        for robot, state, where in step:
            scene.see(robot, state, where)
            known[robot] = (state, where)
        messages = list(scene.take(at_us))
        early.take(messages)
        for topic, data in messages:
            newest[topic, data.get("child_frame_id", "")] = data
        late = Viewer()
        late.take([(topic, data) for (topic, _), data in sorted(newest.items())])
        wanted = {
            robot: (str(state), where.x, where.y, where.heading)
            for robot, (state, where) in known.items()
            if where is not None and state is not State.LEFT
        }
        assert early.robots() == late.robots() == wanted
        assert list(scene.take(at_us)) == []


def test_a_robot_that_moves_is_not_drawn_anew() -> None:
    scene = TeamScene(PLAIN, 0)
    scene.see("A", State.ALIVE, Position(0, 0))
    assert [topic for topic, _ in scene.take(1)] == [SCENE, POSITIONS]
    scene.see("A", State.ALIVE, Position(5, 0))
    assert [topic for topic, _ in scene.take(2)] == [POSITIONS]
    scene.see("A", State.SUSPECT, Position(5, 0))
    ((topic, data),) = scene.take(3)
    assert topic == SCENE
    (text,) = data["entities"][0]["texts"]
    assert text["text"] == "A suspect"


def drawn(mission: Mission, states: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    scene, viewer = TeamScene(mission, 0), Viewer()
    scene.see_places(states)
    viewer.take(scene.take(1))
    return viewer.entities


def test_the_map_is_drawn_once_and_with_each_change_of_its_places() -> None:
    scene, viewer = TeamScene(MAPPED, 0), Viewer()
    viewer.take(scene.take(1))
    (street,) = viewer.entities["lines"]["lines"]
    assert [(point["x"], point["y"]) for point in street["points"]] == [(0, 0), (64, 8)]
    assert street["type"] == 1  # LINE_LOOP
    grey = viewer.entities["place/p"]["cylinders"][0]["color"]
    assert viewer.entities["place/q"]["texts"][0]["text"] == "Q"
    scene.see_places({"p": "bad"})
    (message,) = scene.take(2)
    assert message[0] == MAP
    viewer.take([message])
    assert viewer.entities["place/p"]["cylinders"][0]["color"] != grey
    assert viewer.entities["place/q"]["cylinders"][0]["color"] == grey
    scene.see_places({"p": "bad"})
    assert list(scene.take(3)) == []


def test_a_mission_without_a_map_has_none_drawn() -> None:
    assert drawn(PLAIN, {"p": "bad"}) == {}


def test_robots_are_as_large_as_their_map_wants() -> None:
    def length(mission: Mission) -> float:
        scene = TeamScene(mission, 0)
        scene.see("A", State.ALIVE, Position(0, 0, 0))
        (data,) = [data for topic, data in scene.take(1) if topic == SCENE]
        found: float = data["entities"][0]["arrows"][0]["shaft_length"]
        return found

    assert length(MAPPED) == 64 / 32
    assert length(PLAIN) == 0.5
    point = replace(PLAIN, parameters={"map": {"places": {"p": {"at": [7, 7]}}}})
    assert length(point) == 1 / 32
