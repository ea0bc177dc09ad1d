"""Foxglove's websocket protocol, spoken with a client of it that knows nothing of this project."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fastjsonschema
import pytest

from mrbt_mesh.adapters.foxglove import FoxgloveServer
from mrbt_mesh.core.agent.inputs import PositionReported
from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.channels import (
    ALIVE,
    BEATS,
    CHANNELS,
    DROPPED,
    FACTS,
    FAULTS,
    PLANS,
    POSITIONS,
    SCENE,
)
from mrbt_mesh.recording.metadata import OBSERVER, RunMetadata
from mrbt_mesh.recording.observer_recorder import ObserverRecorder
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.recording.writer import RecordingWriter
from tests.support.extras import said_without
from tests.support.foxglove import viewer
from tests.support.watched import WELD, watched

REMEDY = "is not installed: make test-interop, or pip install 'mrbt-mesh[interop]'"
HOST = "127.0.0.1"


def metadata_of(observer: Observer) -> RunMetadata:
    timing = observer.membership.timing
    return RunMetadata.of(observer.mission, OBSERVER, "r1", timing, 5_000_000, "1.0")


class Live:
    """A team in memory whose observer is served, and recorded in a file at the same time."""

    def __init__(self, file: Path) -> None:
        self.script, self.observer = watched(WELD)
        metadata = metadata_of(self.observer)
        self.server = FoxgloveServer(metadata, HOST, 0)
        self.file = file
        writer = RecordingWriter(file, metadata)
        self.recorders = [ObserverRecorder(sink, self.observer) for sink in (writer, self.server)]
        self.update()

    def update(self) -> None:
        for recorder in self.recorders:
            recorder.update(self.script.team.now_us)

    def go(self, *commands: str) -> None:
        self.script.block(list(commands))
        self.update()

    def move(self, robot: str, x: int, y: int, heading: int | None = None) -> None:
        """The robot's program says where it is; the next heartbeat tells the others."""
        team = self.script.team
        team.give(team.processes[robot], PositionReported(Position(x, y, heading)))
        self.go("pass 500")


@contextmanager
def serving(folder: Path) -> Iterator[Live]:
    pytest.importorskip("foxglove", reason=f"foxglove-sdk {REMEDY}")
    pytest.importorskip("websockets", reason=f"websockets {REMEDY}")
    live = Live(folder / "run.mcap")
    try:
        yield live
    finally:
        for recorder in live.recorders:
            recorder.close()


async def test_every_channel_is_offered_with_the_schema_that_files_have(tmp_path: Path) -> None:
    with serving(tmp_path) as live:
        async with viewer(live.server.address) as client:
            wanted = set(CHANNELS) - {BEATS}
            await client.offered(wanted)
            assert client.channels.keys() == wanted
            for topic, offer in client.channels.items():
                channel = CHANNELS[topic]
                assert (offer["encoding"], offer["schemaEncoding"]) == ("json", "jsonschema")
                assert offer["schemaName"] == channel.name
                assert offer["schema"].encode() == channel.schema_text
            # A viewer cannot publish anything here.
            assert client.server["capabilities"] == []


async def test_what_comes_live_is_what_the_file_holds(tmp_path: Path) -> None:
    with serving(tmp_path) as live:
        async with viewer(live.server.address) as client:
            await client.offered([PLANS, SCENE, POSITIONS, FAULTS])
            await client.ask(SCENE, POSITIONS, FAULTS)
            await client.ask(PLANS)
            before = await client.message()  # what is asked for has been taken in
            live.move("A", 1_000, 2_000, 1_571)
            live.go("succeed A", "pass 500")
            live.go("kill B", "pass 4000")
            wanted = [
                (record.topic, record.data)
                for record in read_recording(live.file).records
                if record.topic in (SCENE, POSITIONS, FAULTS)
                or (record.topic == PLANS and record.data["number"] > before.data["number"])
            ]
            assert {topic for topic, _ in wanted} == {PLANS, SCENE, POSITIONS, FAULTS}
            fits = {
                topic: fastjsonschema.compile(json.loads(client.channels[topic]["schema"]))
                for topic in (PLANS, SCENE, POSITIONS, FAULTS)
            }
            found = []
            for message in await client.messages(len(wanted)):
                fits[message.topic](message.data)
                data = {key: value for key, value in message.data.items() if key != "check"}
                found.append((message.topic, data))
                assert message.at_ns > 5_000_000
            for topic in (PLANS, SCENE, POSITIONS, FAULTS):
                assert [d for t, d in found if t == topic] == [d for t, d in wanted if t == topic]


async def test_one_who_comes_late_is_told_what_stands(tmp_path: Path) -> None:
    with serving(tmp_path) as live:
        for robot, x in (("A", 1_000), ("B", 3_000), ("A", 2_000)):
            live.move(robot, x, 0)
        live.go("succeed A", "pass 500")
        async with viewer(live.server.address) as client:
            topics = (FACTS, DROPPED, ALIVE, PLANS, SCENE, POSITIONS)
            await client.offered(topics)
            await client.ask(*topics)
            facts = {(entry.author, entry.name): entry for entry in live.observer.facts.map}
            count = len(facts) + 1 + 1 + 1 + 2
            told = await client.messages(count)
            of: dict[str, list[dict[str, Any]]] = {topic: [] for topic in topics}
            for message in told:
                of[message.topic].append(message.data)
            assert {(d["author"], d["name"]): d["hash"] for d in of[FACTS]} == {
                key: f"{entry.hash:032x}" for key, entry in facts.items()
            }
            assert of[DROPPED] == []
            assert [set(d["robots"]) for d in of[ALIVE]] == [{"A", "B"}]
            plan = live.observer.plan
            assert plan is not None
            assert [d["digest"] for d in of[PLANS]] == [plan.digest.hex()]
            at = {d["child_frame_id"]: d["translation"]["x"] for d in of[POSITIONS]}
            assert at == {"robot/A": 2.0, "robot/B": 3.0}
            (scene,) = of[SCENE]
            assert [each["id"] for each in scene["entities"]] == ["A", "B"]


async def test_facts_that_were_dropped_do_not_stand(tmp_path: Path) -> None:
    with serving(tmp_path) as live:
        live.server.write(FACTS, 1, {"author": "X", "name": "claim", "number": 1})
        live.server.write(DROPPED, 2, {"author": "X", "name": "claim", "number": 2})
        async with viewer(live.server.address) as client:
            await client.offered([FACTS])
            await client.ask(FACTS)
            told = await client.messages(len(list(live.observer.facts.map)))
            assert "X" not in {message.data["author"] for message in told}


async def test_a_port_that_is_taken_is_named() -> None:
    pytest.importorskip("foxglove", reason=f"foxglove-sdk {REMEDY}")
    with socket.create_server((HOST, 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"Foxglove at 127.0.0.1 port {port}: .*in use"):
            FoxgloveServer(metadata_of(watched(WELD)[1]), HOST, port)


def test_without_the_extra_it_says_what_to_install() -> None:
    said = said_without("foxglove", "mrbt_mesh.adapters.foxglove", "FoxgloveViewer().check(None)")
    assert (
        said
        == "Foxglove's protocol needs the extra 'foxglove': pip install 'mrbt-mesh[foxglove]'\n"
    )
