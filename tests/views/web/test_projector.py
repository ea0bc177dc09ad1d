"""One showing of a recording: what those who look may wish, and what they are told then."""

from __future__ import annotations

import json
from typing import Any

import anyio
import pytest
from starlette.testclient import TestClient

from mrbt_mesh.plugins import ViewerOptions
from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, read_recording
from mrbt_mesh.views.replay.shown_recording import ShownRecording
from mrbt_mesh.views.web.app import Page
from mrbt_mesh.views.web.projector import RecordingProjector, showing_recording
from mrbt_mesh.views.web.protection import own_names
from tests.support.recorded import record_example

HOST = "127.0.0.1:8000"
JSON = {"content-type": "application/json"}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("projected")
    record_example(folder, "explore", 3)
    return read_recording(observer_file(folder))


@pytest.fixture
def shown(recording: Recording) -> ShownRecording:
    return ShownRecording(Player(recording), 0, 1.0)


def client(shown: ShownRecording) -> TestClient:
    projector = RecordingProjector(shown)
    page = Page(projector.feed, own_names(["127.0.0.1"], 8000), projector=projector)
    return TestClient(page.application(), base_url=f"http://{HOST}")


def wish(shown: ShownRecording, body: Any, **headers: str) -> int:
    sent = JSON | {name.replace("_", "-"): value for name, value in headers.items()}
    code: int = client(shown).post("/playback", content=json.dumps(body), headers=sent).status_code
    return code


def test_pause_speed_and_place(shown: ShownRecording) -> None:
    assert wish(shown, {"paused": True, "speed": 4, "at_s": 1.5}) == 204
    playback = shown.playback
    assert (playback.is_paused, playback.speed) == (True, 4)
    assert shown.seconds(playback.at_us) == 1.5
    assert wish(shown, {"at_s": -99}) == 204
    assert playback.at_us == playback.player.begin_us
    assert wish(shown, {"paused": False}) == 204
    assert not playback.is_paused


@pytest.mark.parametrize(
    "body",
    [
        [],
        "play",
        {"kill": "A"},
        {"at_s": "1"},
        {"at_s": True},
        {"at_s": float("nan")},
        {"at_s": float("inf")},
        {"at_s": 10**400},
        {"speed": 0},
        {"speed": -1},
        {"paused": 1},
        {"paused": True, "more": 1},
    ],
)
def test_what_is_no_wish_changes_nothing(shown: ShownRecording, body: Any) -> None:
    playback = shown.playback
    before = (playback.at_us, playback.speed, playback.is_paused)
    assert wish(shown, body) == 400
    assert (playback.at_us, playback.speed, playback.is_paused) == before


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "evil.example:8000"},
        {"origin": "http://evil.example"},
        {"sec_fetch_site": "cross-site"},
        {"content_type": "text/plain"},
    ],
)
def test_other_sites_wish_in_vain(shown: ShownRecording, headers: dict[str, str]) -> None:
    assert wish(shown, {"paused": True}, **headers) in (403, 415, 421)
    assert not shown.playback.is_paused


def test_a_recording_is_told_and_takes_no_commands(shown: ShownRecording) -> None:
    page = client(shown)
    told = page.get("/mission").json()
    assert told["control"] is None
    assert told["recording"]["file"] == "run.mcap"
    assert page.post("/commands", content="{}", headers=JSON).status_code == 403
    assert page.get("/drills").status_code == 403
    assert page.get("/metrics").status_code == 404


async def test_it_is_played_while_somebody_looks(shown: ShownRecording) -> None:
    """To the end, in the order of time; what is told last is how the run went."""
    shown.playback.set_speed(1000)
    projector = RecordingProjector(shown)
    async with anyio.create_task_group() as group:
        group.start_soon(projector.run)
        places, result = [], None
        async for message in projector.feed.messages(""):
            data = json.loads(message.partition("data: ")[2])
            places.append(data["now_s"])
            result = data["items"].get("team", {}).get("ended", result)
            if data["items"].get("playback", {}).get("paused"):
                break
        group.cancel_scope.cancel()
    assert places == sorted(places)
    assert places[-1] == shown.to_json()["to_s"]
    assert result == "success"


async def test_a_page_is_served_on_loopback(shown: ShownRecording) -> None:
    async with showing_recording(shown, ViewerOptions()) as address:
        assert address.startswith("http://127.0.0.1:")


async def test_nobody_looks_and_no_time_passes(shown: ShownRecording) -> None:
    projector = RecordingProjector(shown)
    before_us = shown.playback.at_us
    async with anyio.create_task_group() as group:
        group.start_soon(projector.run)
        for number in range(3):
            projector.carry_out({"speed": 1000 - number})
            with anyio.fail_after(60):
                while shown.changes.since(0).get("playback", {}).get("speed") != 1000 - number:
                    await anyio.lowlevel.checkpoint()
        group.cancel_scope.cancel()
    assert shown.playback.at_us == before_us
