"""Positions from robots' programs, through recordings, to whoever plays them."""

from __future__ import annotations

import json
from pathlib import Path

import fastjsonschema
import pytest
from mcap.reader import NonSeekingReader

from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.recording.channels import CHANNELS, MAP, POSITIONS, SCENE
from mrbt_mesh.recording.folder import observer_file, robot_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.sim import Kill, SimulationResult
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.replay.verify import verify
from tests.support.recorded import read_all, record_example

DRAWN = (POSITIONS, SCENE, MAP)
Run = tuple[Path, SimulationResult]
KILLED_US = 6_000_000


@pytest.fixture(scope="module")
def couriers(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run in which a courier dies on its way."""
    folder = tmp_path_factory.mktemp("couriers")
    return folder, record_example(folder, "couriers", 1, [(KILLED_US, Kill("K2"))])


def test_the_last_positions_are_those_of_the_live_observer(couriers: Run) -> None:
    folder, result = couriers
    player = Player(read_recording(observer_file(folder)))
    player.seek(player.end_us)
    live, played = TeamView(result.observer), TeamView(player.observer)
    live.update(player.end_us)
    played.update(player.end_us)
    for kind in ("position/", "place/"):
        wanted, found = (
            {key: value for key, value in view.changes.since(0).items() if key.startswith(kind)}
            for view in (live, played)
        )
        assert found == wanted
        assert len(wanted) >= 4


def test_a_robot_knows_its_own_and_those_that_it_hears(couriers: Run) -> None:
    folder, result = couriers
    for robot in ("K1", "K3", "K4"):
        agent = result.agents[robot]
        records = read_recording(robot_file(folder, robot)).records
        own = [r for r in records if r.topic == POSITIONS]
        assert {r.data["child_frame_id"] for r in own} == {f"robot/{name}" for name in ALL}
        player = Player(read_recording(robot_file(folder, robot)))
        player.seek(player.end_us)
        heard = {name: peer.position for name, peer in agent.view.peers.items()}
        assert player.state.positions == {**heard, robot: agent.view.position}
        assert {n: p.position for n, p in player.observer.membership.peers.items()} == {
            **heard,
            robot: agent.view.position,
        }


ALL = ("K1", "K2", "K3", "K4")


@pytest.mark.parametrize("whose", ["", "K1"])
def test_a_dead_robot_stays_where_it_was(couriers: Run, whose: str) -> None:
    folder, _ = couriers
    player = Player(read_recording(robot_file(folder, whose) if whose else observer_file(folder)))
    player.seek(KILLED_US - 1)
    before = player.state.positions["K2"]
    assert isinstance(before, Position)
    assert before.heading is not None
    scene = next(
        r.data
        for r in player.recording.records
        if r.topic == SCENE and "K2 dead" in json.dumps(r.data)
    )
    assert {each["id"] for each in scene["entities"]} == set(ALL)
    player.seek(player.end_us)
    told = player.state.to_json()["positions"]
    assert told["K2"] == before.in_units()
    assert set(told) == set(ALL)
    # Back to a time at which it was nowhere yet.
    player.seek(player.begin_us)
    assert player.state.to_json()["positions"] == {}


def test_the_map_shows_what_was_delivered(couriers: Run) -> None:
    folder, _ = couriers
    for path in (observer_file(folder), robot_file(folder, "K1")):
        maps = [r.data for r in read_recording(path).records if r.topic == MAP]
        states = [
            {
                each["id"]: {row["key"]: row["value"] for row in each["metadata"]}.get("state")
                for each in data["entities"]
                if each["id"] != "lines"
            }
            for data in maps
        ]
        assert set(states[0].values()) == {"unknown"}
        assert set(states[-1].values()) == {"good"}
        assert len(states) == len(states[0]) + 1


def test_other_readers_find_messages_that_fit_the_published_schemas(couriers: Run) -> None:
    """By the schema that stands in the file itself."""
    folder, _ = couriers
    fits = {}
    with observer_file(folder).open("rb") as stream:
        for schema, channel, message in NonSeekingReader(stream).iter_messages():
            if channel.topic not in DRAWN:
                continue
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            assert schema.data == CHANNELS[channel.topic].schema_text
            kind = (channel.topic, schema.name)
            if kind not in fits:
                fits[kind] = fastjsonschema.compile(json.loads(schema.data))
            fits[kind](json.loads(message.data))
    assert set(fits) == {
        (POSITIONS, "foxglove.FrameTransform"),
        (SCENE, "foxglove.SceneUpdate"),
        (MAP, "foxglove.SceneUpdate"),
    }


def test_such_recordings_are_proved_as_before(couriers: Run) -> None:
    report = verify(read_all(couriers[0]))
    assert not report.findings, report.findings[:5]
