"""A team of real processes in Foxglove, and a viewer that comes late."""

from __future__ import annotations

import json
import signal

import fastjsonschema
import pytest

from mrbt_mesh.recording.channels import ALIVE, FAULTS, MAP, PLANS, POSITIONS, SCENE
from tests.support.foxglove import viewer
from tests.support.team import REPAIR, Team

REMEDY = "is not installed: make test-interop, or pip install 'mrbt-mesh[interop]'"


def addresses(process: object) -> dict[str, str]:
    """What `mrbt watch --web --json` says, once it has."""
    text = ""
    while not text.endswith("}\n"):
        line = process.stdout.readline()  # type: ignore[attr-defined]
        assert line, text
        text += line
    found: dict[str, str] = json.loads(text)
    return found


async def test_a_viewer_sees_where_robots_are_and_that_one_dies(team: Team) -> None:
    pytest.importorskip("foxglove", reason=f"foxglove-sdk {REMEDY}")
    pytest.importorskip("websockets", reason=f"websockets {REMEDY}")
    team.hold("do_diagnosis")
    team.up(REPAIR)
    team.wait_for_event("do_diagnosis")
    where = ("--run-dir", str(team.run_dir), "--port", "0")
    web = team.start("watch", "--web", "--foxglove", *where, "--json")
    async with viewer(addresses(web)["foxglove"]) as client:
        topics = (MAP, SCENE, POSITIONS, ALIVE, PLANS, FAULTS)
        await client.offered(topics)
        fits = {
            topic: fastjsonschema.compile(json.loads(client.channels[topic]["schema"]))
            for topic in topics
        }
        await client.ask(*topics)
        robots = set(team.robots())
        seen: dict[str, dict[str, object]] = {}
        frames: set[str] = set()
        while not (len(frames) == len(robots) and seen.keys() >= {MAP, SCENE, ALIVE, PLANS}):
            message = await client.message()
            fits[message.topic](message.data)
            seen[message.topic] = message.data
            if message.topic == POSITIONS:
                frames.add(message.data["child_frame_id"])
        assert frames == {f"robot/{robot}" for robot in robots}
        victim = min(robots)
        team.signal(victim, signal.SIGKILL)
        while "dead" not in (message := await client.message()).text.decode():
            pass
        while message.topic != SCENE or f"{victim} dead" not in message.text.decode():
            message = await client.message()
        drawn = {each["id"] for each in message.data["entities"]}
        assert drawn == robots
    team.release()
    assert team.end()[0] == 0
    web.send_signal(signal.SIGTERM)
    _, problems = web.communicate(timeout=30)
    assert (web.returncode, problems) == (0, "")
